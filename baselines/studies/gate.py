"""Gate of a scenario: `python -m baselines.studies.gate --scenario flex`. Does the choice of excitation matter there?

Flies, by body rates, from nothing to an oracle:

- zero and random;
- the paper's eight profiles, and square waves of rate, each with its best settings inside all limits;
- `shaped_square`, which spares the modes, with its best settings inside all limits;
- an oracle that is told the true modes and searches the settings of each episode by the cross-entropy method.

Settings are chosen on tuning seeds and flown on validation seeds. What is compared is the error that the filter
expects, its mean over the flight, and not the one that is found at its end: of many plans an oracle would else choose a
lucky one. A policy is inside where each cost is at most a limit, in the mean over episodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from baselines.command import cli
from baselines.command.provenance import result_head
from satid_gym.config import check_integer, check_names
from satid_gym.core.observation import MODE_PARTS
from satid_gym.evaluation import seeds
from satid_gym.files import check_writable, write_json
from satid_gym.gym_api import COSTS
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.policies.reference import RandomPolicy, ZeroPolicy
from satid_gym.policies.scripted import ScriptedPolicy
from satid_gym.policies.shaped_square import ShapedSquarePolicy
from satid_gym.policy import Policy, missions, observation_settings
from satid_gym.profiles import PROFILES
from satid_gym.satellite import SATELLITES
from satid_gym.scenario import SCENARIOS
from satid_gym.vector import SatInertiaIDVectorEnv

AMPLITUDES = np.geomspace(0.01, 0.95, 12).round(3).tolist()  # of the rate limit
PERIODS = (12.0, 24.0, 48.0, 96.0, 192.0)  # s
SHAPES = [
    {"period": period, "share": share, "dwell": dwell, "amplitude": amplitude}
    for period in (12.0, 24.0, 48.0)
    for share in (0.2, 0.35, 0.5, 0.65, 0.8)
    for dwell in (0.0, 1.0)
    for amplitude in (0.5, 0.7, 1.0)
]
_POPULATION, _ELITE, _ROUNDS = 32, 8, 6  # of the oracle's search, for each episode
_STRAY = 100.0  # by which a cost beyond its limit counts in that search


@dataclass(frozen=True, kw_only=True)
class Gate:
    """Settings of the study."""

    scenario: str = "flex"
    """Scenario to judge."""
    satellite: str = "microsat"
    """Satellite that flies in it."""
    inertia: str = "static"
    """Inertia mode."""
    cost: float = 0.01
    """Largest cost of each kind, as a share of the time."""
    tuned: int = 32
    """Episodes that judge a setting, tuning seeds."""
    episodes: int = 64
    """Episodes that are flown, validation seeds."""
    oracle: int = 32
    """Episodes of these that the oracle flies too; 0: no oracle."""
    output: Path = Path("results/gate.json")
    """File to write."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a name is unknown or a number is out of range.
        """
        check_names("scenario", [self.scenario], SCENARIOS)
        check_names("satellite", [self.satellite], SATELLITES)
        check_integer("tuned", self.tuned)
        check_integer("episodes", self.episodes)
        check_integer("oracle", self.oracle, low=0, high=self.episodes)


@dataclass(frozen=True)
class Flown:
    """Scores of N episodes.

    Attributes:
        expected: relative error that the filter expects, mean over the flight; infinite where it ended early.
        error: relative error at the end, or when it ended.
        nees: normalised estimation error squared, mean over the flight.
        costs: (N, costs).
        terminated: whether it ended early.
    """

    expected: np.ndarray
    error: np.ndarray
    nees: np.ndarray
    costs: np.ndarray
    terminated: np.ndarray

    def first(self, count: int) -> Flown:
        """The first so many episodes."""
        return Flown(*(getattr(self, name)[:count] for name in self.__dataclass_fields__))


def flown(gate: Gate, policy: Policy, flown_seeds: Sequence[int], told: bool = False) -> Flown:
    """Scores of a policy; `told`: it observes the true modes in place of the estimated ones."""
    settings = {"control": "rate", **observation_settings(policy)}
    env = SatInertiaIDVectorEnv(len(flown_seeds), gate.satellite, gate.inertia, gate.scenario, **settings)
    policy.reset(missions(env.problem)[0], flown_seeds)
    observation, info = env.reset(seed=list(flown_seeds))
    moments = env.problem.layout["inertia"].stop - env.problem.layout["inertia"].start
    count, steps = len(flown_seeds), env.problem.scenario.decisions
    alive, error = np.ones(count, bool), np.zeros(count)
    expected, nees, costs = np.zeros(count), np.zeros(count), np.zeros((count, len(COSTS)))
    lived = np.zeros(count)
    for _ in range(steps):
        if told:
            observation = _with_true_modes(env, observation)
        observation, _, terminated, _, info = env.step(policy(observation))
        lived += alive
        error = np.where(alive, info["relative_error"], error)
        expected += np.where(alive, np.exp(-info["information_held"] / moments), np.inf) / steps
        nees += np.where(alive, info["nees"], 0.0)
        costs += np.where(alive[:, None], np.stack([info["costs"][name] for name in COSTS], axis=1), 1.0) / steps
        alive &= ~terminated
    env.close()
    return Flown(expected, error, nees / lived, costs, ~alive)


def _with_true_modes(env: SatInertiaIDVectorEnv, observation: np.ndarray) -> np.ndarray:
    """Observations in which the modes' frequency and deflection are the true ones, known exactly."""
    rows, places = env.fleet.rows, dict(zip(MODE_PARTS, np.cumsum([0, *MODE_PARTS.values()]).tolist(), strict=False))
    modes, told = rows.beliefs["modes"], observation.copy()
    part = told[:, env.problem.layout["modes"]].reshape(len(told), -1, sum(MODE_PARTS.values()))
    o = rows.plants["oscillators"]
    period = env.problem.scenario.decision_period
    by_limit = part[:, 0, places["deflection_limit"]] / rows.tasks["deflection_limit"][:, 0]
    mean, rate = (o[name].mean(axis=1) for name in ("deflection", "speed"))  # of the pair
    if np.isfinite(rows.tasks["deflection_limit"]).all():
        part[:, 0, places["deflection"]] = mean * by_limit
        part[:, 0, places["deflection_rate"]] = rate / modes["frequency"][:, 0] * by_limit
    part[:, 0, places["frequency"]] = modes["frequency"][:, 0] * o["scale"][:, 0, 1] * period / (2.0 * np.pi)
    part[:, 0, places["frequency_std"]] = -10.0
    told[:, env.problem.layout["modes"]] = part.reshape(len(told), -1)
    return told


