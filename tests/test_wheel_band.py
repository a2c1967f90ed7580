"""Tours of corners where wheels avoid a band of speed: ways across it and within, and what is observed of wheels."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.scenarios.flights import Cell, flown
from satid_gym import SATELLITES, SCENARIOS, SatInertiaIDEnv
from satid_gym.control.corners.wheel_band import WheelBand
from satid_gym.evaluation import seeds
from satid_gym.policies import find, make_baseline
from satid_gym.policy import missions
from satid_gym.problem import problem
from satid_gym.wheel_pyramid import WheelPyramid
from tests.cases import cases

SETTINGS = {"control": "rate", "observation": "body"}
CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
ROOM, AHEAD = 0.2, (0.0, 7.0 / 3.0, 14.0 / 3.0, 7.0)


@pytest.fixture(scope="module")
def mission():
    return missions(problem("microsat", "static", "wheels4", **SETTINGS))[0]


def sight(mission, rng):
    """Rates (3,), wheel momenta (4,) and the observation (1, size) of these, by the prior's inertia."""
    wheels = mission.satellite.wheels
    rate, held = rng.uniform(-1.0, 1.0, 3), rng.uniform(-0.5, 0.5, 4) * wheels.max_momentum
    null = wheels.null_direction
    parts = {
        "rate": rate,
        "wheel_momentum": wheels.axes @ held / wheels.momentum_reach,
        "control_authority": np.array([0.2, 0.25, 0.3]),
        "null_momentum": null @ held / (null @ null) / wheels.max_momentum.max(),
    }
    observation = np.zeros((1, max(place.stop for place in mission.layout.values())))
    for name, value in parts.items():
        observation[0, mission.layout[name]] = value
    return rate, held, observation


def inside(wheels, spin, room=0.0):
    """Whether wheels (..., n) of these momenta are in the band, and some room."""
    return (np.abs(spin) < wheels.inertia * wheels.avoided_speed[1] * (1.0 + room)).any(axis=-1)


def test_what_is_forecast_of_the_ways_is_what_wheels_do(mission):
    """By least squares for the wheels' shares and rotation matrices; z keeps where it is."""
    rng, wheels, craft = np.random.default_rng(3), mission.satellite.wheels, mission.satellite
    inertia, share = mission.prior.inertia, np.linalg.pinv(wheels.axes)
    smaller = clear = 0
    for _ in range(20):
        rate, held, observation = sight(mission, rng)
        band = WheelBand([mission])
        ways = band(observation, 0.9 * CORNERS[None])
        assert ways.corners.shape == (1, 16, 3)
        total = wheels.axes @ held + inertia @ rate * craft.rate_limit
        null = held - share @ wheels.axes @ held
        for way in range(16):
            corner, full = ways.corners[0, way], 0.9 * CORNERS[way % 8]
            assert np.linalg.norm(np.cross(corner, full)) < 1e-12
            path = rate + (np.arange(12) + 0.5)[:, None] / 12.0 * (corner - rate)
            spins = (total - craft.rate_limit * path @ inertia) @ share.T + null
            slew = np.max(np.abs(corner - rate) / [0.2, 0.25, 0.3])
            assert ways.crossing[0, way] == pytest.approx(inside(wheels, spins).mean() * slew, abs=1e-12)
            at = share @ (total - craft.rate_limit * inertia @ corner) + null
            if ways.stay[0, way] == 0.0:
                clear += 1
                assert not inside(wheels, at, ROOM)
            if way >= 8 and ways.stay[0, way] == 0.0:
                smaller += corner @ corner < ways.corners[0, way - 8] @ ways.corners[0, way - 8]
    assert clear > 100
    assert smaller > 20  # what crosses nothing ends before the band


