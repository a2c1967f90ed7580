"""Efficiency of the filters against their bounds: `python -m baselines.studies.efficiency`.

1. If truth follows the filter's model: the MomentumEKF's mean square error over the mean of the posterior bounds of the
   flown trajectories; 1 is perfect. Once with a static inertia, without process noise of the inertia in filter and
   bound, and once with an inertia that is a random walk of the filter's process noise; the disturbance is a random walk
   in both.
2. In the benchmark's scenario: the cost of not knowing the inertia law, in each inertia mode. It is the error of the
   default filter, the AdaptiveEKF, over that of a MomentumEKF on the same readings that knows by which factor J
   changes, but not J. The MomentumEKF with its fixed process noise is shown for comparison, on the same episodes.
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
from baselines.studies.recording import Recording, model_world, record
from satid_gym.bounds import episode_bounds, law_growth, population_bound, posterior_bound
from satid_gym.config import check_integer, check_names
from satid_gym.core import kernels
from satid_gym.estimators import MomentumEKFSettings
from satid_gym.estimators.inertia import inertia_parameters, inertia_tensors
from satid_gym.estimators.records import new_belief, new_work
from satid_gym.evaluation import benchmark_scenario, seeds
from satid_gym.files import check_writable, write_json
from satid_gym.laws import INERTIA_MODES
from satid_gym.metrics import FINAL_FRACTION, bootstrap, relative_error
from satid_gym.policies.registry import BASELINES, make_baseline
from satid_gym.satellite import BENCHMARK_SATELLITES, SATELLITES
from satid_gym.scenario import Scenario, prior_of
from satid_gym.scenario_catalogue import SCENARIOS

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
)  # baselines that excite every axis persistently


def square_error(theta: np.ndarray, recording: Recording) -> np.ndarray:
    """Squared relative error (N,) of the inertia with parameters theta (N, T, p), mean over the final window."""
    return final(np.square(relative_error(inertia_tensors(theta), recording.motion.inertia)))


def final(series: np.ndarray) -> np.ndarray:
    """Mean over the final 20 % of the last axis, the instants."""
    return series[..., -round(FINAL_FRACTION * series.shape[-1]) :].mean(axis=-1)


def known_law_estimates(recording: Recording, satellite: str, scenario: Scenario) -> np.ndarray:
    """Estimates (N, T, p), kg m^2, of a MomentumEKF on recorded readings that knows how J changes, but not J.

    After each prediction theta and its covariance grow by the true factors from the instant before.
    """
    prior = prior_of(SATELLITES[satellite], scenario)
    theta = inertia_parameters(recording.motion.inertia, prior.needed_parameters)
    growth = np.pad(law_growth(theta), ((0, 0), (0, 0), (3, 3)), constant_values=1.0)  # of the state [M, theta, tau]
    estimates = np.empty_like(theta)
    for episode, factors in enumerate(growth):
        gyro, tachometer = recording.gyro[episode], recording.tachometer[episode]
        belief = new_belief(prior, LAW_KNOWN)
        work = new_work(belief)
        mean, covariance = belief["mean"][0], belief["covariance"][0]
        kernels.start_filter(belief, work, gyro[0], tachometer[0])
        estimates[episode, 0] = mean[3 : 3 + theta.shape[2]]
        for k in range(1, len(gyro)):
            kernels.predict_filter(belief, work, tachometer[k], recording.dt)
            mean *= factors[k]
            covariance *= np.outer(factors[k], factors[k])
            kernels.condition_filter(belief, work, gyro[k], tachometer[k])
            estimates[episode, k] = mean[3 : 3 + theta.shape[2]]
    return estimates


def error_over_bound(policy: str, satellite: str, walking: bool, chosen: Sequence[int]) -> dict[str, float]:
    """Mean square error over the posterior bound, with its 95 % interval, if truth follows the filter's model."""
    settings = MomentumEKFSettings() if walking else LAW_KNOWN
    recording = record(
        make_baseline(policy, satellite),
        satellite=satellite,
        inertia="static",
        seeds=chosen,
        estimator=settings,
        as_modelled=True,
    )
    prior = prior_of(SATELLITES[satellite], model_world(SCENARIOS["default"]))
    covariance = posterior_bound(recording.motion, prior, settings, recording.dt)
    inertia = recording.motion.inertia
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
        "constrained_updates": recording.constrained_updates,
    }