class Plan(ShapedSquarePolicy):
    """`shaped_square` with settings of its own for each episode, those of the oracle's search.

    Args:
        logs: (N, 7) logarithms of three periods over 24 s, of share over 0.6, dwell over 0.5 and amplitude over 0.8, and
            a shift of phase.
    """

    def __init__(self, logs: np.ndarray) -> None:
        super().__init__(caution=0.0)
        factors = np.exp(logs)
        self.period = 24.0 * factors[:, :3]  # type: ignore[assignment]
        self.share, self.dwell = 0.6 * factors[:, 3], 0.5 * factors[:, [4]]  # type: ignore[assignment]
        self.amplitude = np.minimum(0.8 * factors[:, [5]], 1.0)  # type: ignore[assignment]
        self._shift = logs[:, [6]]

    def reset(self, mission: Any, seeds: Sequence[int]) -> None:
        """Prepare, each episode with its own phase."""
        super().reset(mission, seeds)
        self._phase = self._phase[0] + 0.25 * self._shift


def search(gate: Gate, flown_seeds: Sequence[int]) -> Flown:
    """The oracle: of each episode the best flight that its search has found."""
    episodes, rng = len(flown_seeds), np.random.default_rng(0)
    mean, std = np.zeros((episodes, 1, 7)), np.full((episodes, 1, 7), 0.6)
    best: Flown | None = None
    for _ in tqdm(range(_ROUNDS), desc="oracle", unit="round"):
        logs = mean + std * rng.standard_normal((episodes, _POPULATION, 7))
        logs[:, 0] = mean[:, 0]
        flight = flown(gate, Plan(logs.reshape(-1, 7)), np.repeat(flown_seeds, _POPULATION).tolist(), told=True)
        beyond = np.maximum(flight.costs - gate.cost, 0.0).max(axis=1)
        value = (flight.expected * (1.0 + _STRAY * beyond)).reshape(episodes, -1)
        order = np.argsort(value, axis=1)
        chosen = order[:, 0] + _POPULATION * np.arange(episodes)
        here = Flown(*(getattr(flight, name)[chosen] for name in flight.__dataclass_fields__))
        best = here if best is None else _better(gate, best, here)
        elite = np.take_along_axis(logs, order[:, :_ELITE, None], axis=1)
        mean, std = elite.mean(axis=1, keepdims=True), 0.5 * std + 0.5 * elite.std(axis=1, keepdims=True)
    assert best is not None
    return best


def _better(gate: Gate, one: Flown, other: Flown) -> Flown:
    """Episode by episode the better of two flights."""
    value = [f.expected * (1.0 + _STRAY * np.maximum(f.costs - gate.cost, 0.0).max(axis=1)) for f in (one, other)]
    take = value[1] < value[0]
    return Flown(
        *(
            np.where(take.reshape(-1, *[1] * (getattr(one, name).ndim - 1)), getattr(other, name), getattr(one, name))
            for name in one.__dataclass_fields__
        )
    )


