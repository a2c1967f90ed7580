"""Fly a configuration and hold every decision against what must be true of any environment."""

from __future__ import annotations

import gymnasium
import numpy as np

from satid_gym import SatInertiaIDEnv
from satid_gym.env import DRAW_FAILED, INFO_KEYS
from tests.fuzz.configuration import Configuration, fastest_turn

DECISIONS = 300
_ROUNDING = 1e-9
_EVERY = 5  # decisions, between looks at the whole covariance: they cost most
_FINE = 0.05  # rad, turned between readings, up to which the integrator is exact to _ROUNDING
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
        How many episodes ended how, filter updates that were guarded, and the largest drift of |M|.

    Raises:
        Violation: a promise was broken; the message says which, and where.
        Undrawable: the configuration scatters the inertia too far, and was told so.
        Breakdown: the filter broke down, and said so.
    """
    env = SatInertiaIDEnv(**configuration.settings)
    chance = np.random.default_rng(configuration.seed)
    tally = {"terminated": 0, "truncated": 0, "guarded": 0, "saturated": 0, "drift": 0.0}
    _Check(env, _reset(env, configuration, configuration.seed), None).start()
    before = env._beliefs["guarded"][0]
    turn = env.problem.scenario.sample_period * fastest_turn(configuration.settings["satellite"])
    slack = _ROUNDING if turn < _FINE else _COARSE_DRIFT
    for decision in range(decisions):
        action = choose(configuration.actions, chance, env, decision)
        start = _momentum(env)
        try:
            result = env.step(action)
        except FloatingPointError:
            raise Breakdown(f"decision {decision}") from None
        try:
            _Check(env, (result[0], result[4]), result).step(action)
            tally["drift"] = max(tally["drift"], _conserved(env, start, slack))
        except Violation as violation:
            raise Violation(f"decision {decision}: {violation}") from None
        tally["guarded"] += int(env._beliefs["guarded"][0] - before)
        tally["saturated"] += bool(result[4]["saturated"].any())
        before = env._beliefs["guarded"][0]
        if result[2] or result[3]:
            tally["terminated"] += result[2]
            tally["truncated"] += result[3]
            _refuses_to_go_on(env, action)
            _Check(env, _reset(env, configuration, None), None).start()
            before = env._beliefs["guarded"][0]
    env.close()
    return tally


def _reset(env: SatInertiaIDEnv, configuration: Configuration, seed: int | None) -> tuple[np.ndarray, dict]:
    try:
        return env.reset(seed=seed, options=configuration.options)
    except ValueError as error:
        if str(error) == DRAW_FAILED:
            raise Undrawable from None
        raise


def choose(kind: str, chance: np.random.Generator, env: SatInertiaIDEnv, decision: int) -> np.ndarray:
    """One action of a kind."""
    n = env.action_space.shape[0]
    if kind == "zero":
        return np.zeros(n, np.float32)
    if kind == "random":
        return chance.uniform(-1.0, 1.0, n).astype(np.float32)
    if kind == "one_wheel":
        return np.eye(n)[0]  # float64, and one wheel driven into its limit
    if kind == "bang_bang":
        return np.where((decision // 7 + np.arange(n)) % 2 == 0, 1.0, -1.0).astype(np.float32)
    return chance.choice([-1e30, -1.0, -0.0, 1e-30, 1.0, 1e30], n)


def _momentum(env: SatInertiaIDEnv) -> float:
    return float(np.linalg.norm(env._plants["momentum"][0]))


def _refuses_to_go_on(env: SatInertiaIDEnv, action: np.ndarray) -> None:
    try:
        env.step(action)
    except gymnasium.error.ResetNeeded:
        return
    raise Violation("a step after the episode's end was taken")


def _conserved(env: SatInertiaIDEnv, start: float, slack: float) -> float:
    """Relative change of |M| over a decision without external torque; 0 where there is one.

    Args:
        env: after the decision.
        start: |M| before it.
        slack: what a sample may change.
    """
    plant, world = env._plants[0], env.problem.scenario
    torques = ("torque_constant", "torque_cosine", "torque_sine", "solar_force")
    if any(plant[name].any() for name in torques) or (plant["gravity_gradient"] and plant["orbit_rate"] > 0.0):
        return 0.0
    largest = max(start, float(np.abs(plant["wheel_inertia"] * plant["wheel_speed"]).max()))
    if largest == 0.0:
        return 0.0
    drift = abs(_momentum(env) - start) / largest
    if drift > world.samples * slack:
        raise Violation(f"|M| changed by {drift:.1e} without external torque")
    return drift


class _Check:
    """The promises, on what one call of reset or step returned and left."""

    def __init__(self, env: SatInertiaIDEnv, seen: tuple[np.ndarray, dict], result: tuple | None) -> None:
        self.env, self.result = env, result
        self.observation, self.info = seen

    def start(self) -> None:
        """After a reset."""
        _demand(self.info["time"] == 0.0, "the first time is {}", self.info["time"])
        self._common()

    def step(self, action: np.ndarray) -> None:
        """After a step."""
        assert self.result is not None
        env, info = self.env, self.info
        _, reward, terminated, truncated, _ = self.result
        world, task, plant = env.problem.scenario, env._tasks[0], env._plants[0]
        _demand(type(reward) is float and np.isfinite(reward), "reward is {!r}", reward)
        _demand(type(terminated) is bool and type(truncated) is bool, "ends are no plain bools")
        fast = float(np.abs(plant["rate"]).max())
        _demand(terminated == (fast > task["termination_rate"]), "terminated {} at {} rad/s", terminated, fast)
        last = task["decision"] >= world.decisions
        _demand(truncated == (last and not terminated), "truncated {} at decision {}", truncated, task["decision"])
        time = task["decision"] * world.decision_period
        _demand(abs(info["time"] - time) <= 1e-9 * time, "time is {}, not {}", info["time"], time)
        effort = float(np.mean(np.clip(action, -1.0, 1.0) ** 2))
        _demand(abs(info["effort"] - effort) < 1e-6, "effort is {}, not {}", info["effort"], effort)
        self._common()

    def _common(self) -> None:
        self._observation()
        self._info()
        self._truth()
        if self.env._tasks["decision"][0] % _EVERY == 0:
            self._belief()

    def _observation(self) -> None:
        space = self.env.observation_space
        _demand(self.observation.dtype == np.float32, "observation is {}", self.observation.dtype)
        _demand(np.isfinite(self.observation).all(), "observation is {}", self.observation.tolist())
        _demand(space.contains(self.observation), "observation is outside its space")

    def _info(self) -> None:
        info = self.info
        _demand(tuple(info) == INFO_KEYS, "info has {}", tuple(info))
        for key, value in info.items():
            _demand(bool(np.isfinite(value).all()), "{} is {}", key, value)
        _demand(0.0 <= info["cost"] <= 1.0, "cost is {}", info["cost"])
        _demand(info["nees"] >= 0.0 and info["nis"] >= 0.0, "nees {}, nis {}", info["nees"], info["nis"])
        truth, estimate = info["inertia_true"], info["inertia_estimate"]
        error = np.linalg.norm(estimate - truth) / np.linalg.norm(truth)
        _demand(abs(error - info["relative_error"]) <= 1e-9 * max(error, 1.0), "relative_error is not {}", error)
        _demand(info["saturated"].dtype == bool, "saturated is not bool")

    def _truth(self) -> None:
        plant = self.env._plants[0]
        over = np.abs(self.info["torque_applied"]) / plant["torque_max"]
        _demand(over.max() <= 1.0 + _ROUNDING, "torque is {} of the limit", over.max())
        over = np.abs(plant["wheel_speed"]) / plant["wheel_speed_max"]
        _demand(over.max() <= 1.0 + _ROUNDING, "a wheel is at {} of its limit", over.max())
        _demand(abs(np.linalg.norm(plant["attitude"]) - 1.0) < _ROUNDING, "attitude is no unit quaternion")
        for name in ("momentum", "wheel_momentum", "rate", "gyro", "tachometer"):
            _demand(bool(np.isfinite(plant[name]).all()), "{} is {}", name, plant[name])
        moments = np.linalg.eigvalsh(self.info["inertia_true"])
        _demand(moments[0] > 0.0, "true inertia has moments {}", moments)
        _demand(moments[0] + moments[1] >= moments[2] * (1.0 - 1e-6), "no body has moments {}", moments)

    def _belief(self) -> None:
        belief = self.env._beliefs[0]
        _demand(belief["broken"] == 0, "the covariance is broken")
        _demand(bool(np.isfinite(belief["mean"]).all()), "filter's mean is {}", belief["mean"])
        moments = np.linalg.eigvalsh(self.info["inertia_estimate"])
        _demand(moments[0] > 0.0, "estimate has moments {}", moments)
        covariance = belief["covariance"]
        _demand(bool(np.isfinite(covariance).all()), "filter's covariance is not finite")
        variance = np.diag(covariance)
        _demand(variance.min() >= 0.0, "filter's variances are {}", variance)
        known = variance == 0.0  # with nothing to learn about it
        std = np.sqrt(np.where(known, 1.0, variance))
        correlation = covariance / np.outer(std, std) + np.diag(known.astype(float))
        skew = float(np.abs(correlation - correlation.T).max())
        _demand(skew < _ROUNDING, "filter's correlation is not symmetric by {:.1e}", skew)
        least = np.linalg.eigvalsh(correlation)[0]
        _demand(least > -_ROUNDING, "filter's correlation has eigenvalue {:.1e}", least)


def _demand(true: bool, otherwise: str, *values: object) -> None:
    if not true:
        raise Violation(otherwise.format(*values))
