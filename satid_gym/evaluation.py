"""Evaluation protocol of every comparison: policies x satellites x inertia modes x seeds -> scores.

All policies of a cell fly the same episodes: the same seed gives the same truth and the same noise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np
from gymnasium.vector import SyncVectorEnv, VectorEnv

from satid_gym import metrics
from satid_gym.config import check_integer, unknown_name
from satid_gym.core.records import InertiaMode, concatenate
from satid_gym.env import SatInertiaIDEnv
from satid_gym.estimators.settings import EstimatorSettings
from satid_gym.fleet import Fleet
from satid_gym.law_ranges import PAPER_LAWS, LawRanges
from satid_gym.policy import Policy, observation_settings, only_mission, show_filter
from satid_gym.resolution import InertiaLike, ScenarioLike, resolve_scenario
from satid_gym.reward import RewardSettings
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario
from satid_gym.truth import Truth
from satid_gym.truth.choice import truth_of
from satid_gym.vector import SatInertiaIDVectorEnv

Split = Literal["training", "tuning", "validation", "test"]
FIRST_SEED: dict[Split, int] = {
    "training": 0,
    "tuning": 1_000_000_000,
    "validation": 2_000_000_000,
    "test": 3_000_000_000,
}
SPLIT_SIZE = 1_000_000_000


def seeds(split: Split, count: int, offset: int = 0) -> list[int]:
    """Seeds of one split; no two splits share a seed.

    Raises:
        ValueError: the split is unknown or has fewer seeds, or a number is not an integer.
    """
    if not isinstance(split, str) or split not in FIRST_SEED:
        raise unknown_name("split of seeds", split, FIRST_SEED)
    count, offset = check_integer("count", count, low=0), check_integer("offset", offset, low=0)
    if offset + count > SPLIT_SIZE:
        raise ValueError(f"a split has {SPLIT_SIZE} seeds, asked for {count} from {offset}")
    return list(range(FIRST_SEED[split] + offset, FIRST_SEED[split] + offset + count))


def benchmark_scenario(scenario: ScenarioLike = "default") -> Scenario:
    """Scenario of the benchmark: with the paper's exact inertia laws, unless it has laws other than the default."""
    world = resolve_scenario(scenario)
    return world.replace(laws=PAPER_LAWS) if world.laws == LawRanges() else world


@dataclass(frozen=True, eq=False, kw_only=True)
class Flight:
    """Time series of one policy in one cell, (T, N) for T decisions of N episodes.

    Attributes:
        time: (T,) s.
        error: relative error of the inertia estimate.
        outside: share of the decision's samples outside the rate limit.
        nees: normalised estimation error squared, per degree of freedom.
        information: information gain of the decision's updates, nats.
        effort: mean square of the torque over its limit.
        reward: reward of each decision.
        saturated: share of the wheels that were at their speed limit.
        cost: largest of the decision's costs, `info["cost"]`: limits of rates, wheels, panels, tanks and payload.
        alive: False after a termination; from then on error keeps its last value, outside and cost are 1, and the rest
            is 0.
        settled: whether a filter can know the inertia, see `satid_gym.metrics.settled`.
        terminated: (N,) whether an episode ended early, be it in the last decision.
    """

    time: np.ndarray
    error: np.ndarray
    outside: np.ndarray
    nees: np.ndarray
    information: np.ndarray
    effort: np.ndarray
    reward: np.ndarray
    saturated: np.ndarray
    cost: np.ndarray
    alive: np.ndarray
    settled: np.ndarray
    terminated: np.ndarray

    def scores(self) -> dict[str, np.ndarray]:
        """Scores of each episode, (N,) each."""
        nees = np.where(self.alive, self.nees, np.nan)
        return {
            "final_error": metrics.final_error(self.error),
            "mean_error": metrics.mean_error(self.error),
            "time_to_1pct_s": metrics.time_to(self.error, self.time),
            "outside_fraction": self.outside.mean(axis=0),
            "information_nats": self.information.sum(axis=0),
            "nees": metrics.consistency(nees, self.settled),
            "effort": self.effort.sum(axis=0) / self.alive.sum(axis=0),
            "saturated_fraction": self.saturated.mean(axis=0),
            "reward": self.reward.sum(axis=0),
            "terminated": self.terminated,
            "cost": self.cost.mean(axis=0),
        }