def rivals(gate: Gate) -> dict[str, list[tuple[dict[str, float], Policy]]]:
    """Settings to try of each policy, by its name."""
    loud: dict[str, list[tuple[dict[str, float], Policy]]] = {
        name: [({"amplitude": a}, ScriptedPolicy(name, profile, a)) for a in AMPLITUDES]
        for name, profile in PROFILES.items()
    }
    squares = [
        ({"period": period, "amplitude": a}, Quieter(RateSquarePolicy(period, 3.5), a))
        for period in PERIODS
        for a in AMPLITUDES
    ]
    shaped = [(shape, ShapedSquarePolicy(**shape)) for shape in SHAPES]
    return {
        "zero": [({}, ZeroPolicy())],
        "random": [({}, RandomPolicy())],
        **loud,
        "rate_square": squares,
        **({"shaped_square": shaped} if _has_limit(gate) else {}),
    }


def _has_limit(gate: Gate) -> bool:
    appendages = SCENARIOS[gate.scenario].appendages
    return appendages is not None and appendages.deflection_limit is not None


class Quieter:
    """A policy whose actions are taken by a factor."""

    def __init__(self, policy: Policy, factor: float) -> None:
        self.name, self.kind = policy.name, policy.kind
        self._policy, self._factor = policy, factor

    def reset(self, mission: Any, seeds: Sequence[int]) -> None:
        """Prepare the policy."""
        self._policy.reset(mission, seeds)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Its action, times the factor."""
        return self._factor * self._policy(observation)


def choose(gate: Gate, trials: Sequence[tuple[dict[str, float], Policy]]) -> tuple[dict[str, float], Policy]:
    """The settings with the least expected error inside all limits, on tuning seeds; else those with the least cost."""
    if len(trials) == 1:
        return trials[0]
    judged: list[tuple[bool, float, int]] = []
    for i, (_, policy) in enumerate(trials):
        flight = flown(gate, policy, seeds("tuning", gate.tuned))
        cost = float(flight.costs.mean(axis=0).max())
        outside = cost > gate.cost
        judged.append((outside, cost if outside else float(flight.expected.mean()), i))
    return trials[min(judged)[2]]


def row(name: str, settings: dict[str, float], flight: Flown) -> dict[str, Any]:
    """Line of the table."""
    return {
        "policy": name,
        "settings": settings,
        "episodes": len(flight.error),
        "expected": float(np.mean(flight.expected)) if np.isfinite(flight.expected).all() else None,
        "final_error": float(flight.error.mean()),
        "nees": float(flight.nees.mean()),
        "nees_median": float(np.median(flight.nees)),
        "costs": dict(zip(COSTS, flight.costs.mean(axis=0).tolist(), strict=True)),
        "terminated": float(flight.terminated.mean()),
    }


def show(gate: Gate, rows: list[dict[str, Any]]) -> None:
    """Print a line for each policy, and how the rungs of the ladder compare."""
    heads = ("expected, %", 12), ("final error, %", 15), ("NEES (median)", 14), ("largest cost, %", 22)
    print(f"{'policy':16s} " + " ".join(f"{head:>{width}s}" for head, width in heads) + " ended")
    for own in rows:
        worst = max(own["costs"], key=own["costs"].get)
        expected = "-" if own["expected"] is None else f"{100 * own['expected']:.4f}"
        nees, cost = f"{own['nees']:.2f} ({own['nees_median']:.2f})", f"{worst} {100 * own['costs'][worst]:.2f}"
        print(
            f"{own['policy']:16s} {expected:>12s} {100 * own['final_error']:15.4f} {nees:>14s} "
            f"{cost:>22s} {100 * own['terminated']:4.0f} %"
        )
    inside = [own for own in rows if own["expected"] and max(own["costs"].values()) <= gate.cost]
    named = {own["policy"]: own["expected"] for own in inside}
    print("inside all limits: " + ", ".join(named))


def main_rows(gate: Gate) -> list[dict[str, Any]]:
    """All lines of the table."""
    rows = []
    for name, trials in tqdm(rivals(gate).items(), desc=gate.scenario, unit="policy"):
        settings, policy = choose(gate, trials)
        rows.append(row(name, settings, flown(gate, policy, seeds("validation", gate.episodes))))
    if gate.oracle:
        rows.append(row("oracle", {}, search(gate, seeds("validation", gate.oracle))))
    return rows


@cli.on_interrupt("no file is written")
def main(gate: Gate) -> int:
    """Judge the scenario of the command line; returns the exit code."""
    check_writable(gate.output.parent)
    rows = main_rows(gate)
    head = result_head("baselines.studies.gate", gate, split="validation", seeds=seeds("validation", gate.episodes))
    write_json(gate.output, {**head, "rows": rows})
    show(gate, rows)
    return 0


if __name__ == "__main__":
    cli.run(main)
