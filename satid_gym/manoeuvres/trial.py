"""Trials: parallel flights of several policies, each with the same random satellites and the same noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from satid_gym.estimators.inertia import Parameters
from satid_gym.gym_api import COSTS
from satid_gym.manoeuvres.pointing import separations, turned
from satid_gym.manoeuvres.request import KeepOut
from satid_gym.policy import Policy, only_mission
from satid_gym.problem import Problem
from satid_gym.vector import SatInertiaIDVectorEnv


@dataclass(frozen=True, eq=False, kw_only=True)
class Trial:
    """Flights of one policy: N episodes of D decisions; after an early end std and error are infinite, turn is 0.

    What is largest or least is so among the ends of decisions, up to an episode's end.

    Attributes:
        name: of the policy.
        std: (D, N, p) the filter's standard deviation of each parameter over its scale: the prior moment, for products
            of inertia the geometric mean of two.
        error: (D, N) relative error of the inertia estimate.
        nees: (N,) normalised estimation error squared per degree of freedom, mean over the flight.
        costs: (N, c) share of the time of each of `COSTS`.
        terminated: (N,) whether it ended early.
        rate: (N,) largest true rate when a decision ended, over the limit.
        wheel_speed: (N,) largest of a wheel when a decision ended, over the limit.
        deflection: (N,) largest over its limit; 0 where there are no oscillators.
        turn: (D, N) true angle from the first attitude, rad.
        clearance: (N, k) least angle by which each boresight stays out of its keep-out, rad.
        end_rate: (N,) norm of the true rate at the end, also an early one, rad/s.
        doubted: (N,) whether the filter restarted, inflated its noise or raised an alarm, see docs/unmodelled.md.
    """

    name: str
    std: np.ndarray
    error: np.ndarray
    nees: np.ndarray
    costs: np.ndarray
    terminated: np.ndarray
    rate: np.ndarray
    wheel_speed: np.ndarray
    deflection: np.ndarray
    turn: np.ndarray
    clearance: np.ndarray
    end_rate: np.ndarray
    doubted: np.ndarray

    @property
    def expected(self) -> float:
        """Geometric mean, over episodes and parameters, of the final standard deviation over its scale."""
        return float(np.exp(np.log(self.std[-1]).mean()))

    @property
    def accuracy(self) -> float:
        """Largest final standard deviation of a moment over its scale, root mean square over episodes."""
        return float(self.parameter_std[-1, :3].max())

    @property
    def parameter_std(self) -> np.ndarray:
        """(D, p) standard deviations over their scales, root mean square over episodes: a few bad ones can set it."""
        return np.sqrt((self.std**2).mean(axis=1))

    @property
    def median_std(self) -> np.ndarray:
        """(p,) final standard deviations over their scales, median over episodes."""
        return np.median(self.std[-1], axis=0)

    @property
    def parameters(self) -> Parameters:
        """Parameters that the filter estimates: "principal" or "full"."""
        return "full" if self.std.shape[2] > 3 else "principal"

    @property
    def beyond(self) -> float:
        """Largest of the costs, mean over episodes: share of the time beyond a limit."""
        return float(self.costs.mean(axis=0).max())

    def keeps(self, limit: float) -> bool:
        """Whether no episode ended early, and each cost is at most a limit in the mean over episodes."""
        return not self.terminated.any() and self.beyond <= limit


def fly_side_by_side(
    problem: Problem, policies: Sequence[Policy], seeds: Sequence[int], keep_outs: Sequence[KeepOut] = ()
) -> list[Trial]:
    """Flights of policies that need no covariance and the problem's form of observation.

    Args:
        problem: one satellite, and the world it flies in.
        policies: each of them flies every seed.
        seeds: (N,) one an episode.
        keep_outs: of which the clearance is told.
    """
    count, total = len(seeds), len(seeds) * len(policies)
    env = SatInertiaIDVectorEnv(
        total,
        list(problem.satellites),
        problem.inertia,
        problem.scenario,
        problem.estimator,
        control=problem.control,
        observation=problem.observation,
    )
    mission, decisions = only_mission(problem), problem.scenario.decisions
    for policy in policies:
        policy.reset(mission, seeds)
    observation, _ = env.reset(seed=list(seeds) * len(policies))
    rows = env.fleet.rows
    p = rows.beliefs["theta_scale"].shape[1]
    first = Rotation.from_quat(rows.plants["attitude"]).inv()
    std, error, turn = np.empty((decisions, total, p)), np.empty((decisions, total)), np.zeros((decisions, total))
    costs, nees, lived = np.zeros((total, len(COSTS))), np.zeros(total), np.zeros(total)
    rate, speed, deflection, end_rate = np.zeros(total), np.zeros(total), np.zeros(total), np.zeros(total)
    clearance = np.full((total, len(keep_outs)), np.inf)
    angles = np.array([keep_out.angle for keep_out in keep_outs])
    alive, doubted = np.ones(total, bool), np.zeros(total, bool)
    for d in range(decisions):
        actions = [policy(observation[k * count : (k + 1) * count]) for k, policy in enumerate(policies)]
        observation, _, terminated, _, info = env.step(np.concatenate(actions))
        plants = rows.plants
        std[d] = np.where(alive[:, None], _relative_std(rows.beliefs), np.inf)
        error[d] = np.where(alive, info["relative_error"], np.inf)
        attitude = (first * Rotation.from_quat(plants["attitude"])).as_quat()
        turn[d] = np.where(alive, turned(attitude), 0.0)
        clear = separations(attitude, keep_outs) - angles
        clearance = np.where(alive[:, None], np.minimum(clearance, clear), clearance)
        lived += alive
        nees += np.where(alive, info["nees"], 0.0)
        costs += np.where(alive[:, None], np.stack([info["costs"][name] for name in COSTS], axis=1), 0.0)
        bent = (info["deflection"] / rows.tasks["deflection_limit"]).max(axis=1, initial=0.0)
        turning = np.abs(plants["rate"]).max(axis=1) / rows.tasks["rate_limit"]
        fastest = (np.abs(plants["wheel_speed"]) / rows.tasks["wheel_speed_max"]).max(axis=1)
        for largest, now in ((rate, turning), (speed, fastest), (deflection, bent)):
            np.maximum(largest, now, out=largest, where=alive)
        end_rate = np.where(alive, np.linalg.norm(plants["rate"], axis=1), end_rate)
        doubted |= alive & ((info["restarts"] > 0) | (info["inflation"] > 1.0) | info["unmodelled"])
        alive &= ~terminated
    env.close()
    series = {"std": std, "error": error, "turn": turn}
    ends = {
        "nees": nees / lived,
        "costs": costs / lived[:, None],
        "terminated": ~alive,
        "rate": rate,
        "wheel_speed": speed,
        "deflection": deflection,
        "clearance": clearance,
        "end_rate": end_rate,
        "doubted": doubted,
    }
    trials = []
    for k, policy in enumerate(policies):
        own = slice(k * count, (k + 1) * count)
        parts = {name: value[:, own] for name, value in series.items()} | {n: v[own] for n, v in ends.items()}
        trials.append(Trial(name=policy.name, **parts))
    return trials


def _relative_std(beliefs: np.ndarray) -> np.ndarray:
    """(N, p) standard deviations of the inertia parameters over their scales."""
    p = beliefs["theta_scale"].shape[1]
    own = np.diagonal(beliefs["covariance"], axis1=1, axis2=2)[:, 3 : 3 + p]
    common = beliefs["scale_variance"][:, None] * beliefs["mean"][:, 3 : 3 + p] ** 2
    return np.sqrt(own + common) / beliefs["theta_scale"]
