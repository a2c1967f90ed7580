"""Scale of the gyro by the attitude: found, with a spread as it says, and counted where the data sheet denies it."""

import dataclasses
import functools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.identification.coverage import distances
from baselines.identification.recorded import CUBESAT, drawn, motion
from satid_gym.identification import identify
from satid_gym.identification.gyro_scale import gyro_scale
from satid_gym.telemetry import Log
from satid_gym.tolerances import Tolerances

SCALE = np.array([0.02, -0.01, 0.005])


@functools.cache
def flown():
    rng = np.random.default_rng(3)
    truth = drawn(CUBESAT, rng)
    return truth, motion(truth, rng, 300.0)


def log(scale, attitude_std=0.0, gyro_std=0.0, bias=0.0, seed=0, every=10):
    """Readings at every so many tenths of a second."""
    rng, (_, flight) = np.random.default_rng([seed, 4]), flown()
    rate, size = flight.omega[::every], (len(flight.time[::every]), 3)
    tilt = Rotation.from_rotvec(attitude_std * rng.standard_normal(size))
    return Log(
        time=flight.time[::every],
        rate=(1.0 + np.asarray(scale)) * rate + bias + gyro_std * rng.standard_normal(size),
        wheel_speed=flight.wheel_speed[::every] + 0.1 * rng.standard_normal(flight.wheel_speed[::every].shape),
        attitude=(Rotation.from_quat(flight.attitude[::every]) * tilt).as_quat(),
    )


def test_without_noise_it_is_exact_to_second_order_with_any_bias():
    found = gyro_scale([log(SCALE, bias=1e-4)], np.zeros(1))
    np.testing.assert_allclose(found.error, SCALE, atol=2e-4)


def test_its_errors_are_as_large_as_it_says():
    """Attitudes good to a milliradian, over twenty draws of the noise."""
    found = [gyro_scale([log(SCALE, 1e-3, 1e-4, seed=seed, every=1)], np.zeros(1)) for seed in range(20)]
    z = np.array([(one.error - SCALE) / one.std for one in found])
    assert (np.abs(z.mean(axis=0)) < 0.6).all()
    assert 0.75 < np.sqrt(np.mean(z**2)) < 1.35


def test_attitudes_that_are_far_off_hardly_count():
    bad = log(SCALE, 1e-3, 1e-4)
    attitude = bad.attitude.copy()
    attitude[::97] = [0.0, 0.0, 0.0, 1.0]
    found = gyro_scale([dataclasses.replace(bad, attitude=attitude)], np.zeros(1))
    assert (np.abs(found.error - SCALE) < 4.0 * found.std).all()
    assert found.std.max() < 5e-3


def test_a_scale_that_the_data_sheet_denies_is_told_and_counted():
    """A gyro that is 1 % off gives an inertia that is 1 % off: without the attitude that is in no interval."""
    truth, _ = flown()
    off = log([0.01] * 3, 1e-3, 1e-4)
    with_attitude, without = identify(off, CUBESAT), identify(dataclasses.replace(off, attitude=None), CUBESAT)
    (note,) = [one for one in with_attitude.notes if "by the attitude" in one]
    assert "data sheet's tolerance is 0 %" in note
    told, untold = (np.abs(distances(found, truth)[0][:3]) for found in (with_attitude, without))
    print(f"moments are {told.max():.1f} standard deviations off, else {untold.min():.1f} to {untold.max():.1f}")
    assert told.max() < 2.0
    assert untold.min() > 3.0
    readings = {p.name: p for p in with_attitude.parameters}
    for axis in "xyz":
        scale = readings[f"gyro reading over rate about {axis}"]
        assert abs(scale.value - 1.01) < 4.0 * scale.std < 0.01
    assert not [p for p in without.parameters if "gyro" in p.name]


@pytest.mark.parametrize("tolerance", [0.02, 0.0])
def test_a_scale_within_the_data_sheet_is_no_contradiction(tolerance):
    satellite = CUBESAT.replace(tolerances=Tolerances(gyro_scale=tolerance))
    found = gyro_scale([log([0.01 if tolerance > 0.0 else 0.0] * 3, 1e-3, 1e-4)], np.zeros(1))
    assert found.notes(satellite) == []
    np.testing.assert_array_equal(found.contradiction(satellite), np.zeros(3))


@pytest.mark.parametrize("attitude_std", [None, 0.03], ids=["none", "poor"])
def test_logs_without_an_attitude_that_is_good_enough_tell_nothing(attitude_std):
    """An attitude filter that is good to two degrees would tell of a scale to 1 %."""
    own = log(SCALE, attitude_std or 0.0)
    found = gyro_scale([own if attitude_std else dataclasses.replace(own, attitude=None)], np.zeros(1))
    assert found.parameters() == found.notes(CUBESAT) == []
    assert np.isinf(found.std).all()
