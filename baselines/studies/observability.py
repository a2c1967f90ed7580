"""Rank correlation of observability with accuracy on a ladder of realism: `python -m baselines.studies.observability`.

A family of profiles with the same mean square torque is flown in scenarios of growing realism. The result, for each
scenario and estimator, is Spearman's rank correlation over the profiles: of log det of the Fisher information on the
inertia along the true trajectories, with the error of the estimator. At -1 more information always means a lower
error, so information is a good reward; at 0 they are unrelated.

The information is that of the posterior bound without process noise of the inertia, minus the prior, with the sensors'
noise from their data sheets, even in scenarios without noise. It weighs the whole flight equally. A filter with process
noise of the inertia forgets, so the last column relates the MomentumEKF's error to the information that its own model
holds in the final window, the quantity that the reward's updates sustain. Differentiated LS takes one reading per
decision, as in the paper. If a batch estimator cannot identify the inertia, its error is that of the prior.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.stats
from tqdm import tqdm

from baselines.command import cli
from baselines.command.provenance import result_head
from baselines.studies.excitation_family import FAMILY, matched
from baselines.studies.recording import Recording, record
from satid_gym.bounds import posterior_bound
from satid_gym.config import check_integer, check_names, check_number
from satid_gym.estimators import MomentumEKF, MomentumEKFSettings, RateEKF
from satid_gym.estimators.inertia import inertia_parameters, inertia_tensors
from satid_gym.estimators.least_squares import NotIdentifiedError, differentiated, instrumental_variable, momentum_form
from satid_gym.estimators.prior import FilterPrior
from satid_gym.evaluation import seeds
from satid_gym.files import check_writable, write_bytes, write_json
from satid_gym.law_ranges import PAPER_LAWS
from satid_gym.metrics import FINAL_FRACTION, relative_error
from satid_gym.satellite import SATELLITES
from satid_gym.scenario import Scenario, prior_of

IDEAL = Scenario(
    name="ladder",
    torque_noise=0.0,
    gyro_noise_std=0.0,
    tachometer_noise_std=0.0,
    gyro_bias_walk=0.0,
    disturbance_scale=0.0,
    gravity_gradient=False,
    solar_pressure=0.0,
    termination_factor=1e6,
    laws=PAPER_LAWS,
)
NOISE = {"torque_noise": 0.05, "gyro_noise_std": None, "tachometer_noise_std": None, "gyro_bias_walk": 1e-7}
LIMIT = {"wheel_speed_scale": 0.1}
DISTURBANCE = {"disturbance_scale": 1.0, "gravity_gradient": True, "solar_pressure": 1e-6}
WORLDS: dict[str, tuple[dict[str, Any], str]] = {
    "no noise": ({}, "static"),
    "+ noise": (NOISE, "static"),
    "+ momentum limit": (NOISE | LIMIT, "static"),
    "+ disturbance": (NOISE | LIMIT | DISTURBANCE, "static"),
    "+ varying inertia": (NOISE | LIMIT | DISTURBANCE, "random"),
}
ESTIMATORS = {
    "ls": "differentiated LS",
    "momentum_ls": "momentum-form LS",
    "iv": "instrumental variable",
    "rate_ekf": "RateEKF",
    "momentum_ekf": "MomentumEKF",
    "momentum_ekf_static": "MomentumEKF, no walk",
}


@dataclass(frozen=True, kw_only=True)
class ObservabilityStudy:
    """Settings of the study."""

    satellite: str = "microsat"
    """Satellite to fly."""
    torque: float = 0.02
    """Root mean square torque of all profiles about a body axis, as a fraction of a wheel's limit."""
    episodes: int = 20
    """Episodes of each profile in each scenario."""
    output: Path = Path("results/ladder")
    """Folder for ladder.json and ladder.png."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: the satellite is unknown, or a number out of range.
        """
        check_names("satellite", (self.satellite,), SATELLITES)
        check_number("torque", self.torque, strict=True, high=1.0)
        check_integer("episodes", self.episodes)


def information(recording: Recording, prior: FilterPrior) -> dict[str, float]:
    """Log det of the information on the parameters relative to their prior, mean over the episodes.

    Returns:
        "logdet": Fisher information of the whole flight; "held": of the MomentumEKF's bound, mean over the final
        window.
    """
    parameters = prior.needed_parameters
    scale = prior.theta_scale(parameters)
    bounds = [
        posterior_bound(recording.motion, prior, settings, recording.dt) / np.outer(scale, scale)
        for settings in (MomentumEKFSettings(inertia_walk=0.0), MomentumEKFSettings())
    ]
    fisher = np.linalg.inv(bounds[0][:, -1]) - np.diag((scale / prior.prior_theta_std(parameters)) ** 2)
    window = -round(FINAL_FRACTION * recording.gyro.shape[1])
    held = -np.linalg.slogdet(bounds[1][:, window:])[1]
    return {"logdet": float(np.linalg.slogdet(fisher)[1].mean()), "held": float(held.mean())}


