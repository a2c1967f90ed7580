"""The vector environment: equal to the single one, whatever their number, the threads and the autoreset mode."""

from __future__ import annotations

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from satid_gym import SatInertiaIDEnv, SatInertiaIDVectorEnv
from satid_gym.gym_api import INFO_KEYS
from tests.cases import cases

HORIZON = 7  # decisions an episode: several autoresets in every flight
STEPS = 24
SETTINGS = {"satellite": "random", "max_episode_steps": HORIZON}
MODES = list(AutoresetMode)


def actions(step: int, count: int) -> np.ndarray:
    """Of environment i, whatever the number of environments: smooth, and wild enough to terminate some."""
    phase = 0.37 * step + np.arange(count)[:, None] + np.arange(3)
    strength = np.where(np.arange(count) % 5 == 0, 1.0, 0.1)[:, None]
    return (strength * np.sin(phase)).astype(np.float32)


@pytest.fixture(scope="module")
def singles() -> list[list]:
    """64 single environments, each flown by hand in NEXT_STEP's way: (observation, reward, ends, info) a step."""
    flights = []
    for i in range(64):
        env = SatInertiaIDEnv(**SETTINGS)
        observation, info = env.reset(seed=100 + i)
        flight, over = [(observation, 0.0, False, False, info)], False
        for step in range(STEPS):
            if over:
                observation, info = env.reset()
                flight.append((observation, 0.0, False, False, info))
                over = False
            else:
                flight.append(env.step(actions(step, i + 1)[i]))
                over = flight[-1][2] or flight[-1][3]
        flights.append(flight)
    return flights


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("count", [1, 2, 64, 1000])
@pytest.mark.compiled
def test_environment_i_equals_the_single_one_seeded_s_plus_i(count, threads, singles):
    env = SatInertiaIDVectorEnv(count, **SETTINGS, num_threads=threads)
    observation, info = env.reset(seed=100)
    steps = [(observation, np.zeros(count), np.zeros(count, bool), np.zeros(count, bool), info)]
    steps += [env.step(actions(step, count)) for step in range(STEPS)]
    env.close()
    ends = 0
    for t, (observations, rewards, terminations, truncations, infos) in enumerate(steps):
        for i in range(min(count, 64)):
            observation, reward, terminated, truncated, info = singles[i][t]
            np.testing.assert_allclose(observations[i], observation, rtol=0, atol=1e-9)
            assert rewards[i] == pytest.approx(reward, abs=1e-9)
            assert (terminations[i], truncations[i]) == (terminated, truncated)
            for key in INFO_KEYS:
                if key == "costs":
                    found = {name: infos[key][name][i] for name in info[key]}
                    assert found == pytest.approx(info[key], rel=1e-9, abs=1e-12)
                else:
                    np.testing.assert_allclose(infos[key][i], info[key], rtol=1e-9, atol=1e-12, err_msg=key)
            ends += terminated or truncated
    assert ends >= 3 * min(count, 64)


@pytest.mark.compiled
def test_a_thousand_are_the_same_on_two_threads():
    flights = []
    for threads in (1, 2):
        env = SatInertiaIDVectorEnv(1000, **SETTINGS, num_threads=threads)
        observation, _ = env.reset(seed=0)
        flights.append([observation] + [x for step in range(STEPS) for x in env.step(actions(step, 1000))[:4]])
        env.close()
    for one, other in zip(*flights, strict=True):
        np.testing.assert_array_equal(one, other)


def assert_same_infos(own: dict, expected: dict) -> None:
    assert sorted(own) == sorted(expected)
    for key, value in expected.items():
        if key == "final_info":
            assert_same_infos(own[key], value)
        elif key == "final_obs":
            for a, b in zip(own[key], value, strict=True):
                assert (a is None) == (b is None)
                if a is not None:
                    np.testing.assert_array_equal(a, b)
        elif key == "costs":  # by name
            assert_same_infos(own[key], value)
        else:
            assert own[key].shape == value.shape, key
            assert own[key].dtype.kind == value.dtype.kind, key
            np.testing.assert_allclose(own[key], value, rtol=1e-12, err_msg=key)


