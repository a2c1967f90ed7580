"""Effect of faults on filter and policies: `python -m baselines.studies.faults`.

Policies fly scenario "faults" with each fault alone, with all faults, and with none, once with a filter that accepts
every reading and once with a gated filter. The command prints a table and writes faults.json.
`python -m agents.benchmark.faults` flies the shipped policies as well.
Dropout, stuck tachometer and wheel loss begin at 40 % of the horizon in every episode of their rows.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table
from tqdm import tqdm

from baselines.command import cli
from baselines.command.provenance import result_head
from satid_gym.config import check_integer, check_names
from satid_gym.evaluation import FIRST_SEED, Flight, benchmark_scenario, fly, seeds
from satid_gym.faults import Faults
from satid_gym.files import check_writable, write_json
from satid_gym.laws import INERTIA_MODES
from satid_gym.metrics import SETTLING, final_error
from satid_gym.policies.registry import make_baseline
from satid_gym.policy import Policy
from satid_gym.satellite import SATELLITES
from satid_gym.scenario import Scenario

_ONSET = 0.4  # of the horizon, start of the faults
_RECOVERED = 0.005  # relative error of a recovered estimate
_RECOVERED_FOR = 10.0  # s for which the error must stay below it
_POSSIBLE = benchmark_scenario("faults").faults
_CERTAIN = _POSSIBLE.replace(
    time=(_ONSET, _ONSET),
    gyro_dropout=1.0,
    gyro_dropout_duration=(20.0, 20.0),
    gyro_dropout_silent=0.0,
    tachometer_stuck=1.0,
    tachometer_stuck_duration=(60.0, 60.0),
    wheel_loss=1.0,
    wheel_loss_size=(0.5, 0.5),
    torque_delay=(3, 3),
)
CASES: dict[str, tuple[Faults, float]] = {
    "none": (Faults(), 0.0),
    "gyro dropout, flagged": (_CERTAIN.only("gyro_dropout"), 20.0),
    "gyro dropout, silent": (_CERTAIN.only("gyro_dropout").replace(gyro_dropout_silent=1.0), 20.0),
    "gyro outliers": (_CERTAIN.only("gyro_outlier"), 0.0),
    "gyro bias": (_CERTAIN.only("gyro_bias_std"), 0.0),
    "tachometer stuck": (_CERTAIN.only("tachometer_stuck"), 60.0),
    "half a wheel's torque": (_CERTAIN.only("wheel_loss"), 0.0),
    "wheel failed": (_CERTAIN.only("wheel_loss").replace(wheel_loss_size=(1.0, 1.0)), 0.0),
    "commands late": (_CERTAIN.only("torque_delay"), 0.0),
    "all at once": (_CERTAIN.replace(gyro_dropout_silent=1.0), 60.0),
    "as drawn": (_POSSIBLE, 0.0),
}
"""Faults of each case, and their duration after the onset, s; 0 for faults that last."""


@dataclass(frozen=True, kw_only=True)
class FaultStudy:
    """Settings of the study."""

    satellites: tuple[str, ...] = ("microsat",)
    """Satellites to fly."""
    inertia: str = "drift"
    """Inertia mode."""
    policies: tuple[str, ...] = ("rate_square", "greedy_horizon", "multi_step")
    """Baselines to fly."""
    cases: tuple[str, ...] = tuple(CASES)
    """Cases of faults."""
    episodes: int = 100
    """Episodes of each row."""
    seed_split: str = "test"
    """Split of the seeds: training, tuning, validation or test."""
    output: Path = Path("results/faults.json")
    """File to write."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a name is unknown or the number of episodes is not positive.
        """
        check_names("satellite", self.satellites, SATELLITES)
        check_names("inertia mode", (self.inertia,), INERTIA_MODES)
        check_names("case", self.cases, CASES)
        check_names("split of seeds", (self.seed_split,), FIRST_SEED)
        check_integer("episodes", self.episodes)


def worlds(case: str) -> dict[str, Scenario]:
    """Scenario "faults" with a case's faults, by filter: "ungated" accepts every reading, "gated" is the scenario's."""
    world = benchmark_scenario("faults").replace(faults=CASES[case][0])
    if case == "none":
        world = world.replace(gyro_bias_walk=benchmark_scenario("default").gyro_bias_walk)
    return {"ungated": world.replace(estimator=world.estimator.replace(gate=0.0)), "gated": world}


def scores(flight: Flight, over: float) -> dict[str, float | None]:
    """Scores of a flight whose faults begin at 40 % of the horizon.

    Args:
        flight: time series.
        over: duration of the faults, s.

    Returns:
        final_error: mean. nees_before, nees_during, nees_after: mean over episodes that still run and are `settled`,
        from 60 s to the onset, from there to the end of the fault, and from 10 s after that on; None for an empty
        interval. nees_worst: 95 % quantile of the episodes' means of nees_after.
        recovery_s, recovery_s_95: median and 95 % quantile of `recovery`, None if infinite. outside, terminated:
        shares.
    """
    time, onset = flight.time, _ONSET * flight.time[-1]
    end = onset + over
    nees = np.where(flight.alive & flight.settled, flight.nees, np.nan)
    windows = {
        "before": (time > 60.0) & (time <= onset),
        "during": (time > onset) & (time <= end),
        "after": time > end + SETTLING,
    }
    means = {name: nees[window] for name, window in windows.items()}
    after = np.array([column[~np.isnan(column)].mean() for column in means["after"].T if not np.isnan(column).all()])
    back = recovery(flight, end)
    return {
        "final_error": float(final_error(flight.error).mean()),
        **{f"nees_{name}": _mean(values[~np.isnan(values)]) for name, values in means.items()},
        "nees_worst": _finite(np.quantile(after, 0.95)) if after.size else None,
        "recovery_s": _finite(np.median(back)),
        "recovery_s_95": _finite(np.quantile(back, 0.95, method="higher")),
        "outside": float(flight.outside.mean()),
        "terminated": float(flight.terminated.mean()),
    }


def recovery(flight: Flight, end: float) -> np.ndarray:
    """Time (N,) after `end`, s, until the error is at most 0.5 % and stays so for 10 s; infinite if never.

    The error is known at the end of each decision, the first of which ends at `end` or later; 10 s with decisions of
    1 s are eleven errors.
    """
    period = flight.time[1] - flight.time[0]
    late = flight.time > end - 1e-6 * period  # includes the decision that ends at `end`, in spite of rounding
    good = (flight.error[late] <= _RECOVERED) & flight.alive[late]
    span = round(_RECOVERED_FOR / period) + 1
    held = np.lib.stride_tricks.sliding_window_view(good, span, axis=0).all(axis=2)
    waited = np.maximum(flight.time[late][held.argmax(axis=0)] - end, 0.0)
    return np.where(held.any(axis=0), waited, np.inf)


def _mean(values: np.ndarray) -> float | None:
    return float(values.mean()) if values.size else None


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def run_study(settings: FaultStudy, policies: Mapping[str, Mapping[str, Policy]]) -> list[dict[str, Any]]:
    """Records of all flights, one for each satellite, case, policy and filter.

    Args:
        settings: settings of the study.
        policies: policies by satellite and name.
    """
    chosen = seeds(settings.seed_split, settings.episodes)  # type: ignore[arg-type]
    rows = [(s, case, name) for s in settings.satellites for case in settings.cases for name in policies[s]]
    records = []
    for satellite, case, name in tqdm(rows, desc="faults", unit="flight"):
        for kind, world in worlds(case).items():
            cell = {"satellite": satellite, "inertia": settings.inertia, "scenario": world}
            flown = fly(policies[satellite][name], seeds=chosen, **cell)
            names = {"satellite": satellite, "case": case, "policy": name, "filter": kind}
            records.append({**names, **scores(flown, CASES[case][1])})
    return records


def _table(results: Mapping[str, Any]) -> Table:
    table = Table(title="faults: ungated filter / gated filter", box=box.SIMPLE)
    for column in ("satellite", "case", "policy"):
        table.add_column(column)
    titles = {
        "final_error": "final error %",
        "nees_before": "NEES before",
        "nees_during": "during",
        "nees_after": "after",
        "nees_worst": "worst 5 %",
        "recovery_s": "recovery s",
        "recovery_s_95": "95 %",
        "outside": "outside %",
        "terminated": "ended %",
    }
    for title in titles.values():
        table.add_column(title, justify="right")
    records = results["records"]
    for one, other in zip(records[::2], records[1::2], strict=True):
        cells = []
        for key in titles:
            percent = 100.0 if key in ("final_error", "outside", "terminated") else 1.0
            cells.append(" / ".join("-" if r[key] is None else f"{percent * r[key]:.3g}" for r in (one, other)))
        table.add_row(one["satellite"], one["case"], one["policy"], *cells)
    return table


def main(settings: FaultStudy, learned: Sequence[Policy] = (), module: str = "baselines.studies.faults") -> int:
    """Run the study of the command line; returns the exit code.

    Args:
        settings: of the study.
        learned: policies to fly in addition to the baselines.
        module: module of the command.
    """
    with cli.user_errors():
        policies: dict[str, dict[str, Policy]] = {
            s: {name: make_baseline(name, s, "faults") for name in settings.policies} for s in settings.satellites
        }
    check_writable(settings.output.parent)
    for row in policies.values():
        row.update({policy.name: policy for policy in learned})
    results = {**result_head(module, settings), "records": run_study(settings, policies)}
    write_json(settings.output, results)
    console = Console(width=180) if not sys.stdout.isatty() else Console()
    console.print(_table(results))
    console.print(f"{results['command']}, revision {results['revision']}; {settings.output} written")
    return 0


if __name__ == "__main__":
    cli.run(main)