def errors(recording: Recording, prior: FilterPrior, samples: int) -> dict[str, list[float]]:
    """Relative error of each estimator in each episode, by name; mean over the final window.

    Args:
        recording: readings and truth.
        prior: prior of the estimators.
        samples: readings per decision.
    """
    found: dict[str, list[float]] = {name: [] for name in ESTIMATORS}
    prior_theta = inertia_parameters(prior.inertia, prior.needed_parameters)
    window = -round(FINAL_FRACTION * recording.gyro.shape[1])
    for row in range(len(recording.gyro)):
        readings = (prior, recording.gyro[row], recording.tachometer[row], recording.dt)
        decimated = (prior, readings[1][::samples], readings[2][::samples], samples * recording.dt)
        truth = recording.motion.inertia[row, window:]
        estimates = {
            "ls": _batch(partial(differentiated, *decimated), prior_theta),
            "momentum_ls": _batch(partial(momentum_form, *readings), prior_theta),
            "iv": _batch(partial(instrumental_variable, *readings), prior_theta),
            "rate_ekf": RateEKF().run(*readings).inertia[window:],
            "momentum_ekf": MomentumEKF().run(*readings).inertia[window:],
            "momentum_ekf_static": MomentumEKF(inertia_walk=0.0).run(*readings).inertia[window:],
        }
        for name, estimate in estimates.items():
            found[name].append(float(relative_error(inertia_tensors(estimate), truth).mean()))
    return found


def _batch(solve: Callable[[], Any], prior_theta: np.ndarray) -> np.ndarray:
    """Estimate (p,); the prior mean if the data do not identify the inertia."""
    try:
        return solve().theta
    except NotIdentifiedError:
        return prior_theta


def run_study(study: ObservabilityStudy, chosen: Sequence[int]) -> list[dict[str, Any]]:
    """Records, one per scenario and profile: information, and the median error of each estimator."""
    records = []
    cells = [(world, name) for world in WORLDS for name in FAMILY]
    for world, name in tqdm(cells, desc="observability", unit="profile"):
        changes, mode = WORLDS[world]
        scenario = IDEAL.replace(**changes)
        data_sheets = scenario.replace(gyro_noise_std=None, tachometer_noise_std=None)  # no sensor is without noise
        prior = prior_of(SATELLITES[study.satellite], data_sheets)
        policy = matched(name, study.torque, scenario)
        recording = record(policy, satellite=study.satellite, inertia=mode, seeds=chosen, scenario=scenario)
        median = {key: float(np.median(values)) for key, values in errors(recording, prior, scenario.samples).items()}
        records.append({"world": world, "profile": name, **information(recording, prior), **median})
    return records


def correlations(records: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Spearman's rank correlations of information with error, for each scenario and estimator.

    "held" is that of the MomentumEKF with the information that it holds. None means that an estimator never identified
    the inertia.
    """
    table = []
    for world in dict.fromkeys(r["world"] for r in records):
        rows = [r for r in records if r["world"] == world]
        pairs = {name: ("logdet", name) for name in ESTIMATORS} | {"held": ("held", "momentum_ekf")}
        table.append({"world": world, **{key: _rank(rows, *pair) for key, pair in pairs.items()}})
    return table


def _rank(rows: Sequence[dict[str, Any]], one: str, other: str) -> float | None:
    x, y = ([r[name] for r in rows] for name in (one, other))
    return float(scipy.stats.spearmanr(x, y).statistic) if np.ptp(y) > 0.0 else None


def draw(records: Sequence[dict[str, Any]], table: Sequence[dict[str, Any]], path: Path) -> None:
    """Write the figure: error over information, one panel with its rank correlation per scenario and estimator."""
    from baselines.paper.figures.style import plt

    figure, axes = plt.subplots(len(table), len(ESTIMATORS), figsize=(14, 11), sharex="row", squeeze=False)
    for row, world in zip(axes, table, strict=True):
        points = [r for r in records if r["world"] == world["world"]]
        for panel, (name, title) in zip(row, ESTIMATORS.items(), strict=True):
            panel.scatter([r["logdet"] for r in points], [100.0 * r[name] for r in points], s=14, color="#0072B2")
            panel.set_yscale("log")
            panel.set_title(f"{title}\n{world['world']}: {_text(world[name])}", fontsize=8)
        row[0].set_ylabel("median error, %")
    for panel in axes[-1]:
        panel.set_xlabel("log det Fisher information")
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=130)
    write_bytes(path, drawn.getvalue())
    plt.close(figure)


def _text(correlation: float | None) -> str:
    return "refused" if correlation is None else f"{correlation:.2f}"


def main(study: ObservabilityStudy) -> int:
    """Run the study of the command line; returns the exit code."""
    check_writable(study.output)
    chosen = seeds("validation", study.episodes)
    records = run_study(study, chosen)
    table = correlations(records)
    results = {
        **result_head("baselines.studies.observability", study, split="validation", seeds=chosen),
        "correlations": table,
        "records": records,
    }
    write_json(study.output / "ladder.json", results)
    draw(records, table, study.output / "ladder.png")
    print(f"rank correlation of log det information with error, {len(FAMILY)} profiles, {study.satellite}")
    print(" " * 18 + "".join(f"{name:>20s}" for name in [*ESTIMATORS, "held"]))
    for line in table:
        print(f"{line['world']:18s}" + "".join(f"{_text(line[name]):>20s}" for name in [*ESTIMATORS, "held"]))
    return 0


if __name__ == "__main__":
    cli.run(main)
