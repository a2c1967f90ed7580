"""Coverage of the comparison's 95 % intervals: `python -m tests.qa.interval_coverage`.

Many comparisons of 100 episodes each are drawn from populations whose truth is known: lognormal ones, and the final
errors of real flights on validation seeds, drawn with replacement. The exit code is 1 where an interval
covers less than 93 % or more than 97 %.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, skew
from tqdm import tqdm

from agents.benchmark.summary.statistics import pair, record
from baselines import make_baseline
from baselines.command import cli
from satid_gym.config import check_integer, check_names
from satid_gym.evaluation import benchmark_scenario, fly, seeds
from satid_gym.laws import INERTIA_MODES
from satid_gym.metrics import improvements, iqm
from satid_gym.policies.learned.shipped import find
from satid_gym.satellite import SATELLITES

COVERED_MIN, COVERED_MAX = 0.93, 0.97
QUARTILE = float(norm.ppf(0.75))
FLOWN = ("generalist", "rate_square", "chirp", "zero")
Draw = Callable[[np.random.Generator, int], np.ndarray]


@dataclass(frozen=True, kw_only=True)
class Population:
    """Pairs of final errors of two policies on the same episodes, and what holds for all there are.

    Attributes:
        draw: (2, N) errors of N episodes.
        truth: of every statistic that has an interval.
    """

    draw: Draw
    truth: Mapping[str, float]


def lognormal(spread: float, noise: float, better: float) -> Population:
    """How hard an episode is times each policy's own noise, all lognormal; the first is better by exp(`better`)."""

    def draw(rng: np.random.Generator, count: int) -> np.ndarray:
        own = noise * rng.standard_normal((2, count)) - np.array([[better], [0.0]])
        return np.exp(spread * rng.standard_normal(count) + own)

    total = float(np.hypot(spread, noise))
    mean = np.exp(total**2 / 2 - better)
    middle = norm.cdf(QUARTILE - total) - norm.cdf(-QUARTILE - total)  # share of the mean between the quartiles
    truth = {
        "final_error": mean,
        "final_error_iqm": mean * middle / 0.5,
        "difference": mean * (1.0 - np.exp(better)),
        "probability_of_improvement": float(norm.cdf(better / (np.sqrt(2.0) * noise))),
    }
    return Population(draw=draw, truth=truth)


def flown(mine: np.ndarray, theirs: np.ndarray) -> Population:
    """Real final errors of two policies on the same seeds."""
    both = np.array([mine, theirs])
    truth = {
        "final_error": float(mine.mean()),
        "final_error_iqm": float(iqm(mine)),
        "difference": float((mine - theirs).mean()),
        "probability_of_improvement": float(improvements(mine, theirs).mean()),
    }
    return Population(draw=lambda rng, count: both[:, rng.integers(0, both.shape[1], count)], truth=truth)


SYNTHETIC = {
    "lognormal 1": lognormal(0.95, 0.3, 0.05),
    "lognormal .5": lognormal(0.4, 0.3, 0.6),
    "nearly always better": lognormal(0.4, 0.3, 1.2),
    "extreme pair": lognormal(1.0, 0.5, 0.6),
}


def misses(population: Population, count: int, simulations: int, seed: int = 0) -> dict[str, tuple[int, int]]:
    """How many of the simulated comparisons have an interval wholly above the truth, and wholly below it."""
    rng = np.random.default_rng(seed)
    found = dict.fromkeys(population.truth, (0, 0))
    for _ in range(simulations):
        mine, theirs = (_scores(errors) for errors in population.draw(rng, count))
        intervals = {**record(mine), **pair(mine, theirs)}
        for name, truth in population.truth.items():
            above, below = found[name]
            found[name] = (above + (intervals[f"{name}_lo"] > truth), below + (intervals[f"{name}_hi"] < truth))
    return found


def _scores(errors: np.ndarray) -> dict[str, np.ndarray]:
    """An episode's scores with these final errors; the others are of no interest here."""
    names = ("mean_error", "time_to_1pct_s", "outside_fraction", "information_nats", "nees", "effort")
    others = dict.fromkeys((*names, "saturated_fraction", "terminated", "reward", "cost"), np.zeros(len(errors)))
    return {**others, "final_error": errors}


@dataclass(frozen=True, kw_only=True)
class Study:
    """What to simulate."""

    simulations: int = 2000
    """Comparisons of each population."""
    episodes: int = 100
    """Episodes of each comparison."""
    flights: int = 2000
    """Episodes that make up a population of real errors."""
    satellite: str = "smallsat"
    """Satellite that is flown for them."""
    inertia: str = "step"
    """How its inertia varies."""

    def check(self) -> None:
        """Refuse what cannot be simulated.

        Raises:
            ValueError: a name is unknown or a number out of range.
        """
        check_names("satellite", (self.satellite,), SATELLITES)
        check_names("inertia mode", (self.inertia,), INERTIA_MODES)
        check_integer("simulations", self.simulations)
        check_integer("episodes", self.episodes, low=2)
        check_integer("flights", self.flights)


def real(study: Study) -> dict[str, Population]:
    """Every flown policy against the next one."""
    errors = {}
    for name in tqdm(FLOWN, desc="flying", unit="policy"):
        policy = find(name) if name == "generalist" else make_baseline(name, study.satellite)
        errors[name] = fly(
            policy,
            satellite=study.satellite,
            inertia=study.inertia,
            seeds=seeds("validation", study.flights),
            scenario=benchmark_scenario(),
        ).scores()["final_error"]
        print(f"{name}: mean {100 * errors[name].mean():.4f} %, skewness {skew(errors[name]):.1f}")
    pairs = zip(FLOWN, (*FLOWN[1:], FLOWN[0]), strict=True)
    return {f"{one} / {other}": flown(errors[one], errors[other]) for one, other in pairs}


def main(study: Study) -> int:
    """Print every coverage; the exit code."""
    populations = {**SYNTHETIC, **real(study)}
    held = True
    print(f"{'population':26s}{'interval of':30s}{'truth':>10s} {'covered':>9s} {'above':>7s} {'below':>7s}")
    for name, population in tqdm(populations.items(), desc="simulating", unit="population"):
        for statistic, (above, below) in misses(population, study.episodes, study.simulations).items():
            covered = 1.0 - (above + below) / study.simulations
            # wins are counts: near certainty no interval covers just 95 % of the time, so more than that is fine
            most = 1.0 if statistic == "probability_of_improvement" else COVERED_MAX
            short = not COVERED_MIN <= covered <= most
            held = held and not short
            shares = f"{covered:9.1%} {above / study.simulations:7.1%} {below / study.simulations:7.1%}"
            tqdm.write(f"{name:26s}{statistic:30s}{population.truth[statistic]:10.4g} {shares}{'  SHORT' * short}")
    return 0 if held else 1


if __name__ == "__main__":
    cli.run(main)
