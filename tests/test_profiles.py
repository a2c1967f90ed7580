"""Profiles: values worked out by hand, the paper's amplitudes, and the way to the wheels."""

import numpy as np
import pytest
import scipy.signal

from satid_gym.profiles import PAPER_AMPLITUDES, PROFILES, paper_torque, prbs, wheel_torque
from satid_gym.reaction_wheels import ReactionWheels
from satid_gym.satellite import SATELLITES
from tests.cases import cases

SECONDS = np.arange(0.0, 300.0, 0.25)


def at(name, *times, **settings):
    return PROFILES[name](np.array(times, dtype=float), **settings)


def test_the_eight_have_the_names_of_the_paper():
    assert list(PROFILES) == [
        "one_step", "multi_step", "sawtooth", "sine", "multi_sine", "prbs", "chirp", "sine_3axis",
    ]  # fmt: skip


@cases("name", PROFILES)
def test_unit_amplitude(name):
    signal = PROFILES[name](SECONDS)
    assert signal.shape == (len(SECONDS), 3)
    assert 0.85 < np.abs(signal).max() <= 1.0  # the tones of multi_sine never crest together


@cases(
    ("name", "times", "values"),
    [
        ("one_step", [0, 99.9, 100, 299], [1, 1, 0, 0]),
        ("multi_step", [0, 49.9, 50, 125, 175, 225, 275, 300, 400], [1, 1, -1, 0, 1, -1, 0, 0, 0]),
        ("sawtooth", [0, 25, 49, 50, 75, 100], [0, 0.5, 0.98, -1, -0.5, 0]),
        ("sine", [0, 25, 50, 75], [0, 1, 0, -1]),
    ],
)
def test_values_on_every_axis(name, times, values):
    np.testing.assert_allclose(at(name, *times), np.repeat(np.array(values, float)[:, None], 3, axis=1), atol=1e-12)


def test_steps_scale_with_the_horizon():
    np.testing.assert_array_equal(at("one_step", 9, 10, horizon=30.0)[:, 0], [1, 0])
    np.testing.assert_array_equal(at("multi_step", 4, 5, 10, 15, 30, horizon=30.0)[:, 0], [1, -1, 0, 1, 0])


def test_chirp_is_scipys():
    expected = scipy.signal.chirp(SECONDS, 0.005, 120.0, 0.05, method="linear")
    np.testing.assert_allclose(PROFILES["chirp"](SECONDS, horizon=120.0)[:, 1], expected, atol=1e-9)


def test_multi_sine_in_newton_metres():
    torque = PAPER_AMPLITUDES["multi_sine"] * at("multi_sine", 0.0, 50.0)
    np.testing.assert_allclose(torque[0], [0.0, 0.009 * 0.70710678, -0.008 * 0.86602540], atol=1e-9)
    # x after 50 s: 0.1 and 0.25 cycles
    assert torque[1, 0] == pytest.approx(0.010 * np.sin(np.deg2rad(36.0)) + 0.007)


def test_sine_3axis_ratios():
    np.testing.assert_allclose(at("sine_3axis", 25.0)[0], [1.0, 0.5, 5.0 / 6.0])


def test_prbs_holds_its_signs_and_keeps_them_when_flown_longer():
    signal = prbs(SECONDS, seed=3)
    assert set(np.unique(signal)) == {-1.0, 1.0}
    changed = SECONDS[1:][np.any(np.diff(signal, axis=0) != 0.0, axis=1)]
    assert len(changed) > 5
    np.testing.assert_array_equal(changed % 20.0, 0.0)
    np.testing.assert_array_equal(prbs(SECONDS[:200], seed=3), signal[:200])
    assert not np.array_equal(prbs(SECONDS, seed=4), signal)
    assert not np.array_equal(signal[:, 0], signal[:, 1])


def test_wheels_put_the_torque_on_the_body_with_least_effort():
    axes = np.array([[1, -1, 0, 0], [0, 0, 1, -1], [1, 1, 1, 1]]) / np.sqrt(2.0)
    wheels = ReactionWheels(axes=axes, inertia=1e-3, max_torque=0.1, max_speed=500.0)
    body = np.random.default_rng(0).normal(size=(5, 3))
    motor = wheel_torque(body, wheels)
    np.testing.assert_allclose(-motor @ axes.T, body, atol=1e-12)
    null = np.array([1.0, 1.0, -1.0, -1.0])  # A null = 0, so least norm has none of it
    np.testing.assert_allclose(axes @ null, 0.0, atol=1e-12)
    np.testing.assert_allclose(motor @ null, 0.0, atol=1e-12)


@cases(
    ("profile", "satellite", "largest"),
    [
        ("one_step", "cubesat", [0.01, 0.01, 0.01]),  # 0.015 N m cut to the limit
        ("one_step", "microsat", [0.075, 0.075, 0.075]),
        ("sine", "smallsat", [0.0985, 0.0985, 0.0985]),
        ("sine_3axis", "microsat", [0.1, 0.075, 0.1]),  # 0.15, 0.075, 0.125 N m cut
    ],
)
def test_paper_amplitudes(profile, satellite, largest):
    torque = paper_torque(profile, SATELLITES[satellite], SECONDS)
    np.testing.assert_allclose(np.abs(torque).max(axis=0), largest, rtol=1e-12)
    assert torque[np.argmax(SECONDS == 25.0), 0] < 0.0  # the body feels -u


def test_what_the_paper_does_not_have():
    with pytest.raises(ValueError, match=r"unknown profile 'sin'.*Did you mean 'sine'"):
        paper_torque("sin", SATELLITES["cubesat"], SECONDS)
    with pytest.raises(ValueError, match="unknown satellite of the paper 'other'"):
        paper_torque("sine", SATELLITES["cubesat"].replace(name="other"), SECONDS)
