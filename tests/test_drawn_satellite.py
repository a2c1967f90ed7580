"""Satellites drawn at random: physical, within their ranges, repeatable, and flown by the environments."""

from __future__ import annotations

import numpy as np
import pytest

import satid_gym
from satid_gym.drawn_satellite import SatelliteRanges, draw_satellite, draw_satellites

RANGES = SatelliteRanges()
DRAWN = draw_satellites(range(400))
RELATIVE = {
    "gyro_noise": lambda s: s.gyro_noise_std / s.rate_limit,
    "tachometer_noise": lambda s: s.tachometer_noise_std / s.wheels.max_speed[0],
    "disturbance": lambda s: s.disturbance_std / s.wheels.max_torque[0],
    "rate_limit": lambda s: s.rate_limit,
    "wheel_speed": lambda s: s.wheels.max_speed[0],
    "inertia": lambda s: np.linalg.det(s.inertia) ** (1.0 / 3.0),
    "density": lambda s: s.mass / np.prod(s.size),
    "authority": lambda s: _reach(s, s.wheels.max_torque),
    "momentum": lambda s: _reach(s, s.wheels.inertia * s.wheels.max_speed),
}


def _reach(satellite, each):
    """Torque or momentum of the wheels along the principal axis that has least, over moment times rate limit."""
    moments, principal = np.linalg.eigh(satellite.inertia)
    return np.min(np.abs(principal.T @ satellite.wheels.axes) @ each / (moments * satellite.rate_limit))


@pytest.mark.parametrize("name", RELATIVE)
def test_what_is_drawn_fills_its_range(name):
    low, high = getattr(RANGES, name)
    values = np.array([RELATIVE[name](satellite) for satellite in DRAWN])
    assert values.min() >= low * (1.0 - 1e-9)
    assert values.max() <= high * (1.0 + 1e-9)
    # of 400 draws the ends come within a tenth of the range, but where gyroscopic torque forbids a corner
    span = np.log(high / low)
    assert np.log(values.min() / low) < 0.2 * span
    assert np.log(high / values.max()) < 0.2 * span


def test_satellites_are_physical_and_can_hold_their_rates():
    for satellite in DRAWN:
        moments = np.linalg.eigvalsh(satellite.inertia)
        assert moments[0] > 0.0
        assert moments[0] + moments[1] >= moments[2] * (1.0 - 1e-9)
        wheels = satellite.wheels
        assert satellite.rate_limit * wheels.inertia[0] * wheels.max_speed[0] <= wheels.max_torque[0] * (1.0 + 1e-9)
        assert np.linalg.matrix_rank(wheels.axes, tol=0.05) == 3
        if wheels.count > 3:  # whichever is lost
            for i in range(wheels.count):
                assert np.linalg.matrix_rank(np.delete(wheels.axes, i, axis=1), tol=0.05) == 3


def test_wheels_and_principal_axes_are_spread():
    assert {satellite.wheels.count for satellite in DRAWN} == set(range(3, 9))
    first = np.array([np.abs(np.linalg.eigh(satellite.inertia)[1][:, 0]) for satellite in DRAWN])
    # a direction drawn evenly on the sphere has a component of 1/2 in the mean, of variance 1/12
    np.testing.assert_allclose(first.mean(axis=0), 0.5, atol=4.0 * np.sqrt(1.0 / 12.0 / len(DRAWN)))


def test_a_seed_gives_one_satellite():
    again = draw_satellites([3, 5])
    assert again[0] == DRAWN[3]
    assert again[1] == DRAWN[5]
    assert again[0] != again[1]
    assert [satellite.name for satellite in again] == ["drawn_3", "drawn_5"]
    assert draw_satellites([3], RANGES.replace(inertia=(1.0, 1.0)))[0] != again[0]


def test_satellites_of_one_number_of_wheels_share_an_environment():
    satellites = draw_satellites(range(5), wheels=3)
    env = satid_gym.SatInertiaIDVectorEnv(16, satellite=satellites, control="rate", observation="body")
    observations, _ = env.reset(seed=0)
    assert len(set(env.satellite_index)) > 1
    for _ in range(5):
        observations, *_ = env.step(np.full((16, 3), 0.5, np.float32))
    assert np.isfinite(observations).all()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"wheels": (2, 8)}, "3 <= low <= high <= 8"),
        ({"wheels": (5, 4)}, "got \\(5, 4\\)"),
        ({"inertia": (1.0, 0.1)}, "inertia of drawn satellites must be \\(low, high\\)"),
        ({"authority": (0.0, 1.0)}, "authority of drawn satellites"),
        ({"gyroscopic": 0.0}, "gyroscopic of drawn satellites"),
    ],
)
def test_ranges_that_are_none_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        SatelliteRanges(**settings)


def test_limits_that_no_satellite_can_hold_are_refused():
    ranges = SatelliteRanges(rate_limit=(0.1, 0.2), momentum=(10.0, 20.0), authority=(0.01, 0.02))
    with pytest.raises(ValueError, match="never gave enough torque"):
        draw_satellite(np.random.default_rng(0), ranges)