@pytest.mark.parametrize("more", [{}, {"include_covariance": True}], ids=["", "include_covariance"])
@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_autoreset_is_gymnasiums(mode, more):
    """The same flights in Gymnasium's own vector of single environments: every array and info key of every step."""
    count, settings = 6, SETTINGS | more
    own = SatInertiaIDVectorEnv(count, **settings, autoreset_mode=mode)
    sync = SyncVectorEnv([lambda: SatInertiaIDEnv(**settings)] * count, autoreset_mode=mode)
    assert own.metadata["autoreset_mode"] is sync.metadata["autoreset_mode"] is mode
    assert own.observation_space == sync.observation_space
    assert own.action_space == sync.action_space
    assert own.single_observation_space == sync.single_observation_space
    (a, own_info), (b, sync_info) = own.reset(seed=42), sync.reset(seed=42)
    np.testing.assert_array_equal(a, b)
    assert_same_infos(own_info, sync_info)
    terminated = truncated = 0
    for step in range(40):
        one, other = own.step(actions(step, count)), sync.step(actions(step, count))
        for x, y in zip(one[:4], other[:4], strict=True):
            assert x.dtype == y.dtype
            np.testing.assert_allclose(x, y, rtol=0, atol=1e-12)
        assert_same_infos(one[4], other[4])
        over = one[2] | one[3]
        terminated, truncated = terminated + one[2].sum(), truncated + one[3].sum()
        if mode is AutoresetMode.DISABLED and over.any():
            a, own_info = own.reset(options={"reset_mask": over.copy()})
            b, sync_info = sync.reset(options={"reset_mask": over.copy()})
            np.testing.assert_array_equal(a, b)
            assert_same_infos(own_info, sync_info)
    assert terminated > 0
    assert truncated > 10


def test_make_vec_and_vector_wrappers():
    env = gymnasium.make_vec("SatInertiaID-v0", num_envs=4, **SETTINGS)
    env = gymnasium.wrappers.vector.RecordEpisodeStatistics(env)
    env.reset(seed=0)
    total = np.zeros(4)
    for step in range(HORIZON):
        _, reward, terminated, truncated, info = env.step(actions(step + 1, 4) * 0.1)
        total += reward
        assert not terminated.any()
    assert truncated.all()
    np.testing.assert_allclose(info["episode"]["r"], total)


def test_mode_and_seed_of_each_environment():
    env = SatInertiaIDVectorEnv(3, autoreset_mode="SameStep")
    assert env.autoreset_mode is AutoresetMode.SAME_STEP
    env.reset(seed=[7, 7, 9])
    assert env.np_random_seed == (7, 7, 9)
    a, _ = env.reset(seed=5)
    assert env.np_random_seed == (5, 6, 7)
    one, _ = SatInertiaIDVectorEnv(2).reset(seed=[6, 5])
    np.testing.assert_array_equal(one, a[[1, 0]])


def test_masked_reset_leaves_the_others_alone():
    env = SatInertiaIDVectorEnv(4, autoreset_mode="Disabled")
    twin = SatInertiaIDVectorEnv(4, autoreset_mode="Disabled")
    for e in (env, twin):
        e.reset(seed=0)
        for step in range(5):
            e.step(actions(step + 1, 4) * 0.1)
    mask = np.array([False, True, False, False])
    _, infos = env.reset(options={"reset_mask": mask, "satellite": "cubesat"})
    assert infos["_time"].tolist() == mask.tolist()
    assert infos["time"].tolist() == [0.0] * 4
    one, other = env.step(actions(6, 4) * 0.1), twin.step(actions(6, 4) * 0.1)
    np.testing.assert_array_equal(one[0][~mask], other[0][~mask])
    assert (one[0][mask] != other[0][mask]).any()


def test_stagger_spreads_the_first_ends():
    env = SatInertiaIDVectorEnv(10, max_episode_steps=10, stagger=True, autoreset_mode="SameStep")
    env.reset(seed=0)
    truncations = np.array([env.step(np.zeros((10, 3)))[3] for _ in range(20)])
    assert truncations.sum(axis=1).tolist() == [1] * 20
    assert (truncations.sum(axis=0) == 2).all()


@pytest.mark.parametrize("copy_of", [copy.deepcopy, lambda e: pickle.loads(pickle.dumps(e))], ids=["copy", "pickle"])
@pytest.mark.parametrize("count", [3, 64])
@pytest.mark.compiled
def test_a_copy_in_mid_flight_goes_on_as_the_original(copy_of, count):
    env = SatInertiaIDVectorEnv(count, **SETTINGS, num_threads=2)
    env.reset(seed=0)
    for step in range(5):
        env.step(actions(step, count))
    twin = copy_of(env)
    for step in range(5, 20):
        for x, y in zip(env.step(actions(step, count))[:4], twin.step(actions(step, count))[:4], strict=True):
            np.testing.assert_array_equal(x, y)
    env.close()
    twin.close()


def test_what_is_returned_is_a_copy():
    env = SatInertiaIDVectorEnv(3, max_episode_steps=2, autoreset_mode="SameStep")
    first, infos = env.reset(seed=0)
    kept, kept_time = first.copy(), infos["time"].copy()
    one = env.step(actions(1, 3) * 0.1)
    two = env.step(actions(2, 3) * 0.1)
    env.step(actions(3, 3) * 0.1)
    np.testing.assert_array_equal(first, kept)
    np.testing.assert_array_equal(infos["time"], kept_time)
    np.testing.assert_allclose(one[4]["time"], 1.0)
    np.testing.assert_allclose(two[4]["final_info"]["time"], 2.0)
    assert not np.shares_memory(two[0], two[4]["final_obs"][0])


# Refusals change nothing


