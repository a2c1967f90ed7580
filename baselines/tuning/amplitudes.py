"""Best settings of every baseline: `python -m baselines.tune`.

A setting is judged on the tuning seeds, which neither training nor the benchmark uses, over the four inertia
modes with the paper's laws. Rule: of the settings that spend at most 1 % of the time beyond the envelope, with a
body rate outside its limit or a wheel at its, the one with the lowest mean final error. If no setting does,
because the motors' noise alone drives an open loop out, the same among those that are beyond it at most 1 % of
the time more than no torque at all is, and failing that the one that is beyond it least; both are marked
"inside": false. In scenario "paper" the eight profiles keep the paper's amplitudes.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tqdm import tqdm

from baselines.command import cluster
from baselines.command.provenance import result_head
from baselines.tuning.prepared import check_output, definitions, merged
from satid_gym.config import check_integer, check_names
from satid_gym.evaluation import Flight, benchmark_scenario, fly, seeds
from satid_gym.files import check_writable, write_json
from satid_gym.metrics import BEYOND_MAX, beyond_envelope
from satid_gym.policies import grids
from satid_gym.policies.grids import Settings
from satid_gym.policies.registry import BASELINES, TUNED, build
from satid_gym.resolution import ScenarioLike, resolve_scenario
from satid_gym.satellite import BENCHMARK_SATELLITES, Satellite
from satid_gym.selection import select_satellites, select_scenarios

HOPELESS = 0.1  # beyond this share of the time more amplitude is not tried: it only leads further out
FINER = (0.89, 0.945, 1.06, 1.12)  # what is tried about the best amplitude


@dataclass(frozen=True, kw_only=True)
class Trial:
    """Settings and their mean scores over the tuning episodes."""

    settings: Settings
    final_error: float
    outside_fraction: float
    saturated_fraction: float

    @property
    def beyond(self) -> float:
        """Share of the time beyond the envelope."""
        return beyond_envelope(self.outside_fraction, self.saturated_fraction)

    @property
    def inside(self) -> bool:
        """Whether they keep to the envelope."""
        return self.beyond <= BEYOND_MAX


def grid(name: str, satellite: Satellite, scenario: ScenarioLike) -> list[list[Settings]]:
    """Settings to try, the grid of the baseline's entry in the registry.

    Raises:
        ValueError: the baseline is unknown, has no settings to tune, or has no grid.
    """
    check_tunable([name])
    own = BASELINES[name].grid
    assert own is not None  # as checked
    return own(satellite, resolve_scenario(scenario).name)


def tunable() -> list[str]:
    """Names of the baselines that have settings to tune."""
    return [name for name, baseline in BASELINES.items() if baseline.tuned]


def check_tunable(names: Sequence[str]) -> None:
    """Refuse baselines that cannot be tuned.

    Raises:
        ValueError: one is unknown, has no settings to tune, or has no grid; the message says what to do.
    """
    check_names("baseline", names, BASELINES)
    for name in names:
        entry = "its entry in satid_gym.policies.registry.BASELINES"
        if not BASELINES[name].tuned:
            raise ValueError(f"baseline {name!r} has no settings to tune: {entry} says tuned=False")
        if BASELINES[name].grid is None:
            raise ValueError(
                f"baseline {name!r} has no grid of settings to try: give {entry} a grid, a function of satellite and "
                "scenario as satid_gym.policies.grids has them, or tuned=False if it has no settings to tune"
            )


def best(trials: Sequence[Trial], zero: float) -> Trial:
    """The trial that the rule chooses, given the share of time that no torque at all spends beyond the envelope."""
    for limit in (BEYOND_MAX, zero + BEYOND_MAX):
        within = [t for t in trials if t.beyond <= limit]
        if within:
            return min(within, key=lambda t: t.final_error)
    return min(trials, key=lambda t: t.beyond)


def edge(trial: Trial) -> bool:
    """Whether a setting is the lowest amplitude that was tried: the best that the signal can do is next to nothing."""
    return trial.settings.get("amplitude", 1.0) <= grids.AMPLITUDES[0]


def idle(satellite: Satellite, scenario: ScenarioLike, episodes: int) -> float:
    """Share of the time that no torque at all spends beyond the envelope."""
    return attempt("zero", {}, satellite, scenario, episodes=episodes).beyond


def sweep(name: str, satellite: Satellite, scenario: ScenarioLike, zero: float, *, episodes: int) -> list[Trial]:
    """All settings of a baseline that are worth trying, tried: the grid, and amplitudes close to the best of it.

    Args:
        name: of the baseline.
        satellite, scenario: where it flies.
        zero: of `idle`, by which the best is chosen.
        episodes: that judge a setting; see `judging`.
    """
    count = judging(name, episodes)
    trials: list[Trial] = []
    for row in grid(name, satellite, scenario):
        for settings in row:
            trials.append(attempt(name, settings, satellite, scenario, episodes=count))
            if trials[-1].outside_fraction > (BEYOND_MAX if "margin" in settings else HOPELESS):
                break
    if "amplitude" in trials[0].settings and resolve_scenario(scenario).name != "paper":
        top = best(trials, zero).settings
        for factor in FINER:
            finer = {**top, "amplitude": round(min(top["amplitude"] * factor, 1.0), 5)}
            trials.append(attempt(name, finer, satellite, scenario, episodes=count))
    return trials


def tune(name: str, satellite: Satellite, scenario: ScenarioLike = "default", *, episodes: int = 100) -> Trial:
    """Best settings of a baseline for any satellite in one of the scenarios."""
    zero = idle(satellite, scenario, episodes)
    return best(sweep(name, satellite, scenario, zero, episodes=episodes), zero)


def judging(name: str, episodes: int) -> int:
    """Episodes that judge a setting of a baseline: two fifths of them for planners, which are slow."""
    return max(1, episodes * 2 // 5) if BASELINES[name].planner else episodes


def attempt(name: str, settings: Settings, satellite: Satellite, scenario: ScenarioLike, *, episodes: int) -> Trial:
    """Mean scores of one baseline with given settings over the tuning episodes."""
    flight = fly(
        build(name, settings),
        satellite=satellite,
        inertia="random",
        seeds=seeds("tuning", episodes),
        scenario=benchmark_scenario(scenario),
        num_threads=1,  # cells are tuned side by side
    )
    return judge(settings, flight)


def judge(settings: Settings, flight: Flight) -> Trial:
    """Settings and the mean scores of what they flew."""
    scores = flight.scores()
    names = ("final_error", "outside_fraction", "saturated_fraction")
    return Trial(settings=settings, **{name: float(scores[name].mean()) for name in names})


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """What to tune, and where to keep it."""

    episodes: int = 100
    """Episodes that judge a setting."""
    scenarios: tuple[str, ...] = ("default", "tight", "paper")
    """Scenarios to tune for: names, .json or .toml files, or module:name (runs the module's code)."""
    satellites: tuple[str, ...] = BENCHMARK_SATELLITES
    """Satellites to tune for: names, .json or .toml files, or module:name (runs the module's code)."""
    output: Path = TUNED
    """JSON file that the baselines read, other entries of which stay; another one is taken by the option --tuned of
    other commands."""
    trials: Path | None = None
    """Where to write every setting tried, as JSON."""
    ray: cluster.RayAddress = None
    """Tune on a Ray cluster: auto, HOST:PORT, ray://HOST:PORT, or local for one of this machine."""

    def check(self) -> None:
        """Refuse what cannot be tuned.

        Raises:
            ValueError: a name is unknown or taken by another, what a file holds is not valid, there is no episode, a
                baseline has no grid, or custom settings would be written among the shipped ones.
            DamagedFileError: the output is a file of something else.
        """
        check_output(self.satellites, self.scenarios, self.output, TUNED)
        check_integer("episodes", self.episodes)
        check_tunable(tunable())


def run(tuning: Tuning) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Tune every baseline that has settings: the contents of the JSON file, and all trials behind them."""
    names, episodes = tunable(), tuning.episodes
    scenarios, satellites = select_scenarios(tuning.scenarios), select_satellites(tuning.satellites)
    cells = [(s, satellite, name) for s in scenarios for satellite in satellites for name in names]
    entries: list[dict[str, Any]] = []
    tried: list[dict[str, Any]] = []
    zeros = {(s.name, satellite.name): idle(satellite, s, episodes) for s in scenarios for satellite in satellites}
    with cluster.executor(tuning.ray) as pool:
        sweeps = [
            pool.submit(sweep, name, satellite, s, zeros[s.name, satellite.name], episodes=episodes)
            for s, satellite, name in cells
        ]
        bar = tqdm(sweeps, total=len(cells), desc="tuning", unit="baseline")
        for (world, satellite, name), swept in zip(cells, bar, strict=True):
            trials = swept.result()
            place = {"policy": name, "satellite": satellite.name, "scenario": world.name}
            chosen = best(trials, zeros[world.name, satellite.name])
            found = {**dataclasses.asdict(chosen), "inside": chosen.inside, "edge": edge(chosen)}
            entries.append({**place, **found, "episodes": judging(name, episodes)})
            tried += [{**place, **dataclasses.asdict(trial)} for trial in trials]
    tuned = {
        **result_head("baselines.tune", split="tuning", seeds=seeds("tuning", episodes)),
        "inertia": "one of static, step, drift, periodic at random, the paper's laws",
        "rule": (
            f"lowest mean final error with at most {BEYOND_MAX:.0%} of the time beyond the envelope, of rates or "
            f"wheel speeds; else with at most {BEYOND_MAX:.0%} more than zero torque has; else least beyond"
        ),
        "grid": {
            "amplitude": grids.AMPLITUDES,
            "staggered_square.period": grids.STAGGERED_PERIODS,
            "rate_square.period": grids.RATE_PERIODS,
            "rate_square.margin": grids.MARGINS,
            "margin of planners": grids.MARGINS,
        },
        "definitions": definitions(satellites, scenarios),
        "entries": entries,
    }
    return tuned, tried


def main(settings: Tuning) -> int:
    """Tune what the command line asks for; the exit code."""
    for path in (settings.output, settings.trials or settings.output):
        check_writable(path.parent)
    tuned, tried = run(settings)
    write_json(settings.output, merged(settings.output, tuned))
    if settings.trials is not None:
        write_json(settings.trials, tried)
    return 0
