"""Panels and tanks in recorded flights: found with the inertia, where a rigid body is off by standard deviations."""

import dataclasses
import functools

import numpy as np
import pytest

from baselines.identification.recorded import clean_log, motion
from satid_gym import SATELLITES
from satid_gym.identification import identify
from tests.flexible import BOOM, PANELS, TANK, TOLD, tensor_errors

BODIES = {"panels": (PANELS,), "tank": (TANK.replace(frequency=0.2),), "panels and boom": (PANELS, BOOM)}


def nominal(oscillators):
    told = [one.replace(**TOLD) for one in oscillators]
    return SATELLITES["microsat"].replace(gyro_noise_std=1e-5, oscillators=told)


@functools.cache
def recorded(name):
    """A satellite whose panels and tanks are off nominal, and a flight of it."""
    sheet, rng = nominal(BODIES[name]), np.random.default_rng(7)
    built = []
    for own in sheet.oscillators:
        frequency, damping, mass = np.exp(np.array([0.2, 0.3, 0.1]) * rng.standard_normal(3))
        inertia = {"inertia": own.inertia * mass} if hasattr(own, "inertia") else {}
        own = own.replace(frequency=own.frequency * frequency, damping=own.damping * damping)
        built.append(own.replace(mass=own.mass * mass, **inertia))
    truth = sheet.replace(oscillators=built, inertia=1.05 * sheet.inertia)
    return truth, clean_log(motion(truth, rng, 300.0), truth, rng)


@pytest.mark.parametrize(
    ("name", "times"),
    [
        ("tank", 4.0),
        pytest.param("panels", 20.0, marks=pytest.mark.slow),
        pytest.param("panels and boom", 20.0, marks=pytest.mark.slow),
    ],
)
def test_the_inertia_is_found_with_panels_and_tanks_and_they_with_it(name, times):
    """A rigid body's error is so many times as large."""
    truth, log = recorded(name)
    found = identify(log, nominal(BODIES[name]))
    error, std = tensor_errors(found, truth), np.sqrt(np.diag(found.covariance))
    rigid = np.abs(tensor_errors(identify(log, nominal(())), truth)).max()
    print(f"{name}: largest error {np.abs(error).max():.2e} of the mean moment, as a rigid body {rigid:.2e}")
    assert np.abs(error).max() < 5e-4
    assert rigid > times * np.abs(error).max()
    assert (np.abs(error) * np.diag(truth.inertia).mean() < 4.0 * std).all()
    told = {parameter.name: parameter for parameter in found.parameters}
    for number, own in enumerate(truth.oscillators, 1):
        for what in ("frequency", "damping", "mass"):
            parameter = told[f"{what} of oscillator {number}"]
            print(f"  {parameter.name}: {parameter.value:.4g} +- {parameter.std:.1g}, truly {getattr(own, what):.4g}")
            assert abs(parameter.value - getattr(own, what)) < 4.0 * parameter.std
        assert told[f"frequency of oscillator {number}"].value == pytest.approx(own.frequency, rel=0.01)
    assert any(note.startswith("oscillator 1: frequency ") and "nominally" in note for note in found.notes)


def test_readings_too_far_apart_to_follow_them_leave_the_body_rigid():
    _, log = recorded("tank")
    rows = {name: getattr(log, name)[::20] for name in ("time", "rate", "wheel_speed")}
    found = identify(dataclasses.replace(log, **rows), nominal(BODIES["tank"]), window=80.0)
    (note,) = [note for note in found.notes if "too far apart to follow" in note]
    assert "are off by up to that" in note
    assert not any("oscillator" in parameter.name for parameter in found.parameters)


def test_a_mass_that_turns_nothing_and_a_damping_near_its_range_do_no_harm():
    """A tank on the axis along which it sloshes, and one whose damping may be beyond what is allowed."""
    _, log = recorded("tank")
    still = TANK.replace(position=[0.0, 0.0, 0.2], direction=[0.0, 0.0, 1.0], **TOLD)
    stiff = TANK.replace(damping=0.3, damping_std=0.5)
    sheet = SATELLITES["microsat"].replace(gyro_noise_std=1e-5, oscillators=[still, stiff])
    found = identify(log, sheet, window=80.0)
    assert all(parameter.determined and parameter.std > 0.0 for parameter in found.parameters)
    assert {"frequency of oscillator 1", "damping of oscillator 2"} <= {
        parameter.name for parameter in found.parameters
    }
