"""Interface of Safety-Gymnasium: costs of each decision next to its reward, none lost or counted twice by autoreset."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from satid_gym import SatInertiaIDEnv, SatInertiaIDVectorEnv
from satid_gym.safety import SafetyEnv, SafetyVectorEnv
from tests.cases import cases

LIMITS = {"saturation": 0.02, "rate": 0.01}  # not in the order of info["costs"]
WORLD = {"satellite": "cubesat", "inertia": "static", "max_episode_steps": 8}
COUNT, SEED = 3, 7


def actions(episode):
    """Torque that turns some bodies beyond their limit before an episode's end, sooner in the second."""
    return np.outer([0.02, 0.1, 0.2], [1.0, -1.0, 1.0]) * (1.2 if episode else 0.8)


@pytest.fixture(scope="module")
def expected():
    """Costs (COUNT, 8, 2) of the first two episodes of each environment, flown alone without any wrapper."""
    costs = np.zeros((2, COUNT, 8, 2))
    for i in range(COUNT):
        env = SatInertiaIDEnv(**WORLD)
        env.reset(seed=SEED + i)
        for episode in range(2):
            for t in range(8):
                *_, terminated, truncated, info = env.step(actions(episode)[i])
                costs[episode, i, t] = [info["costs"][name] for name in LIMITS]
                assert (terminated, truncated) == (False, t == 7)
            env.reset()
    assert (costs[:, 2, -1] > 0).any(), "an end without costs would not show whether they are lost"
    return costs


def test_a_step_has_the_costs_with_limits_in_their_order(expected):
    env = SafetyEnv(gymnasium.make("SatInertiaID-v0", **{**WORLD, "max_episode_steps": 8}), LIMITS)
    env.reset(seed=SEED + 2)
    found = [env.step(actions(0)[2]) for t in range(8)]
    np.testing.assert_array_equal([step[2] for step in found], expected[0, 2])
    assert [step[4] for step in found] == [False] * 7 + [True]
    assert env.limits == LIMITS


def test_without_limits_the_cost_is_the_largest():
    env = SafetyEnv(SatInertiaIDEnv(**WORLD))
    env.reset(seed=SEED)
    for _ in range(8):
        *_, cost, _, _, info = env.step(actions(1)[2])
        assert cost == max(info["costs"].values())
    assert cost > 0


def native(mode):
    return SatInertiaIDVectorEnv(COUNT, autoreset_mode=mode, **WORLD)


def gymnasiums_own(mode):
    return SyncVectorEnv([lambda: SatInertiaIDEnv(**WORLD)] * COUNT, autoreset_mode=mode)


@cases("make", [native, gymnasiums_own])
@cases("mode", ["NextStep", "SameStep", "Disabled"])
def test_no_cost_is_lost_or_counted_twice(make, mode, expected):
    env = SafetyVectorEnv(make(AutoresetMode(mode)), LIMITS)
    env.reset(seed=SEED)
    for episode in range(2):
        for t in range(8):
            *_, costs, _, truncations, infos = env.step(actions(episode))
            np.testing.assert_array_equal(costs, expected[episode, :, t], f"decision {t} of episode {episode}")
            assert truncations.all() == (t == 7)
            assert ("final_observation" in infos) == (mode == "SameStep" and t == 7)
        if mode == "NextStep":  # the step that resets takes no decision
            *_, costs, _, _, _ = env.step(actions(episode))
            assert not costs.any()
        elif mode == "Disabled":
            env.reset(options={"reset_mask": np.ones(COUNT, bool)})
    env.close()


def test_only_those_that_end_have_costs_of_the_end():
    """With SAME_STEP and episodes that end one after another."""
    env = SafetyVectorEnv(SatInertiaIDVectorEnv(COUNT, autoreset_mode="SameStep", stagger=True, **WORLD))
    env.reset(seed=SEED)
    ends = 0
    for _ in range(20):
        *_, costs, terminations, truncations, infos = env.step(actions(1))
        assert not terminations.any()
        own = infos["cost"].copy()
        if truncations.any():
            ends += 1
            assert not own[truncations].any(), "of the next episode's start"
            own[truncations] = infos["final_info"]["cost"][truncations]
        np.testing.assert_array_equal(costs, own)
    assert ends >= 6
    env.close()


@cases(
    ("limits", "said"),
    [
        ({"rates": 0.1}, "unknown cost 'rates'"),
        ({"rate": 1.5}, "limit of cost 'rate' must be .* at most 1"),
        ({}, "limits must be a mapping"),
        (["rate"], "limits must be a mapping"),
    ],
)
def test_wrong_limits_are_refused(limits, said):
    for wrap, env in ((SafetyEnv, SatInertiaIDEnv()), (SafetyVectorEnv, SatInertiaIDVectorEnv(1))):
        with pytest.raises(ValueError, match=said):
            wrap(env, limits)


def test_an_environment_without_costs_is_refused():
    env = SafetyEnv(gymnasium.make("Pendulum-v1"))
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"info has no costs, only \[\]: expected SatInertiaIDEnv"):
        env.step(env.action_space.sample())
