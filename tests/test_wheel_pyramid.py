"""Scenario "wheels4": the wheels it gives its satellites, what their band of speed costs, and who knows of it."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.scenarios.flights import Cell, flown
from baselines.scenarios.oracle import search
from baselines.scenarios.plans.rates import RatesPlan, Recorder
from baselines.studies.worlds.satellites import PYRAMID
from satid_gym import SATELLITES, SCENARIOS, SatInertiaIDEnv, SatInertiaIDVectorEnv, WheelPyramid
from satid_gym.evaluation import seeds
from satid_gym.gym_api import COSTS
from satid_gym.policies.clear_square import ClearSquarePolicy
from satid_gym.policies.mpc import MPCPolicy
from satid_gym.policies.reference import ZeroPolicy
from satid_gym.problem import problem
from tests.cases import cases

WHEELS4 = SCENARIOS["wheels4"]
CELL = Cell(scenario="wheels4", satellite="microsat", inertia="static")
BAND = COSTS.index("avoided_band")


# wheels


@cases("name", ["cubesat", "microsat", "smallsat"])
def test_wheels_are_sized_for_the_body(name):
    """The momentum of a wheel at its limit, over that of the body about its largest axis at the rate limit."""
    bare = SATELLITES[name]
    (satellite,) = problem(name, scenario="wheels4").satellites
    wheels = satellite.wheels
    np.testing.assert_allclose(wheels.axes, PYRAMID, atol=1e-15)
    np.testing.assert_allclose(wheels.max_momentum, 1.6 * np.diag(bare.inertia).max() * bare.rate_limit)
    np.testing.assert_allclose(wheels.avoided_speed, (0.0, 0.05 * wheels.max_speed[0]))
    np.testing.assert_array_equal(wheels.max_torque, bare.wheels.max_torque[0])
    assert satellite == bare.replace(wheels=wheels)


def test_a_satellite_that_has_them_keeps_them():
    """A problem is built again from its own satellites, by reset or from its JSON."""
    own = problem("microsat", scenario="wheels4").satellites
    assert problem(list(own), scenario="wheels4").satellites == own


def test_the_rate_limit_of_the_scenario_counts():
    slow = WHEELS4.replace(rate_limit=0.01)
    (satellite,) = problem("microsat", scenario=slow).satellites
    np.testing.assert_allclose(satellite.wheels.max_momentum, 1.6 * 6.53 * 0.01)


def test_steep_wheels_turn_the_body_about_z():
    wheels = WheelPyramid(elevation=1.2).equip(SATELLITES["microsat"], 0.03).wheels
    np.testing.assert_allclose(wheels.axes[2], np.sin(1.2))
    assert wheels.torque_reach[2] > 2.0 * wheels.torque_reach[0]


@cases(
    ("settings", "message"),
    [
        ({"momentum": 0.0}, "momentum of the wheel pyramid must be"),
        ({"elevation": 1.6}, "elevation of the wheel pyramid, in rad, must be"),
        ({"avoided": (0.2, 0.1)}, r"avoided of the wheel pyramid must be \(low, high\) with 0 <= low"),
        ({"avoided": (0.0, 1.0)}, r"avoided of the wheel pyramid must be \(low, high\)"),
        ({"avoided": (0.1,)}, "avoided of the wheel pyramid must have shape"),
        ({"momentun": 1.0}, "momentun"),
    ],
)
def test_bad_settings_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        WHEELS4.replace(wheels=settings)


def test_what_is_no_pyramid_is_refused():
    with pytest.raises(ValueError, match="wheels must be WheelPyramid or a mapping of its settings, got 4"):
        WHEELS4.replace(wheels=4)


# its cost


def test_the_reward_has_the_share_of_time_in_the_band():
    """That its tachometers read, which without noise are true; the penalty is the difference that its weight makes."""
    found, exact = [], WHEELS4.replace(tachometer_noise_std=0.0)
    for weight in (0.0, 10.0):
        env = SatInertiaIDEnv("microsat", "static", exact, control="rate", reward={"avoided_band_weight": weight})
        env.reset(seed=3)
        steps = [env.step(np.float32([0.9, side * 0.9, 0.9])) for side in (1, 1, 1, 1, -1, -1, -1, -1)]
        found.append(([reward for _, reward, *_ in steps], [info["costs"]["avoided_band"] for *_, info in steps]))
    (free, share), (punished, again) = found
    assert share == again
    assert max(share) > 0.0
    np.testing.assert_allclose(np.subtract(free, punished), 10.0 * np.array(share), atol=1e-5)


def test_the_reward_knows_no_speed_but_what_is_read():
    """All speeds are in a band that is wide, and tachometers that are off by many times its width seldom say so."""
    rewards, shares = [], []
    for weight in (0.0, 10.0):
        env = SatInertiaIDVectorEnv(
            4, "microsat", "static", "wheels4", control="torque", reward={"avoided_band_weight": weight}
        )
        env.reset(seed=8)
        plants = env.fleet.rows.plants
        plants["avoided_speed"], plants["tachometer_noise_std"] = (0.0, 160.0), 3000.0
        _, reward, *_, info = env.step(np.zeros((4, 4), np.float32))
        rewards.append(reward)
        shares.append(info["costs"]["avoided_band"])
        env.close()
    assert (shares[0] == 1.0).all()
    penalty = rewards[0] - rewards[1]
    assert (penalty >= -1e-5).all()
    assert penalty.mean() < 7.0


def test_single_and_vector_environment_fly_the_same():
    """Any satellite, any law: costs and observations, to the last bit."""
    settings = {"satellite": "random", "scenario": "wheels4", "control": "rate"}
    actions = np.random.default_rng(2).uniform(-0.8, 0.8, (12, 4, 3)).astype(np.float32)
    vector = SatInertiaIDVectorEnv(4, **settings)
    vector.reset(seed=30)
    together = [vector.step(action) for action in actions]
    vector.close()
    for i in range(4):
        env = SatInertiaIDEnv(**settings)
        env.reset(seed=30 + i)
        for action, (observation, reward, *_, info) in zip(actions, together, strict=True):
            own, paid, *_, told = env.step(action[i])
            np.testing.assert_array_equal(own, observation[i])
            assert paid == reward[i]
            assert told["costs"]["avoided_band"] == info["costs"]["avoided_band"][i]


def test_at_rest_the_wheels_are_kept_out_of_it():
    """After the first seconds, in which null motion takes them out."""
    flight = flown(CELL, ZeroPolicy(), seeds("validation", 16))
    assert flight.inside(0.01)
    assert 0.3 < flight.nees.mean() < 2.0


# who knows of it


class Blind(MPCPolicy):
    """The planner that does not know of the band."""

    def reset(self, mission, seeds):
        super().reset(mission, seeds)
        self._planner._world = self._planner._world._replace(avoided=np.zeros(2))


def test_the_planner_keeps_wheels_out_of_the_band():
    plan = {"horizon": 20, "edits": 40, "margin": 3.5, "amplitude": 0.7}
    sees, blind = (flown(CELL, kind(**plan), seeds("validation", 12)) for kind in (MPCPolicy, Blind))
    assert sees.costs[:, BAND].mean() < 0.4 * blind.costs[:, BAND].mean()
    assert sees.expected.mean() < 1.6 * blind.expected.mean()


def test_a_recorded_flight_flies_the_same_again():
    recorder, episodes = Recorder(ClearSquarePolicy()), seeds("validation", 3)
    first, again = flown(CELL, recorder, episodes), flown(CELL, RatesPlan(recorder.rates), episodes)
    np.testing.assert_array_equal(first.expected, again.expected)


def test_the_oracle_expects_less_than_the_laws_it_begins_with():
    """Where a cost beyond its limit counts a hundredfold; and each episode by itself."""
    episodes = seeds("validation", 2)
    laws = flown(CELL, ClearSquarePolicy(), episodes)
    found = search(CELL, episodes, 0.01, population=24, rounds=3)
    worth = [f.expected * (1.0 + 100.0 * np.maximum(f.costs - 0.01, 0.0).max(axis=1)) for f in (found, laws)]
    assert (worth[0] < worth[1]).all()
    alone = search(CELL, episodes[1:], 0.01, population=24, rounds=3)
    np.testing.assert_array_equal(alone.expected, found.expected[1:])
