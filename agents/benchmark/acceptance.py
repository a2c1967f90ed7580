"""Acceptance of the learned policies, claim by claim: `python -m agents.verdict`.

Reads what `python -m agents.compare --all` wrote (and `--scenario tight`, if it is there) and flies one satellite that
no policy has seen. Prints figures for every claim; the exit code is 1 where one falls short, and 2 where the results
lack a policy or a cell that a claim is about. With `--scenario NAME` the same of the results in that scenario.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from agents.benchmark.results import file_names, read_results
from agents.benchmark.summary.ranking import inside
from baselines.command import cli
from baselines.tuning.amplitudes import tune
from satid_gym import ReactionWheels, Satellite
from satid_gym.config import check_names
from satid_gym.control.planning.planner import PLANNING_MARGIN
from satid_gym.evaluation import benchmark_scenario, fly, seeds
from satid_gym.files import DamagedFileError
from satid_gym.laws import INERTIA_MODES
from satid_gym.policies.learned.shipped import find, names
from satid_gym.policies.mpc import MPCPolicy
from satid_gym.policies.registry import PLANNERS, build
from satid_gym.profiles import PROFILES
from satid_gym.satellite import BENCHMARK_SATELLITES, SATELLITES
from satid_gym.scenario_catalogue import SCENARIOS

Record = Mapping[str, Any]
Claim = tuple[str, str, bool]  # what is asked, what was found, whether it holds
CLOSED_LOOPS = ("rate_square", "greedy", "greedy_horizon", "mpc")  # baselines that observe: the rivals
UNSEEN = Satellite(
    "unseen",
    np.array([2.1, 2.6, 1.7]),
    ReactionWheels(inertia=np.array(6e-4), max_torque=np.array(0.035), max_speed=np.array(750.0)),
    rate_limit=0.035,
    gyro_noise_std=6e-5,
    disturbance_std=3e-5,
)
_MICROSAT = SATELLITES["microsat"]
TILTED = _MICROSAT.replace(
    name="tilted",
    wheels=_MICROSAT.wheels.replace(
        axes=Rotation.from_rotvec(np.radians(35.0) * np.ones(3) / np.sqrt(3.0)).as_matrix()
    ),
)
PYRAMID = _MICROSAT.replace(
    name="pyramid",
    inertia=[[6.5, 0.4, -0.3], [0.4, 6.0, 0.5], [-0.3, 0.5, 4.5]],
    wheels=ReactionWheels(
        axes=np.array([[1, 1, -1, -1], [1, -1, 1, -1], [1, -1, -1, 1]]) / np.sqrt(3.0),
        inertia=np.array(2e-3),
        max_torque=np.array(0.1),
        max_speed=np.array(900.0),
    ),
)


def cells(records: Sequence[Record]) -> Iterator[dict[str, Record]]:
    """The records of each cell by policy."""
    for key in dict.fromkeys((r["satellite"], r["inertia_mode"]) for r in records):
        yield {r["policy"]: r for r in records if (r["satellite"], r["inertia_mode"]) == key}


def _largest(values: Sequence[float], limit: float, form: str = "{:.3f}") -> tuple[str, bool]:
    text = ", ".join(form.format(v) for v in values)
    return f"largest {form.format(max(values))} of {text}", max(values) <= limit


def needed_efficiency(results: Mapping[str, Any], policy: str) -> list[float]:
    """Excitation efficiency needed to reach a third of the best profile's final error, by cell; 1 is the limit.

    Both are related to the reference limit of `baselines.studies.performance_bound`. With a fixed process noise no
    excitation reaches more than 1; for an AdaptiveEKF the limit is that of the best fixed one, a reference, no bound.
    """
    reached = [e["excitation_efficiency"] for e in results["efficiencies"] if e["policy"] == policy]
    return [r * 3.0 * ratio for r, ratio in zip(reached, over_best_profile(results["records"], policy), strict=True)]


def over_best_profile(records: Sequence[Record], policy: str) -> list[float]:
    """Final error over that of the best of the paper's eight inside the envelope, by cell."""
    return [
        cell[policy]["final_error_mean"] / min(r["final_error_mean"] for r in inside([cell[n] for n in PROFILES]))
        for cell in cells(records)
    ]


def clearly_behind(results: Mapping[str, Any], policy: str) -> int:
    """Cells where a closed loop inside the envelope has less final error, the paired 95 % interval apart from 0."""
    count = 0
    for cell in cells(results["records"]):
        own = cell[policy]
        rivals = {r["policy"] for r in inside([r for r in cell.values() if r["kind"] == "closed_loop"])}
        count += any(
            pair["difference_lo"] > 0.0
            for pair in results["pairs"]
            if (pair["policy"], pair["satellite"], pair["inertia_mode"])
            == (policy, own["satellite"], own["inertia_mode"])
            and pair["other"] in rivals
        )
    return count


