"""Seeds: which ones are really drawn by training, tuning, validation and test, and that their streams differ."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from gymnasium.utils import seeding

from agents.training import ppo
from agents.training.ppo import PPOSettings
from agents.training.run import Run
from baselines.tuning import amplitudes
from satid_gym import SATELLITES, SatInertiaIDVectorEnv
from satid_gym.evaluation import FIRST_SEED, SPLIT_SIZE, seeds
from satid_gym.gym_api import seed_stream

TINY = {
    "satellite": "microsat", "num_envs": 16, "rollout": 10, "batch_size": 80, "epochs": 1, "hold": 4, "steps": 320,
    "evaluate_every": 160, "evaluation_episodes": 2, "hidden": (4,),
}  # fmt: skip


@pytest.fixture
def drawn(monkeypatch):
    """Seeds of every environment that was reset with one, as the environments say themselves afterwards."""
    found: set[int] = set()
    reset = SatInertiaIDVectorEnv.reset

    def watched(env, **arguments):
        result = reset(env, **arguments)
        found.update(env.np_random_seed)
        return result

    monkeypatch.setattr(SatInertiaIDVectorEnv, "reset", watched)
    return found


def splits(found: set[int]) -> set[str]:
    """Splits that seeds come from."""
    return {name for name, first in FIRST_SEED.items() if any(first <= s < first + SPLIT_SIZE for s in found)}


def test_splits_are_disjoint_and_cover_what_the_vector_draws(drawn):
    for one, other in itertools.combinations(FIRST_SEED.values(), 2):
        assert abs(one - other) >= SPLIT_SIZE
    for split in FIRST_SEED:
        drawn.clear()
        last = seeds(split, 5, SPLIT_SIZE - 5)
        env = SatInertiaIDVectorEnv(5)
        env.reset(seed=last)  # the end of the split, where seed + i comes nearest to the next one
        env.reset(seed=last[0])
        assert drawn == set(last)
        assert splits(drawn) == {split}


def trained(tmp_path, seed: int) -> None:
    settings = PPOSettings.from_dict({**TINY, "seed": seed})
    ppo.train(Run(settings, tmp_path / str(seed), resume=False, module="test"))


def test_training_draws_training_seeds_and_judges_itself_on_validation_seeds(drawn, tmp_path):
    trained(tmp_path, 3)
    assert splits(drawn) == {"training", "validation"}
    assert {s for s in drawn if s < SPLIT_SIZE} == set(range(3 * 16, 4 * 16))
    assert {s for s in drawn if s >= SPLIT_SIZE} == set(seeds("validation", 2))


def test_training_runs_share_no_episode(drawn, tmp_path):
    runs = []
    for seed in (0, 1):
        drawn.clear()
        trained(tmp_path, seed)
        runs.append({s for s in drawn if s < SPLIT_SIZE})
    assert runs[0].isdisjoint(runs[1])
    assert len(runs[0]) == len(runs[1]) == 16


def test_a_training_seed_cannot_reach_into_another_split(tmp_path):
    with pytest.raises(ValueError, match="seed must be at most"):
        trained(tmp_path, SPLIT_SIZE // 16)


def test_tuning_draws_tuning_seeds(drawn):
    amplitudes.attempt("zero", {}, SATELLITES["cubesat"], "default", episodes=3)
    assert drawn == set(seeds("tuning", 3))


# The streams behind them


def test_new_episodes_of_a_vector_go_on_in_their_own_streams():
    """No reset draws a new seed: environment i stays with seed + i for ever, whichever way its episodes end."""
    env = SatInertiaIDVectorEnv(3, max_episode_steps=2)
    env.reset(seed=10)
    generators = [str(g.bit_generator.state) for g in env.np_random]
    for _ in range(20):
        env.step(np.zeros((3, 3)))
    env.reset()
    assert env.np_random_seed == (10, 11, 12)
    assert [str(g.bit_generator.state) for g in env.np_random] == generators


def test_first_states_of_the_streams_are_distinct_and_look_random():
    chosen = [s for split in FIRST_SEED for s in seeds(split, 500)]
    states = np.array([seed_stream(seeding.np_random(s)[0]) for s in chosen])
    assert len(np.unique(states)) == states.size
    bits = np.unpackbits(states.view(np.uint8))
    assert abs(bits.mean() - 0.5) < 5.0 * 0.5 / np.sqrt(bits.size)


def test_neighbouring_seeds_are_uncorrelated():
    """The true moments of seeds s and s + 1, over 4000 of them; 1 / sqrt(N) is the correlation's std."""
    env = SatInertiaIDVectorEnv(4000, inertia="static")
    _, infos = env.reset(seed=0)
    moments = np.log(np.diagonal(infos["inertia_true"], axis1=1, axis2=2))
    moments = (moments - moments.mean(axis=0)) / moments.std(axis=0)
    for lag in (1, 2, 16, 192):
        correlation = moments[:-lag].T @ moments[lag:] / (len(moments) - lag)
        assert np.abs(correlation).max() < 4.5 / np.sqrt(len(moments) - lag)
