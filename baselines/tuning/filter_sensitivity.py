"""Sensitivity of the AdaptiveEKF to its settings: `python -m baselines.tuning.filter_sensitivity`.

Flights on the tuning seeds, over satellites, inertia modes with the paper's laws and policies that excite well and
less well, are recorded once; every setting filters the same readings. One setting at a time is halved and doubled.
Prints final and mean error of each over those of the default, geometric means over satellites and policies, and
between what the NEES lies.
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
from baselines.studies.recording import Recording, record
from satid_gym import metrics
from satid_gym.config import check_integer, check_names
from satid_gym.estimators import AdaptiveEKF
from satid_gym.estimators.inertia import inertia_parameters, inertia_tensors
from satid_gym.evaluation import benchmark_scenario, seeds
from satid_gym.files import check_writable, write_json
from satid_gym.law_ranges import PAPER_LAWS
from satid_gym.laws import INERTIA_MODES
from satid_gym.policies.registry import BASELINES, make_baseline
from satid_gym.satellite import BENCHMARK_SATELLITES, SATELLITES
from satid_gym.scenario import prior_of

VARIED = ("inertia_walk", "inertia_walk_min", "log_q_drift")


@dataclass(frozen=True, kw_only=True)
class Study:
    """What to fly."""

    episodes: int = 12
    """Episodes of each policy in each cell."""
    satellites: tuple[str, ...] = BENCHMARK_SATELLITES
    """Satellites to fly."""
    policies: tuple[str, ...] = ("rate_square", "multi_step", "prbs")
    """Baselines to fly."""
    output: Path = Path("results/tune_filter.json")
    """File to write."""

    def check(self) -> None:
        """Refuse what cannot be flown.

        Raises:
            ValueError: a name is unknown or there is no episode.
        """
        check_names("satellite", self.satellites, SATELLITES)
        check_names("policy", self.policies, BASELINES)
        check_integer("episodes", self.episodes)


def variants() -> list[dict[str, float]]:
    """The default, and each setting halved and doubled by itself."""
    default = AdaptiveEKF().settings
    return [{}, *({name: factor * getattr(default, name)} for name in VARIED for factor in (0.5, 2.0))]


def filtered(settings: dict[str, float], satellite: str, recording: Recording, mode: str) -> dict[str, float]:
    """Mean scores of a filter on recorded readings."""
    prior, dt = prior_of(SATELLITES[satellite], benchmark_scenario()), recording.dt
    truth = inertia_parameters(recording.motion.inertia, prior.needed_parameters)
    time = dt * np.arange(truth.shape[1])
    error, nees = np.empty(truth.shape[1::-1]), np.empty(truth.shape[1::-1])
    for i, (gyro, tachometer) in enumerate(zip(recording.gyro, recording.tachometer, strict=True)):
        run = AdaptiveEKF(**settings).run(prior, gyro, tachometer, dt)
        apart = run.inertia - truth[i]
        error[:, i] = metrics.relative_error(inertia_tensors(run.inertia), recording.motion.inertia[i])
        solved = np.linalg.solve(run.inertia_covariance, apart[:, :, None])[:, :, 0]
        nees[:, i] = (apart * solved).sum(axis=1) / truth.shape[2]
    stepped = np.full(nees.shape, mode == "step") & (time >= PAPER_LAWS.step_time[0] * time[-1])[:, None]
    turning = metrics.turns(recording.motion.rate, SATELLITES[satellite].rate_limit).T
    return {
        "final_error": float(metrics.final_error(error).mean()),
        "mean_error": float(metrics.mean_error(error).mean()),
        "nees": float(np.mean(metrics.consistency(nees[1:], metrics.settled(stepped, turning, dt)[1:]))),
    }


def run(study: Study) -> dict[str, Any]:
    """All variants on all flights, as the JSON file has them."""
    chosen = seeds("tuning", study.episodes)
    cells = [(p, s, m) for p in study.policies for s in study.satellites for m in INERTIA_MODES]
    records = []
    for policy, satellite, mode in tqdm(cells, desc="filtering", unit="cell"):
        recording = record(
            make_baseline(policy, satellite),
            satellite=satellite,
            inertia=mode,
            seeds=chosen,
            scenario=benchmark_scenario(),
        )
        cell = {"policy": policy, "satellite": satellite, "inertia_mode": mode}
        records += [{**cell, "settings": each, **filtered(each, satellite, recording, mode)} for each in variants()]
    return {
        **result_head("baselines.tuning.filter_sensitivity", study, split="tuning", seeds=chosen),
        "records": records,
    }


def relative(records: Sequence[dict[str, Any]], settings: dict[str, float], mode: str, score: str) -> float:
    """Geometric mean of a score over that of the default, over satellites and policies."""
    own, default = (
        np.array([r[score] for r in records if r["settings"] == each and r["inertia_mode"] == mode])
        for each in (settings, {})
    )
    return float(np.exp(np.log(own / default).mean()))


def show(records: Sequence[dict[str, Any]]) -> None:
    """Print what each variant changes."""
    print("final, mean error over the default's, and lowest to highest NEES")
    print(f"{'':22s}" + "".join(f"{mode:>24s}" for mode in INERTIA_MODES))
    for settings in variants():
        name = " ".join(f"{k} {v:g}" for k, v in settings.items()) or "default"
        line = f"{name:22s}"
        for mode in INERTIA_MODES:
            nees = [r["nees"] for r in records if r["settings"] == settings and r["inertia_mode"] == mode]
            ratios = "".join(f"{relative(records, settings, mode, s):5.2f} " for s in ("final_error", "mean_error"))
            line += f"{ratios} {min(nees):.2f}-{max(nees):.2f}".rjust(24)
        print(line)


def main(study: Study) -> int:
    """Run the study that the command line asks for; the exit code."""
    check_writable(study.output.parent)
    results = run(study)
    write_json(study.output, results)
    show(results["records"])
    return 0


if __name__ == "__main__":
    cli.run(main)