def benchmark_claims(results: Mapping[str, Any], policy: str) -> list[Claim]:
    """The claims on the twelve cells of a scenario."""
    records = results["records"]
    mean, apart, first = [], [], []
    mine = [cell[policy] for cell in cells(records)]
    for cell in cells(records):
        own = cell[policy]
        eight = inside([cell[name] for name in PROFILES])
        best = min(eight, key=lambda r: r["final_error_mean"])
        apart.append(own["final_error_hi"] < best["final_error_lo"])
        mean.append(own["mean_error_mean"] / min(r["mean_error_mean"] for r in eight))
        first.append(own["time_to_1pct_s"] or np.inf)
    outside, early = max(r["outside_fraction"] for r in mine), max(r["terminated_fraction"] for r in mine)
    nees = [np.inf if r["nees"] is None else r["nees"] for r in mine]  # None: no episode flew long enough
    return [
        ("final error over the best of the eight, at most 1/3", *_largest(over_best_profile(records, policy), 1 / 3)),
        ("... with intervals apart, in all cells", f"{sum(apart)} of {len(apart)}", all(apart)),
        ("mean error over the best of the eight, at most 1/5", *_largest(mean, 1 / 5)),
        ("median time to 1 %, at most 3 s", *_largest(first, 3.0, "{:.1f}")),
        (
            "share of time outside, at most 1 %; none ended",
            f"{outside:.2%}; {early:.0%}",
            outside <= 0.01 and early == 0,
        ),
        *closed_loop_claims(results, policy),
        ("NEES between 0.3 and 2", f"{min(nees):.2f} to {max(nees):.2f}", min(nees) >= 0.3 and max(nees) <= 2.0),
    ]


def closed_loop_claims(results: Mapping[str, Any], policy: str) -> list[Claim]:
    """The claims against the best closed loop of each cell."""
    behind, behind_mean = [], []
    for cell in cells(results["records"]):
        own = cell[policy]
        loops = inside([r for r in cell.values() if r["kind"] == "closed_loop"])
        behind.append(own["final_error_mean"] / min(r["final_error_mean"] for r in loops))
        behind_mean.append(own["mean_error_mean"] / min(r["mean_error_mean"] for r in loops))
    clear, count = clearly_behind(results, policy), len(behind)
    better = sum(final < 1.0 and mean < 1.0 for final, mean in zip(behind, behind_mean, strict=True))
    return [
        ("final error over the best closed loop, at most 1", *_largest(behind, 1.0)),
        ("mean error over the best closed loop, at most 1", *_largest(behind_mean, 1.0)),
        ("cells where a closed loop is better beyond the paired interval", f"{clear} of {count}", clear == 0),
        ("better in both, in at least half of the cells", f"{better} of {count}", 2 * better >= count),
    ]


def tight_claims(results: Mapping[str, Any], policy: str) -> list[Claim]:
    """The claims on scenario "tight"."""
    final = over_best_profile(results["records"], policy)
    saturated = [100.0 * cell[policy]["saturated_fraction"] for cell in cells(results["records"])]
    return [
        ("tight: final error over the best of the eight, at most 1/3", *_largest(final, 1 / 3)),
        ("tight: wheels saturated, at most 1 % of the time", *_largest(saturated, 1.0, "{:.2f}")),
    ]


def unseen_claims(policy: str, episodes: int, scenario: str) -> list[Claim]:
    """The claim on a satellite between cubesat and smallsat; what is tuned is tuned for it on tuning seeds."""
    rivals = [build(name, tune(name, UNSEEN, scenario).settings) for name in ("rate_square", "mpc")]
    world, ratios = benchmark_scenario(scenario), []
    for mode in INERTIA_MODES:
        own, *others = (
            fly(pilot, satellite=UNSEEN, inertia=mode, seeds=seeds("test", episodes), scenario=world)
            .scores()["final_error"]
            .mean()
            for pilot in (find(policy), *rivals)
        )
        ratios.append(float(own / min(others)))
    return [
        ("unseen satellite: final error over the better of rate_square and mpc, at most 1.5", *_largest(ratios, 1.5))
    ]


def geometry_claims(policy: str, episodes: int, scenario: str) -> list[Claim]:
    """The claims on wheels that are not along the body axes, and on four of them with a full tensor.

    The policy flies the first, which has as many wheels and inertia parameters as those that it was trained on;
    rate_square and mpc fly both.
    """
    world = benchmark_scenario(scenario)
    closed_loops = [build("rate_square", {"period": 24.0, "margin": PLANNING_MARGIN}), build("mpc", {})]
    claims = []
    for constants, pilots in ((TILTED, [find(policy), *closed_loops]), (PYRAMID, closed_loops)):
        outside = [
            100.0
            * fly(pilot, satellite=constants, inertia="random", seeds=seeds("test", episodes), scenario=world)
            .scores()["outside_fraction"]
            .mean()
            for pilot in pilots
        ]
        asked = f"{constants.name}: time outside of {', '.join(pilot.name for pilot in pilots)}, at most 1 %"
        claims.append((asked, *_largest(outside, 1.0, "{:.2f}")))
    return claims


