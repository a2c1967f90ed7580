"""Refusals of every policy that observes: observations that would become torque that is not finite."""

import itertools

import numpy as np
import pytest

from satid_gym import SatInertiaIDVectorEnv
from satid_gym.policies import find, make_baseline
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.policy import missions
from tests.cases import case


def torque_policy():
    """A network of one layer that commands the wheels at once."""
    weights = np.random.default_rng(0).standard_normal((3, 70)).astype(np.float32)
    return LearnedPolicy("torque", Network((weights,), (np.zeros(3, np.float32),)), "torque", 0.0, True)


POLICIES = {
    "generalist": lambda: find("generalist"),
    "torque": torque_policy,
    **{
        name: lambda name=name: make_baseline(name, "microsat")
        for name in ("rate_square", "greedy", "greedy_horizon", "mpc")
    },
}


@pytest.fixture(scope="module")
def begun():
    """Four episodes that have begun: their mission and first observations."""
    env = SatInertiaIDVectorEnv(4, include_covariance=True)
    observation, _ = env.reset(seed=0)
    return missions(env.problem)[0], observation


@pytest.mark.parametrize("name", POLICIES)
def test_an_observation_that_is_not_finite_is_refused_by_row_and_part(name, begun):
    mission, observation = begun
    parts = ("rate", "inertia", "correlation", "time_left", "state_correlation")
    for part, value in itertools.product(parts, (np.nan, np.inf, -np.inf)):
        policy = POLICIES[name]()
        policy.reset(mission, [0, 1, 2, 3])
        damaged = observation.copy()
        damaged[2, mission.layout[part].start] = value
        message = rf"episode rows \[2\] are not, in {part}: .*reset these episodes"
        with case((part, value)), pytest.raises(ValueError, match=message):
            policy(damaged)
        assert np.isfinite(policy(observation)).all()


def test_one_observation_without_a_row_is_refused(begun):
    mission, observation = begun
    message = r"take observations \(N, size\), one row an episode, got shape \(70,\)"
    for name, build in POLICIES.items():
        policy = build()
        policy.reset(mission, [0])
        with case(name), pytest.raises(ValueError, match=message):
            policy(observation[0])