def test_wheels_that_are_where_they_are_led_come_into_the_band_as_the_momentum_turns(mission):
    rng, wheels, craft = np.random.default_rng(4), mission.satellite.wheels, mission.satellite
    inertia, share, told = mission.prior.inertia, np.linalg.pinv(wheels.axes), set()
    for _ in range(40):
        rate, held, observation = sight(mission, rng)
        total = wheels.axes @ held + inertia @ rate * craft.rate_limit
        band = WheelBand([mission])
        band._null["reserve"] = -1e9  # more room counts for nothing, so that z keeps where it is
        held_null = held - share @ wheels.axes @ held
        ways = band(observation, CORNERS[None])
        for corner, stay in zip(ways.corners[0], ways.stay[0], strict=True):
            spins = [
                share
                @ (
                    Rotation.from_rotvec(craft.rate_limit * corner * t).inv().apply(total)
                    - craft.rate_limit * inertia @ corner
                )
                for t in AHEAD
            ]
            assert stay == pytest.approx(inside(wheels, np.array(spins) + held_null, ROOM).mean(), abs=1e-12)
            told.add(stay)
    assert {0.0} < told


def test_satellites_of_a_batch_have_the_ways_that_each_has_by_itself():
    batch = missions(problem(["cubesat", "smallsat"], "static", "wheels4", **SETTINGS))
    rng, flown_by = np.random.default_rng(5), np.array([1, 0, 1])
    seen = np.concatenate([sight(batch[i], rng)[2] for i in flown_by])
    corners = np.tile(CORNERS, (3, 1, 1))
    together = WheelBand(batch)
    together.assign(flown_by)
    ways = together(seen, corners)
    for k, i in enumerate(flown_by):
        alone = WheelBand([batch[i]])(seen[k : k + 1], corners[:1])
        for part, own in zip(ways, alone, strict=True):
            np.testing.assert_array_equal(part[k], own[0])


def test_null_momentum_is_observed_in_the_body_frame():
    env = SatInertiaIDEnv("microsat", scenario="wheels4", **SETTINGS)
    other = SatInertiaIDEnv("microsat", scenario="wheels4", control="rate")
    seen, _ = env.reset(seed=3)
    speeds = other.reset(seed=3)[0][other.layout["wheel_speed"]]
    wheels = other.problem.satellites[0].wheels
    held = wheels.inertia * wheels.max_speed * speeds
    null = np.linalg.svd(wheels.axes)[2][3]
    expected = null * (null @ held) / (wheels.null_direction * wheels.max_momentum.max())
    np.testing.assert_allclose(seen[env.layout["null_momentum"]], expected[0], rtol=1e-5)
    assert "null_momentum" not in other.layout
    assert "null_momentum" not in SatInertiaIDEnv("microsat", observation="body").layout


def test_satellites_with_a_band_and_without_are_not_observed_together():
    world = SCENARIOS["wheels4"].wheels
    with_band = world.equip(SATELLITES["microsat"]).replace(name="with")
    without = WheelPyramid(avoided=(0.0, 0.0)).equip(SATELLITES["microsat"]).replace(name="without")
    with pytest.raises(
        ValueError,
        match=r"avoid a band of speed or none.*those of with, without differ; give scenario wheels",
    ):
        problem([with_band, without], "static", **SETTINGS)
    problem([with_band, without], "static", control="rate")


def test_a_tour_by_the_band_needs_one():
    with pytest.raises(ValueError, match=r'null momentum is not observed: take a scenario .* "wheels4"'):
        find("clear_tour").reset(missions(problem("microsat", "static", **SETTINGS))[0], [0])


def test_a_tour_by_the_band_knows_no_panels():
    both = missions(problem("microsat", "static", SCENARIOS["flex"].replace(wheels={}), **SETTINGS))[0]
    with pytest.raises(ValueError, match="spares panels and tanks or keeps wheels out of a band, not both yet"):
        WheelBand([both])


@cases("satellite", ["cubesat", "microsat", "smallsat"])
def test_the_learned_tour_keeps_clear_of_the_band_and_learns_more_than_the_law(satellite):
    """Validation seeds; docs/training.md has the figures of all cells."""
    cell, those = Cell(scenario="wheels4", satellite=satellite, inertia="static"), seeds("validation", 16)
    learned = flown(cell, find("clear_tour"), those)
    law = flown(cell, make_baseline("clear_square", satellite, "wheels4"), those)
    assert learned.inside(0.01)
    assert learned.expected.mean() < 0.8 * law.expected.mean()
    assert 0.3 < learned.nees.mean() < 2.0
