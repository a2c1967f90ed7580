"""Judges of the score of corners: its flights on tuning seeds, by what the filter expects and by costs."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from agents.evolution.settings import Evolution
from baselines.scenarios.flights import expected_error
from satid_gym.control.corners.tour import CornerTour
from satid_gym.evaluation import seeds
from satid_gym.gym_api import COSTS
from satid_gym.policy import missions, observation_settings
from satid_gym.scenario import Scenario
from satid_gym.vector import SatInertiaIDVectorEnv

_FREE = 0.005  # share of the time beyond a limit that costs nothing


class Judge:
    """Flies weights in one scenario on tuning seeds."""

    def __init__(self, settings: Evolution, world: Scenario) -> None:
        self._env = SatInertiaIDVectorEnv(
            settings.episodes,
            settings.flies("tuning", settings.drawn),
            "random",
            world,
            control="rate",
            num_threads=1,
            **observation_settings(settings.policy(np.zeros(len(settings.features)))),
        )
        self._tour = CornerTour(
            missions(self._env.problem),
            settings.margin,
            features=settings.features,
            settle=settings.settle,
            is_shaped=settings.shaped,
        )
        self._expected = expected_relative_error if settings.is_drawn else expected_error
        self._settings = settings

    def close(self) -> None:
        """Close the environment."""
        self._env.close()

    def __call__(self, weights: np.ndarray, generation: int) -> float:
        """Mean of the log of the expected error, and what being beyond a limit costs; the lower the better."""
        count, env = self._settings.episodes, self._env
        observation, _ = env.reset(seed=seeds("tuning", count, generation * count))
        self._tour.assign(env.satellite_index)
        self._tour.begin(count)
        score, world = self._settings.policy(weights).score, env.problem.scenario
        alive, expected, cost = np.ones(count, bool), np.zeros(count), np.zeros(count)
        for _ in range(world.decisions):
            observation, _, terminated, _, info = env.step(self._tour(observation, score))
            expected += np.where(alive, self._expected(env), world.prior_std)  # as little is known as at first
            cost += np.where(alive, np.max([info["costs"][name] for name in COSTS], axis=0), 1.0)
            alive &= ~terminated
        beyond = np.maximum(cost / world.decisions - _FREE, 0.0)
        return float(np.mean(np.log(expected / world.decisions) + self._settings.price * beyond))


def expected_relative_error(env: SatInertiaIDVectorEnv) -> np.ndarray:
    """Relative error (N,) of the inertia that the filter expects, in the Frobenius norm, as `info` has the true one."""
    beliefs = env.fleet.rows.beliefs
    p = beliefs["theta_scale"].shape[1]
    count = np.where(np.arange(p) < 3, 1.0, 2.0)  # of theta's entries in the tensor
    variance = np.diagonal(beliefs["covariance"], axis1=1, axis2=2)[:, 3 : 3 + p]
    return np.sqrt((variance @ count) / (beliefs["mean"][:, 3 : 3 + p] ** 2 @ count))


class Judges:
    """Judges of all scenarios, as many of each as fly side by side."""

    def __init__(self, settings: Evolution) -> None:
        self._judges = [[Judge(settings, world) for world in settings.worlds] for _ in range(settings.workers)]
        self._pool = ThreadPoolExecutor(settings.workers)

    def close(self) -> None:
        """Wait for what flies, and close."""
        self._pool.shutdown()
        for judge in itertools.chain(*self._judges):
            judge.close()

    def __call__(self, points: Sequence[np.ndarray], generation: int) -> list[float]:
        """Scores of weights, the mean over scenarios."""
        count, scores = len(self._judges), [0.0] * len(points)

        def fly_share(k: int) -> None:
            for i in range(k, len(points), count):
                scores[i] = float(np.mean([judge(points[i], generation) for judge in self._judges[k]]))

        list(self._pool.map(fly_share, range(count)))
        return scores
