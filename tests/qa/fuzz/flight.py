"""Fly a configuration and compare every decision with what must be true of any environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from satid_gym import SatInertiaIDEnv
from satid_gym.core.belief.filters import FilterKind
from satid_gym.core.belief.kalman import _FLOOR
from satid_gym.core.records import InertiaMode
from satid_gym.estimators.filterpy.model import tensor
from satid_gym.fleet import DRAW_FAILED
from satid_gym.gym_api import COSTS, INFO_KEYS
from satid_gym.modes import fastest_oscillation
from tests.qa.fuzz.configuration import Configuration, fastest_turn

DECISIONS = 300
_ROUNDING = 1e-9
_FINE = 0.05  # rad, turned between readings, up to which the integrator is exact to rounding
_COARSE_DRIFT = 1e-6  # of |M| in a sample, where its own error is larger


class Violation(AssertionError):
    """Something that must be true was not."""


class Undrawable(Exception):
    """The environment said that it finds no physical inertia so far from nominal."""


class Breakdown(Exception):
    """The environment said that the filter broke down."""


def fly(configuration: Configuration, decisions: int = DECISIONS) -> dict[str, float]:
    """Fly `decisions` decisions, over as many episodes as that takes.

    Returns:
        How many episodes ended how, decisions in which a wheel saturated, and the largest drift of |M|.

    Raises:
        Violation: a promise was broken; the message says which, and where.
        Undrawable: the configuration scatters the inertia too far, and was told so.
        Breakdown: the filter broke down, and said so.
    """
    env = SatInertiaIDEnv(**configuration.settings)
    chance = np.random.default_rng(configuration.seed)
    log = _Log(env, decisions)
    log.reset(_reset(env, configuration, configuration.seed))
    for decision in range(decisions):
        action = choose(configuration.actions, chance, env, decision)
        try:
            result = env.step(action)
        except FloatingPointError:
            raise Breakdown(f"decision {decision}") from None
        log.step(action, result)
        if result[2] or result[3]:
            _refuses_to_go_on(env, action)
            log.reset(_reset(env, configuration, None))
    env.close()
    (satellite,) = env.problem.satellites
    fastest = fastest_turn(configuration.settings["satellite"])
    fastest += fastest_oscillation(satellite.modes, satellite.inertia) if satellite.oscillators else 0.0
    turn = env.problem.scenario.sample_period * fastest
    return log.check(_ROUNDING if turn < _FINE else _COARSE_DRIFT)


def _reset(env: SatInertiaIDEnv, configuration: Configuration, seed: int | None) -> tuple[np.ndarray, dict]:
    try:
        return env.reset(seed=seed, options=configuration.options)
    except ValueError as error:
        if str(error) == DRAW_FAILED:
            raise Undrawable from None
        raise


def choose(kind: str, chance: np.random.Generator, env: SatInertiaIDEnv, decision: int) -> np.ndarray:
    """One action of a kind."""
    n = env.problem.actions
    if kind == "zero":
        return np.zeros(n, np.float32)
    if kind == "random":
        return chance.uniform(-1.0, 1.0, n).astype(np.float32)
    if kind == "one_wheel":
        return np.eye(n)[0]  # float64, and one wheel driven into its limit
    if kind == "bang_bang":
        return np.where((decision // 7 + np.arange(n)) % 2 == 0, 1.0, -1.0).astype(np.float32)
    return chance.choice([-1e30, -1.0, -0.0, 1e-30, 1.0, 1e30], n)


def _refuses_to_go_on(env: SatInertiaIDEnv, action: np.ndarray) -> None:
    try:
        env.step(action)
    except gymnasium.error.ResetNeeded:
        return
    raise Violation("a step after the episode's end was taken")


class _Log:
    """What resets and steps returned and left, row by row; checked when the flight is over."""

    def __init__(self, env: SatInertiaIDEnv, decisions: int) -> None:
        self.env = env
        rows = 2 * decisions + 1  # each decision may end an episode
        self.plants = np.zeros(rows, env.fleet.rows.plants.dtype)
        self.beliefs = np.zeros(rows, env.fleet.rows.beliefs.dtype)
        self.tasks = np.zeros(rows, env.fleet.rows.tasks.dtype)
        self.seen: list[tuple[np.ndarray, dict[str, Any]]] = []
        self.actions: list[np.ndarray] = []
        self.results: list[tuple[float, bool, bool]] = []

    def reset(self, seen: tuple[np.ndarray, dict[str, Any]]) -> None:
        """Note the start of an episode."""
        self._note(*seen)
        self.actions.append(np.zeros(self.env.problem.actions))
        self.results.append((0.0, False, False))

    def step(self, action: np.ndarray, result: tuple[np.ndarray, float, bool, bool, dict[str, Any]]) -> None:
        """Note a decision."""
        self._note(result[0], result[4])
        self.actions.append(action)
        self.results.append(result[1:4])

    def _note(self, observation: np.ndarray, info: dict[str, Any]) -> None:
        rows, row = self.env.fleet.rows, len(self.seen)
        self.plants[row], self.beliefs[row], self.tasks[row] = rows.plants[0], rows.beliefs[0], rows.tasks[0]
        self.seen.append((observation, info))

    def check(self, slack: float) -> dict[str, float]:
        """Compare all of it with the promises; the flight in figures.

        Args:
            slack: how far |M| may drift in a sample without external torque, relative.
        """
        observations, infos = zip(*self.seen, strict=True)
        rows = slice(len(infos))
        self.plants, self.beliefs, self.tasks = self.plants[rows], self.beliefs[rows], self.tasks[rows]
        _demand([tuple(info) == INFO_KEYS for info in infos], "info has the wrong keys")
        self.info = {key: np.array([info[key] for info in infos]) for key in INFO_KEYS if key != "costs"}
        self.info |= {f"cost of {name}": np.array([info["costs"][name] for info in infos]) for name in COSTS}
        _demand([o.dtype == np.float32 for o in observations], "observation is not float32")
        self._returned(np.array(observations))
        self._ends()
        self._truth()
        self._belief()
        _, terminated, truncated = map(np.array, zip(*self.results, strict=True))
        return {
            "terminated": int(terminated.sum()),
            "truncated": int(truncated.sum()),
            "saturated": int(self.info["saturated"].any(axis=1).sum()),
            "drift": self._drift(slack),
        }

    def _returned(self, observations: np.ndarray) -> None:
        space, info = self.env.observation_space, self.info
        _demand(np.isfinite(observations).all(axis=1), "observation is not finite")
        inside = (observations >= space.low) & (observations <= space.high)
        _demand(inside.all(axis=1), "observation is outside its space")
        for key, values in info.items():
            _demand(np.isfinite(values.reshape(len(values), -1)).all(axis=1), f"{key} is not finite")
        costs = np.array([info[f"cost of {name}"] for name in COSTS])
        _demand(((costs >= 0.0) & (costs <= 1.0)).all(axis=0), "a cost is no share", costs.T)
        _demand(info["cost"] == costs.max(axis=0), "cost is not the largest", info["cost"])
        _demand((info["nees"] >= 0.0) & (info["nis"] >= 0.0), "nees or nis is negative", info["nees"], info["nis"])
        truth, estimate = info["inertia_true"], info["inertia_estimate"]
        error = np.linalg.norm(estimate - truth, axis=(1, 2)) / np.linalg.norm(truth, axis=(1, 2))
        wrong = np.abs(error - info["relative_error"]) > _ROUNDING * np.maximum(error, 1.0)
        _demand(~wrong, "relative_error is not the inertia's", error, info["relative_error"])
        _demand(info["saturated"].dtype == bool, "saturated is not bool")
        effort = np.mean(np.clip(np.array(self.actions), -1.0, 1.0) ** 2, axis=1)
        if self.env.problem.control == "torque":
            _demand(np.abs(info["effort"] - effort) < 1e-6, "effort is not the action's", effort, info["effort"])
        _demand((info["effort"] >= 0.0) & (info["effort"] <= 1.0 + 1e-12), "effort is no share", info["effort"])

    def _ends(self) -> None:
        world, tasks, rates = self.env.problem.scenario, self.tasks, self.plants["rate"]
        for reward, terminated, truncated in self.results:
            _demand(type(reward) is float and np.isfinite(reward), f"reward is {reward!r}")
            _demand(type(terminated) is bool and type(truncated) is bool, "ends are not Python's bool")
        _, terminated, truncated = map(np.array, zip(*self.results, strict=True))
        begun = tasks["decision"] > 0
        fast = begun & (np.abs(rates).max(axis=1) > tasks["termination_rate"])
        over = fast | (begun & (self.info["deflection"] > tasks["termination_deflection"]).any(axis=1))
        _demand(terminated == over, "terminated at a rate and deflection that do not say so", rates)
        late = (tasks["decision"] >= world.decisions) & ~over
        _demand(truncated == late, "truncated at the wrong decision", tasks["decision"])
        time = tasks["decision"] * world.decision_period
        _demand(np.abs(self.info["time"] - time) <= _ROUNDING * time, "time is wrong", self.info["time"], time)

    def _truth(self) -> None:
        plants = self.plants
        rubbing = np.maximum(plants["friction_coulomb"], plants["friction_static"])[:, None]
        rubbing = rubbing + plants["friction_viscous"][:, None] * plants["wheel_speed_max"]
        over = np.abs(self.info["torque_applied"]) / (plants["torque_max"] + rubbing)
        _demand(over.max(axis=1) <= 1.0 + _ROUNDING, "torque is beyond its limit by factors", over)
        over = np.abs(plants["wheel_speed"]) / plants["wheel_speed_max"]
        _demand(over.max(axis=1) <= 1.0 + _ROUNDING, "a wheel is beyond its limit by factors", over)
        length = np.linalg.norm(plants["attitude"], axis=1)
        _demand(np.abs(length - 1.0) < _ROUNDING, "attitude is no unit quaternion but of length", length)
        for name in ("momentum", "wheel_momentum", "rate", "gyro", "tachometer"):
            _demand(np.isfinite(plants[name]).all(axis=1), f"{name} is not finite", plants[name])
        for name in ("deflection", "speed"):
            values = plants["oscillators"][name]
            _demand(np.isfinite(values).all(axis=1), f"{name} of the oscillators is not finite", values)
        moments = np.linalg.eigvalsh(self.info["inertia_true"])
        physical = (moments[:, 0] > 0.0) & (moments[:, 0] + moments[:, 1] >= moments[:, 2] * (1.0 - 1e-6))
        _demand(physical, "no body has true moments", moments)

    def _belief(self) -> None:
        covariance = self.beliefs["covariance"]
        _demand(self.beliefs["broken"] == 0, "the covariance is broken")
        _demand(np.isfinite(self.beliefs["mean"]).all(axis=1), "the filter's mean is", self.beliefs["mean"])
        moments = np.linalg.eigvalsh(self.info["inertia_estimate"])
        _demand(moments[:, 0] > 0.0, "estimate is not positive definite, its moments are", moments)
        _demand(np.isfinite(covariance).all(axis=(1, 2)), "the filter's covariance is not finite")
        variance = np.diagonal(covariance, axis1=1, axis2=2)
        _demand((variance >= 0.0).all(axis=1), "the filter's variances are", variance)
        known = variance == 0.0  # with nothing to learn about it
        std = np.sqrt(np.where(known, 1.0, variance))
        correlation = covariance / (std[:, :, None] * std[:, None, :]) + known[:, :, None] * np.eye(known.shape[1])
        skew = np.abs(correlation - correlation.transpose(0, 2, 1)).max(axis=(1, 2))
        _demand(skew == 0.0, "the filter's correlation is not symmetric by", skew)
        least, rounding = np.linalg.eigvalsh(correlation)[:, 0], self._rounding(variance)
        _demand(least >= -rounding, "beyond rounding the filter's correlation has the eigenvalue", least, rounding)

    def _rounding(self, variance: np.ndarray) -> np.ndarray:
        """(rows,) how far rounding may move the correlation's eigenvalues.

        An update takes P h (P h)^T / S, S = 1 + h P h, from P, once for each whitened reading. Its entries are rounded
        relative to the variances that the episode came from; those of P h relative to sum |h_k| std_k, which exceeds
        sqrt(S) where the parts of h P h cancel, as where a nearly noiseless gyro knows a combination of M and theta
        far better than either. An update in errors of the rate takes P through two more products, to the new rate
        and inertia and back.
        """
        fresh = np.flatnonzero(self.tasks["decision"] == 0)
        widest = np.concatenate([np.maximum.accumulate(part) for part in np.split(variance, fresh) if len(part)])
        shrunk = np.max(widest / np.where(variance > 0.0, variance, np.inf), axis=1)
        products = 3 if self.beliefs[0]["rate_coordinates"] != 0 else 1
        return products * np.finfo(float).eps * variance.shape[1] * (shrunk + self._reach(np.sqrt(variance)))

    def _reach(self, std: np.ndarray) -> np.ndarray:
        """(rows,) upper bound of sum |h_k| std_k over the readings, wherever the filter linearised them.

        Of the MomentumEKF h^T h = (sigma_gyro^2 J^2 + N)^-1 for M, and no estimate of J is below its floor.
        """
        belief = self.beliefs[0]
        p = len(belief["prior_theta"])
        if belief["kind"] != FilterKind.MOMENTUM:
            wheels = std[:, 3 + p :].sum(axis=1) / belief["tachometer_std"]
            return std[:, :3].sum(axis=1) / belief["gyro_std"] + wheels
        softest = _FLOOR * np.linalg.eigvalsh(tensor(belief["prior_theta"]))[0]
        spin = max(np.linalg.eigvalsh(belief["wheel_momentum_covariance"])[0], 0.0)
        sharpest = 3.0 / np.hypot(belief["gyro_std"] * softest, np.sqrt(spin))
        rate = np.linalg.norm(self.plants["gyro"], axis=1)
        return sharpest * (std[:, :3].sum(axis=1) + rate * std[:, 3 : 3 + p].sum(axis=1))

    def _drift(self, slack: float) -> float:
        """Largest relative change of |M| over a decision without external torque; 0 where there is one.

        What is released takes its momentum along.
        """
        plants, world = self.plants, self.env.problem.scenario
        torques = ("torque_constant", "torque_cosine", "torque_sine", "solar_force")
        if (plants["law"] == InertiaMode.RELEASE).any() or any(plants[name].any() for name in torques):
            return 0.0
        if world.gravity_gradient and world.orbit_rate > 0.0:
            return 0.0
        momentum = np.linalg.norm(plants["momentum"], axis=1)
        spin = np.abs(plants["wheel_inertia"] * plants["wheel_speed"]).max(axis=1)
        size = np.maximum(momentum, spin)[:-1]
        change = np.abs(np.diff(momentum)) / np.where(size > 0.0, size, 1.0)
        change[self.tasks["decision"][1:] == 0] = 0.0  # a reset
        _demand(change <= world.samples * slack, "|M| drifts without external torque by", change)
        return float(change.max())


def _demand(true: Any, otherwise: str, *values: np.ndarray) -> None:
    """Raise where any row is not true, with what the values are there."""
    wrong = np.flatnonzero(~np.asarray(true))
    if len(wrong):
        at = wrong[0]
        raise Violation(" ".join([otherwise, *(str(value[at]) for value in values), f"(row {at})"]))