def cost_of_unknown_law(policy: str, satellite: str, mode: str, chosen: Sequence[int]) -> dict[str, float]:
    """Root mean square errors in the benchmark's scenario: fixed process noise, AdaptiveEKF, known law, its bound."""
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
    prior, motion = prior_of(SATELLITES[satellite], world), recording.motion
    known_law = square_error(known_law_estimates(recording, satellite, world), recording).mean()
    bound = posterior_bound(motion, prior, LAW_KNOWN, recording.dt, law_known=True)
    adaptive = square_error(recording.theta, recording).mean()
    return {
        "rms_fixed_walk": float(np.sqrt(square_error(fixed.theta, fixed).mean())),
        "rms_adaptive": float(np.sqrt(adaptive)),
        "rms_known_law": float(np.sqrt(known_law)),
        "rms_bound": float(np.sqrt(final(episode_bounds(bound, motion.inertia)).mean())),
        "cost_ratio": float(np.sqrt(adaptive / known_law)),
    }


@dataclass(frozen=True, kw_only=True)
class EfficiencyStudy:
    """Settings of the study."""

    episodes: int = 100
    """Episodes of each policy in each cell."""
    satellites: tuple[str, ...] = BENCHMARK_SATELLITES
    """Satellites to fly."""
    policies: tuple[str, ...] = EXCITING
    """Baselines to fly, persistently exciting ones."""
    reference: str = "rate_square"
    """Policy under which the default filter is compared with one that knows the law."""
    output: Path = Path("results/efficiency.json")
    """File to write."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a name is unknown or the number of episodes is not positive.
        """
        check_names("satellite", self.satellites, SATELLITES)
        check_names("policy", (*self.policies, self.reference), BASELINES)
        check_integer("episodes", self.episodes)


def run(study: EfficiencyStudy) -> dict[str, Any]:
    """Results of both parts of the study, as written to the JSON file."""
    chosen = seeds("validation", study.episodes)
    cells = [(s, p, kind) for kind in ("static", "walking") for s in study.satellites for p in study.policies]
    model_records = [
        {"satellite": s, "policy": p, "inertia": kind, **error_over_bound(p, s, kind == "walking", chosen)}
        for s, p, kind in tqdm(cells, desc="error over bound", unit="flight")
    ]
    modes = [(s, mode) for s in study.satellites for mode in INERTIA_MODES]
    law_records = [
        {"satellite": s, "inertia_mode": mode, **cost_of_unknown_law(study.reference, s, mode, chosen)}
        for s, mode in tqdm(modes, desc="cost of unknown law", unit="flight")
    ]
    return {
        **result_head("baselines.studies.efficiency", study, split="validation", seeds=chosen),
        "error_over_bound": model_records,
        "cost_of_unknown_law": law_records,
    }


def show(results: dict[str, Any]) -> None:
    """Print the study's two tables."""
    print("mean square error / posterior bound, truth follows the filter's model [95 % interval]")
    for r in results["error_over_bound"]:
        interval = f"{r['ratio']:.2f} [{r['ratio_lo']:.2f} {r['ratio_hi']:.2f}]"
        print(f"{r['satellite']:9s} {r['inertia']:8s} {r['policy']:18s} {interval}  rms {100 * r['rms_error']:.4f} %")
    print(
        "\nroot mean square final error, %: fixed process noise, AdaptiveEKF, known law, its bound; "
        "and AdaptiveEKF over known law"
    )
    for r in results["cost_of_unknown_law"]:
        names = ("fixed_walk", "adaptive", "known_law", "bound")
        fixed, adaptive, known, bound = (100.0 * r[f"rms_{name}"] for name in names)
        cell = f"{r['satellite']:9s} {r['inertia_mode']:9s}"
        print(f"{cell} {fixed:.4f} {adaptive:.4f} {known:.4f} {bound:.4f} {r['cost_ratio']:5.1f}")


def main(study: EfficiencyStudy) -> int:
    """Run the study of the command line; returns the exit code."""
    check_writable(study.output.parent)
    results = run(study)
    write_json(study.output, results)
    show(results)
    return 0


if __name__ == "__main__":
    cli.run(main)