def fly(
    policy: Policy,
    *,
    satellite: str | Satellite,
    inertia: InertiaLike,
    seeds: Sequence[int],
    scenario: ScenarioLike = "default",
    estimator: str | Mapping[str, Any] | EstimatorSettings | None = None,
    reward: str | Mapping[str, Any] | RewardSettings | None = None,
    control: str = "torque",
    num_threads: int | None = None,
    truth: str | Callable[[], Truth] | None = None,
) -> Flight:
    """Fly one policy in the episodes of one cell, in parallel; returns the time series.

    Args:
        policy: the policy that decides.
        satellite, inertia, scenario, estimator, reward, control: as for the environment.
        seeds: one per episode.
        num_threads: see `SatInertiaIDVectorEnv`.
        truth: class or function that makes a truth for each episode, or its module:name; None: the environment's own.

    Raises:
        ValueError: the policy is not one or cannot fly there, a name or value is not valid, or episodes would share a
            truth.
    """
    if isinstance(policy, type) or not callable(policy) or not hasattr(policy, "reset"):
        raise ValueError(
            f"policy must be an object with reset(mission, seeds) and a call for each decision, got {policy!r}: make "
            'one, such as find("generalist") or make_baseline("sine", "microsat") of satid_gym.policies'
        )
    settings = {
        "satellite": satellite,
        "inertia": inertia,
        "scenario": scenario,
        "estimator": estimator,
        "reward": reward,
        "control": control,
        **observation_settings(policy),
    }
    env: VectorEnv[np.ndarray, np.ndarray, np.ndarray]
    if truth is None:
        env = own = SatInertiaIDVectorEnv(len(seeds), num_threads=num_threads, **settings)
        posed, fleets = own.problem, [own.fleet]
    else:
        truths = [truth_of(truth) for _ in seeds]
        if len(set(map(id, truths))) < len(truths):
            raise ValueError("truth must be a class or a function that makes one for each episode, got a single object")
        singles = [SatInertiaIDEnv(truth=own_truth, **settings) for own_truth in truths]
        env, posed = SyncVectorEnv([partial(_same, single) for single in singles]), singles[0].problem
        fleets = [single.fleet for single in singles]
    world = posed.scenario
    mission = only_mission(posed)
    policy.reset(mission, seeds)
    observation, _ = env.reset(seed=list(seeds))
    decisions, count = world.decisions, len(seeds)
    names = ("error", "outside", "nees", "information", "effort", "reward", "saturated", "cost")
    series = {name: np.zeros((decisions, count)) for name in names}
    alive = np.ones((decisions + 1, count), bool)
    stepped, turning = np.zeros((2, decisions, count), bool)
    for t in range(decisions):
        show_filter(policy, *_records(fleets, "beliefs", "tasks"))
        observation, rewards, terminated, _, info = env.step(policy(observation))
        now = alive[t]
        series["error"][t] = np.where(now, info["relative_error"], series["error"][t - 1])
        series["outside"][t] = np.where(now, info["outside"], 1.0)
        series["nees"][t] = np.where(now, info["nees"], 0.0)
        series["information"][t] = np.where(now, info["information_gain"], 0.0)
        series["effort"][t] = np.where(now, info["effort"], 0.0)
        series["reward"][t] = np.where(now, rewards, 0.0)
        series["saturated"][t] = np.where(now, info["saturated"].mean(axis=1), 0.0)
        series["cost"][t] = np.where(now, info["cost"], 1.0)
        stepped[t], turning[t] = stepped_and_turning(*_records(fleets, "plants", "tasks"))
        alive[t + 1] = now & ~terminated
    env.close()
    time = world.decision_period * np.arange(1, decisions + 1)
    settled = metrics.settled(stepped, turning, world.decision_period)
    return Flight(time=time, alive=alive[:-1], settled=settled, terminated=~alive[-1], **series)


def stepped_and_turning(plants: np.ndarray, tasks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whether the inertia of each plant has stepped since the start, and whether the body turns; (N,) bool both."""
    steps = np.isin(plants["law"], (InertiaMode.STEP, InertiaMode.RELEASE)) & (plants["law_time"] > 0.0)
    return steps & (plants["time"] >= plants["law_time"]), metrics.turns(plants["rate"], tasks["rate_limit"])


def _records(fleets: Sequence[Fleet], *parts: str) -> list[np.ndarray]:
    """Records of all fleets, in order, part by part."""
    rows = ([getattr(fleet.rows, part) for fleet in fleets] for part in parts)
    return [own[0] if len(own) == 1 else concatenate(own) for own in rows]


def _same(env: SatInertiaIDEnv) -> SatInertiaIDEnv:
    return env
