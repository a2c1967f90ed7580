"""Rate commands that spare panels and tanks: inside the limit, restored exactly, refused where none are told."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from agents.training.graph.export import graph
from agents.training.ppo import PPOSettings
from agents.training.sb3.switches import SwitchedVecEnv, reversed_sides, with_reversals
from agents.training.train import named
from baselines.scenarios.flights import Cell, flown
from satid_gym.control.mode_limit import ModeLimit
from satid_gym.control.rate_loop import RateMargin
from satid_gym.evaluation import seeds
from satid_gym.flightcode.policy_source import policy_source
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.policies.registry import build
from satid_gym.policy import missions, only_mission
from satid_gym.problem import problem
from satid_gym.sb3 import RateCommandVecEnv
from satid_gym.vector import SatInertiaIDVectorEnv

GIVEN = {"satellite": "microsat", "inertia": "static", "scenario": "slosh", "control": "rate", "observation": "body"}


def bent(spares: bool, scenario: str) -> tuple[float, float]:
    """Share of the time beyond the deflection limit under random sides, and mean size of the commands."""
    env = SatInertiaIDVectorEnv(8, **(GIVEN | {"scenario": scenario}))
    limit = (ModeLimit if spares else RateMargin)(missions(env.problem), 3.5)
    limit.assign(env.satellite_index)
    observation, _ = env.reset(seed=0)
    limit.assign(env.satellite_index)
    rng, cost, size = np.random.default_rng(1), [], []
    for decision in range(90):
        if decision % 3 == 0:
            sides = rng.choice([-1.0, 1.0], (8, 3))
        action = limit(observation, sides)
        observation, _, _, _, info = env.step(action)
        cost.append(info["costs"]["deflection"])
        size.append(np.abs(action).mean())
    env.close()
    return float(np.mean(cost)), float(np.mean(size))


@pytest.mark.parametrize("scenario", ["slosh", "flex"])
def test_random_sides_stay_inside_the_limit_and_still_turn(scenario):
    free, _ = bent(False, scenario)
    spared, size = bent(True, scenario)
    assert free > 0.1
    assert spared < 0.05
    assert size > 0.1


def test_a_restored_environment_goes_on_as_it_did():
    given = GIVEN | {"inertia": "random", "margin": 3.5, "spares_modes": True}
    env, other = RateCommandVecEnv(4, **given), RateCommandVecEnv(4, **given)
    env.seed(5)
    env.reset()
    other.seed(6)
    other.reset()
    sides = np.random.default_rng(2).choice([-1.0, 1.0], (12, 4, 3))
    for row in sides[:6]:
        env.step(row)
    other.restore(env.state())
    for row in sides[6:]:
        for found, expected in zip(other.step(row)[:3], env.step(row)[:3], strict=True):
            np.testing.assert_array_equal(found, expected)
    env.close()
    other.close()


def network(size: int) -> Network:
    weight = np.random.default_rng(3).standard_normal((3, size)).astype(np.float32)
    return Network((weight,), (np.zeros(3, np.float32),))


def test_a_policy_keeps_it_in_its_file_and_has_neither_c_nor_graph(tmp_path):
    posed = problem(**GIVEN)
    size = max(place.stop for place in posed.layout.values())
    LearnedPolicy("spares", network(size), "rate", 3.5, observation="body", spares_modes=True).save(tmp_path / "spares")
    policy = LearnedPolicy.load(tmp_path / "spares")
    assert policy.spares_modes
    with pytest.raises(ValueError, match="spares modes"):
        policy_source(SimpleNamespace(policy=policy))
    with pytest.raises(ValueError, match="spares modes"):
        graph(policy, only_mission(posed))


def test_it_is_refused_where_modes_are_not_observed():
    with pytest.raises(ValueError, match='observation="body"'):
        ModeLimit([only_mission(problem("microsat", "static", "slosh"))], 3.5)
    with pytest.raises(ValueError, match="--tracked"):
        PPOSettings(spares_modes=True)


def test_layers_of_reversals_turn_each_axis_to_the_other_side():
    rng = np.random.default_rng(4)
    shapes = [(8, 7), (6, 8), (3, 6)]
    weights = tuple(rng.standard_normal(shape).astype(np.float32) for shape in shapes)
    logits = Network(weights, tuple(rng.standard_normal(shape[0]).astype(np.float32) for shape in shapes))
    seen = rng.uniform(-1.0, 1.0, (400, 7))
    found, command = logits(seen), seen[:, 2:5]
    clear = (np.abs(found) > 0.3).all(axis=1) & (np.abs(np.abs(command) - 0.05) > 0.3).all(axis=1)
    assert clear.sum() > 20
    sides = reversed_sides(command, (found > 0.0).astype(int))
    np.testing.assert_array_equal(sides[clear], (np.sign(command) * -np.sign(found))[clear])
    np.testing.assert_allclose(with_reversals(logits, slice(2, 5))(seen)[clear], sides[clear], atol=2e-3)
    with pytest.raises(ValueError, match="3 outputs"):
        with_reversals(Network(weights[:2], logits.biases[:2]), slice(2, 5))


def test_reversals_that_are_always_made_are_a_square_wave():
    given = GIVEN | {"scenario": {"name": "default", "horizon": 20.0}, "margin": 3.5}
    env, other = SwitchedVecEnv(2, repeat=5, reversals=True, **given), RateCommandVecEnv(2, **given)
    for each in (env, other):
        each.seed(7)
        each.reset()
    for side in (-1.0, 1.0, -1.0):
        for _ in range(5):
            expected = other.step(np.tile(side * np.array([1.0, -1.0, 1.0]), (2, 1)))[0]
        np.testing.assert_array_equal(env.step(np.ones((2, 3), int))[0], expected)
    env.close()
    other.close()
    with pytest.raises(ValueError, match="--switches --tracked"):
        PPOSettings(reversals=True)


def test_settings_of_slosh_spare_its_tank():
    settings = named("slosh_ppo")
    assert settings.scenario == "slosh"
    assert settings.spares_modes


@pytest.mark.parametrize("inertia", ["static", "drift"])
def test_spared_square_expects_less_than_shaped_square_with_a_tank(inertia):
    cell = Cell(scenario="slosh", satellite="microsat", inertia=inertia)
    names = ("spared_square", "shaped_square")
    spared, shaped = (flown(cell, build(name, {}), seeds("validation", 8)) for name in names)
    assert spared.inside(0.01)
    assert spared.expected.mean() < shaped.expected.mean()
