"""How much of what can be known is known: `python -m baselines.efficiency`.

1. Where truth is what the filter's model says, the MomentumEKF's mean square error over the mean of the
   posterior bounds of the flown trajectories: 1 is perfect. Once with a static inertia, the walk off in filter
   and bound, and once with an inertia that walks as its tuning has it; the disturbance walks in both.
2. In the benchmark's world, what not knowing the law costs in each inertia mode: the error of the default filter,
   the AdaptiveEKF, and on the same episodes that of the MomentumEKF with its one walk, over the MomentumEKF's on the
   default's readings told the law, that is by what factor J changes, but not J.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from tqdm import tqdm

from baselines.ending import ended, refusal
from baselines.provenance import command, revision, versions
from baselines.recording import Recording, model_world, record
from satid_gym.bounds import episode_bounds, law_growth, population_bound, posterior_bound
from satid_gym.config import check_names, check_whole
from satid_gym.core import momentum_filter
from satid_gym.core.jit import kernel
from satid_gym.estimators.belief import new_belief, new_work
from satid_gym.estimators.settings import MomentumEKFSettings, brief, inertia_parameters, inertia_tensors
from satid_gym.evaluation import benchmark_scenario, seeds
from satid_gym.files import check_writable, write_json
from satid_gym.laws import INERTIA_MODES
from satid_gym.metrics import FINAL_FRACTION, bootstrap
from satid_gym.policies.registry import BASELINES, make_baseline
from satid_gym.satellite import SATELLITES
from satid_gym.scenario import SCENARIOS, Scenario

LAW_KNOWN = MomentumEKFSettings(inertia_walk=0.0)
EXCITING = (
    "sawtooth",
    "sine",
    "multi_sine",
    "prbs",
    "chirp",
    "sine_3axis",
    "staggered_square",
    "open_loop_optimal",
    "rate_square",
    "greedy_horizon",
    "mpc",
)  # those of the baselines that keep exciting every axis


def square_error(theta: np.ndarray, recording: Recording) -> np.ndarray:
    """Squared relative error (N,) of the inertia that theta (N, T, p) stands for, mean over the final window."""
    inertia = recording.course.inertia
    error = np.square(inertia_tensors(theta) - inertia).sum(axis=(2, 3))
    return final(error / np.square(inertia).sum(axis=(2, 3)))


def final(series: np.ndarray) -> np.ndarray:
    """Mean of the last 20 % of instants, which are the last axis."""
    return series[..., -round(FINAL_FRACTION * series.shape[-1]) :].mean(axis=-1)


def told_the_law(recording: Recording, satellite: str, scenario: Scenario) -> np.ndarray:
    """Estimates (N, T, p) of the MomentumEKF on recorded readings when it knows how J changes, but not J."""
    briefing = brief(SATELLITES[satellite], scenario)
    theta = inertia_parameters(recording.course.inertia, briefing.needed_parameters)
    template, growth = new_belief(briefing, LAW_KNOWN), law_growth(theta)
    work, out = new_work(template), np.empty_like(theta)
    filter_told(template, template.copy(), work, recording.gyro, recording.tachometer, growth, recording.dt, out)
    return out


def _build_filter_told(fingerprint):
    def filter_told(template, beliefs, work, gyro, tachometer, growth, dt, out):
        """Run the filter over each episode's readings; theta and its covariance grow by the factors (N, T, p)."""
        fingerprint  # noqa: B018
        p = growth.shape[2]
        for i in range(gyro.shape[0]):
            beliefs[0] = template[0]
            belief = beliefs[0]
            momentum_filter.start(belief, work[0], gyro[i, 0], tachometer[i, 0])
            out[i, 0] = belief.mean[3 : 3 + p]
            for k in range(1, gyro.shape[1]):
                momentum_filter.predict(belief, work[0], tachometer[i, k], dt)
                for j in range(p):
                    belief.mean[3 + j] *= growth[i, k, j]
                    belief.covariance[3 + j] *= growth[i, k, j]
                    belief.covariance[:, 3 + j] *= growth[i, k, j]
                momentum_filter.condition(belief, work[0], gyro[i, k])
                out[i, k] = belief.mean[3 : 3 + p]

    return filter_told


filter_told = kernel(_build_filter_told)


def attained(policy: str, satellite: str, walking: bool, chosen: Sequence[int]) -> dict[str, float]:
    """Mean square error over the posterior bound where truth is the filter's model, with its 95 % interval."""
    settings = MomentumEKFSettings() if walking else LAW_KNOWN
    recording = record(
        make_baseline(policy, satellite),
        satellite=satellite,
        inertia="static",
        seeds=chosen,
        estimator=settings,
        as_modelled=True,
    )
    briefing = brief(SATELLITES[satellite], model_world(SCENARIOS["default"]))
    covariance = posterior_bound(recording.course, briefing, settings, recording.dt)
    inertia = recording.course.inertia
    bound = float(final(episode_bounds(covariance, inertia)).mean())
    error = square_error(recording.theta, recording)
    low, high = bootstrap(error)
    return {
        "rms_error": float(np.sqrt(error.mean())),
        "rms_bound": float(np.sqrt(bound)),
        "rms_population_bound": float(np.sqrt(final(population_bound(covariance, inertia)))),
        "ratio": float(error.mean() / bound),
        "ratio_lo": low / bound,
        "ratio_hi": high / bound,
        "outside_fraction": float(recording.outside.mean()),
        "guarded": recording.guarded,
    }