@pytest.fixture
def flying() -> SatInertiaIDVectorEnv:
    env = SatInertiaIDVectorEnv(4, estimator="adaptive")
    env.reset(seed=0)
    env.step(actions(1, 4) * 0.1)
    return env


def state_of(env: SatInertiaIDVectorEnv) -> bytes:
    records = env.fleet.rows
    generators = [g.bit_generator.state for g in env.np_random]
    return b"".join(record.tobytes() for record in records) + repr((generators, env.np_random_seed)).encode()


@cases(
    ("wrong", "message"),
    [
        (np.zeros((4, 2)), r"actions must have shape \(4, 3\), got \(4, 2\)"),
        (np.zeros((3, 3)), r"actions must have shape \(4, 3\), got \(3, 3\)"),
        (np.zeros(3), r"actions must have shape \(4, 3\), got \(3,\)"),
        (np.where(np.eye(4, 3) > 0, np.nan, 0.0), r"actions must be finite; rows \[0, 1, 2\] are not"),
        (np.full((4, 3), np.inf), r"actions must be finite; rows \[0, 1, 2, 3\] are not"),
    ],
)
def test_bad_actions_are_refused(wrong, message, flying):
    before = state_of(flying)
    with pytest.raises(ValueError, match=message):
        flying.step(wrong)
    assert state_of(flying) == before


@cases(
    ("arguments", "message"),
    [
        ({"seed": [1, 2, 3]}, "seed must be one number or 4 of them, got 3"),
        ({"options": {"mask": 1}}, "unknown reset option 'mask'"),
        ({"options": {"reset_mask": np.ones(3, bool)}}, r"boolean array of shape \(4,\) .* got bool \(3,\)"),
        ({"options": {"reset_mask": np.ones(4)}}, r"boolean array of shape \(4,\) .* got float64 \(4,\)"),
        ({"options": {"reset_mask": np.zeros(4, bool)}}, "at least one True"),
        ({"options": {"satellite": "cubsat"}}, "Did you mean 'cubesat'"),
        ({"options": {"true_inertia": (1.0, 1.0, 5.0)}}, "triangle inequality"),
    ],
)
def test_a_bad_reset_is_refused(arguments, message, flying):
    before = state_of(flying)
    with pytest.raises(ValueError, match=message):
        flying.reset(**{"seed": 1} | arguments)
    assert state_of(flying) == before


@cases("seed", [-1, [1, 2, -3, 4], [1, 2, 3, 4.5]])
def test_a_bad_seed_is_refused(seed, flying):
    before = state_of(flying)
    with pytest.raises(gymnasium.error.Error, match=r"[Ss]eed must be"):
        flying.reset(seed=seed)
    assert state_of(flying) == before


def test_the_layout_is_that_of_one_environment():
    settings = {"observation": "body", "include_covariance": True, "scenario": "flex"}
    assert SatInertiaIDVectorEnv(2, **settings).layout == SatInertiaIDEnv(**settings).layout


def test_step_before_reset_and_after_the_end():
    env = SatInertiaIDVectorEnv(2, max_episode_steps=1, autoreset_mode="Disabled")
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"call reset\(\) before step"):
        env.step(np.zeros((2, 3)))
    env.reset(seed=0)
    env.step(np.zeros((2, 3)))
    before = state_of(env)
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"episodes \[0, 1\] are over: .*reset_mask"):
        env.step(np.zeros((2, 3)))
    assert state_of(env) == before


def test_reset_options_do_not_outlive_their_episodes():
    env = SatInertiaIDVectorEnv(3, "microsat", max_episode_steps=2)
    _, info = env.reset(seed=0, options={"satellite": "cubesat", "true_inertia": (0.3, 0.28, 0.2)})
    np.testing.assert_allclose(info["inertia_true"], np.diag([0.3, 0.28, 0.2])[None].repeat(3, axis=0))
    for _ in range(3):
        *_, info = env.step(np.zeros((3, 3)))
    assert info["time"].tolist() == [0.0, 0.0, 0.0]
    assert (info["inertia_true"][:, 0, 0] > 3.0).all(), "microsats again"


@pytest.mark.compiled
@pytest.mark.parametrize("threads", [1, 2])
def test_two_threads_in_one_vector_are_told_so(threads):
    env = SatInertiaIDVectorEnv(512, "microsat", num_threads=threads)
    env.reset(seed=0)

    def fly(_):
        refused = []
        for _ in range(100):
            try:
                env.step(np.zeros((512, 3), np.float32))
            except RuntimeError as error:
                refused.append(str(error))
        return refused

    with ThreadPoolExecutor(2) as pool:
        refused = [text for texts in pool.map(fly, range(2)) for text in texts]
    assert refused
    assert {text.split(":")[0] for text in refused} == {
        "two threads are in reset() or step() of one vector environment at once"
    }
    env.step(np.zeros((512, 3), np.float32))  # one at a time goes on
    with pytest.raises(ValueError, match="must have shape"):
        env.step(np.zeros((1, 3), np.float32))
    env.step(np.zeros((512, 3), np.float32))  # what was refused has let go of it