def missing(results: Mapping[str, Any], needed: Sequence[str], judged: Sequence[str]) -> str | None:
    """Data that the verdict needs and the results lack, in words; None if complete.

    Args:
        results: as compare.json has them.
        needed: policies that must have flown in every cell of the benchmark.
        judged: those of them that are judged: against each closed loop among `needed` in pairs, and, where there are
            efficiencies, with theirs.
    """
    places = [(satellite, mode) for satellite in BENCHMARK_SATELLITES for mode in INERTIA_MODES]
    lacks = []
    flown = {(r["satellite"], r["inertia_mode"]) for r in results["records"]}
    if cells_left := ["/".join(place) for place in places if place not in flown]:
        lacks.append(f"cells {', '.join(cells_left)}")
    by_place = {(r["policy"], r["satellite"], r["inertia_mode"]) for r in results["records"]}
    if absent := [name for name in needed if any((name, *place) not in by_place for place in places if place in flown)]:
        lacks.append(f"policies {', '.join(absent)}")
    matches = {(p["policy"], p["other"], p["satellite"], p["inertia_mode"]) for p in results["pairs"]}
    rivals = [name for name in needed if name in CLOSED_LOOPS]
    if not lacks and any((own, other, *p) not in matches for own in judged for other in rivals for p in places):
        lacks.append("pairs of a judged policy with a closed loop")
    reached = {(e["policy"], e["satellite"], e["inertia_mode"]) for e in results["efficiencies"]}
    if not lacks and reached and any((own, *p) not in reached for own in judged for p in places):
        lacks.append("efficiencies of a judged policy")
    return "; ".join(lacks) or None


def _complete(file: Path, scenario: str, needed: Sequence[str], judged: Sequence[str]) -> dict[str, Any]:
    """The results of a file, which must have all that a verdict takes.

    Raises:
        DamagedFileError: they have not; the message says what is missing and which command makes it.
    """
    results = read_results(file, REMEDY, keys=_KEYS)
    if lacks := missing(results, needed, judged):
        planners = ["--all"] if any(name in PLANNERS for name in needed) else []
        options = [*planners, "--scenario", scenario, "--output", str(file.parent)]
        made = shlex.join(["python", "-m", "agents.compare", *options])
        raise DamagedFileError(f"{file} lacks what the verdict needs, {lacks}: run {made}")
    return results


TEACHER = MPCPolicy.name  # of the policies that agents.imitate makes
_KEYS = ("records", "pairs", "efficiencies")
REMEDY = "run python -m agents.compare --all (with --scenario NAME for that of another scenario)"


@dataclass(frozen=True, kw_only=True)
class AcceptanceCheck:
    """What to judge."""

    policies: tuple[str, ...] = ("generalist",)
    """Shipped policies to judge, which the results must have."""
    results: Path = Path("results")
    """Folder with compare.json and compare_tight.json, or with the file of the scenario."""
    scenario: str = "default"
    """Scenario to judge in; the claims on "tight" belong to the default one."""
    episodes: int = 100
    """Episodes of each inertia mode on the unseen satellite, and of all modes on tilted wheels and on the pyramid."""


def main(acceptance: AcceptanceCheck) -> int:
    """Print every claim with its figures; the exit code."""
    with cli.user_errors():
        check_names("scenario", (acceptance.scenario,), SCENARIOS)
        check_names("learned policy", acceptance.policies, names())
    file, tight = (acceptance.results / file_names(scenario)["results"] for scenario in (acceptance.scenario, "tight"))
    scripted = (*PROFILES, *acceptance.policies)
    results = _complete(file, acceptance.scenario, (*scripted, *CLOSED_LOOPS), acceptance.policies)
    narrow = None
    if acceptance.scenario == "default" and tight.is_file():
        narrow = _complete(tight, "tight", scripted, acceptance.policies)
    records, held = results["records"], True
    for policy in acceptance.policies:
        claims = benchmark_claims(results, policy)
        needed = {"": needed_efficiency(results, policy)} if results["efficiencies"] else {}
        if narrow is not None:
            claims += tight_claims(narrow, policy)
            needed["tight: "] = needed_efficiency(narrow, policy)
        claims += unseen_claims(policy, acceptance.episodes, acceptance.scenario)
        claims += geometry_claims(policy, acceptance.episodes, acceptance.scenario)
        for asked, found, holds in claims:
            print(f"{'holds' if holds else 'SHORT':5s}  {policy}: {asked}: {found}")
            held = held and holds
        if find(policy).details.get("trained", {}).get("method") == "imitation":
            others = [r for r in records if r["policy"] != TEACHER]
            for asked, found, _ in closed_loop_claims({**results, "records": others}, policy):
                print(f"note   without its teacher {TEACHER}: {asked}: {found}")
        for scenario, values in needed.items():
            print(f"note   {scenario}excitation efficiency that 1/3 would take, of 1: {_largest(values, 1.0)[0]}")
    return 0 if held else 1