def given_away(policy: str, satellite: str, mode: str, chosen: Sequence[int]) -> dict[str, float]:
    """Root mean square errors in the benchmark's world: one walk, AdaptiveEKF, told the law, and its bound."""
    world = benchmark_scenario()
    fixed, recording = (
        record(
            make_baseline(policy, satellite),
            satellite=satellite,
            inertia=mode,
            seeds=chosen,
            scenario=world,
            estimator=estimator,
        )
        for estimator in ("momentum", "adaptive")
    )
    briefing, course = brief(SATELLITES[satellite], world), recording.course
    told = square_error(told_the_law(recording, satellite, world), recording).mean()
    bound = posterior_bound(course, briefing, LAW_KNOWN, recording.dt, law_known=True)
    adaptive = square_error(recording.theta, recording).mean()
    return {
        "rms_one_walk": float(np.sqrt(square_error(fixed.theta, fixed).mean())),
        "rms_adaptive": float(np.sqrt(adaptive)),
        "rms_told_the_law": float(np.sqrt(told)),
        "rms_bound": float(np.sqrt(final(episode_bounds(bound, course.inertia)).mean())),
        "given_away": float(np.sqrt(adaptive / told)),
    }


@dataclass(frozen=True, kw_only=True)
class Study:
    """What to fly."""

    episodes: int = 100
    """Episodes of each policy in each cell."""
    satellites: tuple[str, ...] = tuple(SATELLITES)
    """Satellites to fly."""
    policies: tuple[str, ...] = EXCITING
    """Baselines to fly; persistently exciting ones."""
    reference: str = "rate_square"
    """The policy under which the default filter is set against the one that knows the law."""
    output: Path = Path("results/efficiency.json")
    """File to write."""

    def check(self) -> None:
        """Refuse what cannot be flown.

        Raises:
            ValueError: a name is unknown or there is no episode.
        """
        check_names("satellite", self.satellites, SATELLITES)
        check_names("policy", (*self.policies, self.reference), BASELINES)
        check_whole("episodes", self.episodes)


def run(study: Study) -> dict[str, Any]:
    """Both parts of the study, as the JSON file has them."""
    chosen = seeds("validation", study.episodes)
    cells = [(s, p, walking) for walking in (False, True) for s in study.satellites for p in study.policies]
    attained_records = [
        {"satellite": s, "policy": p, "inertia": "walking" if walking else "static", **attained(p, s, walking, chosen)}
        for s, p, walking in tqdm(cells, desc="against the bound", unit="flight")
    ]
    modes = [(s, mode) for s in study.satellites for mode in INERTIA_MODES]
    given_records = [
        {"satellite": s, "inertia_mode": mode, **given_away(study.reference, s, mode, chosen)}
        for s, mode in tqdm(modes, desc="against the law", unit="flight")
    ]
    return {
        "command": command("baselines.efficiency"),
        "revision": revision(),
        "versions": versions(),
        "settings": {**dataclasses.asdict(study), "output": str(study.output)},
        "seeds": {"split": "validation", "first": chosen[0], "count": len(chosen)},
        "attained": attained_records,
        "given_away": given_records,
    }


def show(results: dict[str, Any]) -> None:
    """Print the study's two tables."""
    print("mean square error / posterior bound, truth as the filter's model says [95 % interval]")
    for r in results["attained"]:
        interval = f"{r['ratio']:.2f} [{r['ratio_lo']:.2f} {r['ratio_hi']:.2f}]"
        print(f"{r['satellite']:9s} {r['inertia']:8s} {r['policy']:18s} {interval}  rms {100 * r['rms_error']:.4f} %")
    print(
        "\nroot mean square final error, %: one walk, AdaptiveEKF, told the law, its bound, and how many "
        "times the AdaptiveEKF has of what the law would give"
    )
    for r in results["given_away"]:
        names = ("one_walk", "adaptive", "told_the_law", "bound")
        one, adaptive, told, bound = (100.0 * r[f"rms_{name}"] for name in names)
        cell = f"{r['satellite']:9s} {r['inertia_mode']:9s}"
        print(f"{cell} {one:.4f} {adaptive:.4f} {told:.4f} {bound:.4f} {r['given_away']:5.1f}")


def main() -> int:
    """Run the study that the command line asks for; the exit code."""
    study = tyro.cli(Study, description=__doc__)
    with refusal():
        study.check()
    check_writable(study.output.parent)
    results = run(study)
    write_json(study.output, results)
    show(results)
    return 0


if __name__ == "__main__":
    sys.exit(ended(main))
