"""Rerun of the paper's study, with tables, figures and a page: `python -m baselines.paper`.

It flies every profile on every satellite with static and time-varying inertia, and runs the paper's two estimators and
ours on the same readings. It takes two to three minutes on two cores.
"""

from __future__ import annotations

import csv
import dataclasses
import io
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from baselines.command import cli
from baselines.command.provenance import result_head
from baselines.paper.exceedance import ekf_exceedances
from baselines.paper.figures import bars, horizon, pipeline, profiles
from baselines.paper.page import page
from baselines.paper.study import HORIZON, EpisodeScore, horizon_jobs, run_all, table_jobs
from baselines.paper.summary import cells, checks, finite
from baselines.paper.world import MOMENTUM_SETTINGS, scenario
from satid_gym.config import check_integer
from satid_gym.estimators import RateEKFSettings
from satid_gym.evaluation import seeds
from satid_gym.files import check_writable, write_json, write_text


@dataclass(frozen=True, kw_only=True)
class PaperStudy:
    """Settings of the study."""

    seeds: int = 10
    """Episodes of each cell."""
    output: Path = Path("results/paper")
    """Folder for all results."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: the number of seeds is not positive.
        """
        check_integer("seeds", self.seeds)


def main(study: PaperStudy) -> int:
    """Run the study of the command line; returns the exit code."""
    check_writable(study.output)
    start = time.perf_counter()
    jobs = [*table_jobs(study.seeds), *horizon_jobs(study.seeds)]
    runs = run_all(jobs)
    table_runs = [run for run in runs if run.horizon == HORIZON]
    found = cells(runs)
    met = checks(found)
    used = seeds("test", study.seeds)
    exceedances = ekf_exceedances(found, used)
    packages = ("satid-gym", "numpy", "scipy", "numba", "matplotlib")
    provenance = result_head("baselines.paper", split="test", seeds=used, packages=packages)
    settings = {
        "scenario": scenario().to_dict(),
        "ekf": RateEKFSettings().to_dict(),
        "momentum_ekf": MOMENTUM_SETTINGS.to_dict(),
    }
    _write_csv(study.output / "cells.csv", [dataclasses.asdict(cell) for cell in found])
    _write_csv(study.output / "runs.csv", [dataclasses.asdict(run) for run in runs])
    write_json(
        study.output / "paper.json",
        {
            **provenance,
            "settings": settings,
            "checks": [dataclasses.asdict(check) for check in met],
            "ekf_exceedances": [dataclasses.asdict(exceedance) for exceedance in exceedances],
            "cells": [_plain(dataclasses.asdict(cell)) for cell in found],
            "runs": [_plain(dataclasses.asdict(run)) for run in runs],
        },
    )
    profiles.draw(study.output)
    pipeline.draw(study.output, used)
    bars.draw(study.output, found)
    horizon.draw(study.output, _static(runs))
    write_text(study.output / "paper.md", page(found, _static(runs), met, exceedances, provenance))
    for check in met:
        print(f"{'met    ' if check.met else 'NOT MET'}  {check.claim}: {check.found}")
    print(f"{len(table_runs)} runs in the tables; {study.output} written; {time.perf_counter() - start:.0f} s")
    return 0 if all(check.met for check in met) else 1


def _static(runs: Sequence[EpisodeScore]) -> list[EpisodeScore]:
    return [run for run in runs if run.inertia_mode == "static"]


def _plain(record: dict[str, Any]) -> dict[str, Any]:
    """Record with None for values that are not finite."""
    return {name: finite(value) if isinstance(value, float) else value for name, value in record.items()}


def _write_csv(path: Path, records: Sequence[dict[str, Any]]) -> None:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(records[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(records)
    write_text(path, text.getvalue())


if __name__ == "__main__":
    cli.run(main)
