"""Does observability predict accuracy? The realism ladder: `python -m baselines.ladder`.

A family of profiles with the same mean square torque is flown in worlds of growing realism. For each world and
estimator: Spearman's rank correlation, over the profiles, of log det of the Fisher information on the inertia
along the true trajectories with the error that the estimator achieved. -1: the more a profile tells, the lower
the error, so information is a good reward; 0: it says nothing.

The information is that of the posterior bound without inertia walk, less the prior, with the sensors' noise by
their data sheets also where a world has none. It counts the whole flight alike; a filter that expects its inertia to
walk forgets, so the last column sets the MomentumEKF's error against what its own model holds in the final
window, the quantity that the reward's updates keep up. Differentiated LS reads once a decision, as the paper's
does; where a batch estimator refuses, its error is that of the prior.
"""

from __future__ import annotations

import dataclasses
import io
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.stats
import tyro
from tqdm import tqdm

from baselines.ending import ended, refusal
from baselines.provenance import command, revision, versions
from baselines.recording import Recording, record
from satid_gym.bounds import posterior_bound
from satid_gym.config import check_names, check_number, check_whole
from satid_gym.estimators import MomentumEKF, MomentumEKFSettings, RateEKF
from satid_gym.estimators.least_squares import NotIdentifiedError, differentiated, instrumental_variable, momentum_form
from satid_gym.estimators.settings import Briefing, brief, inertia_parameters, inertia_tensors
from satid_gym.evaluation import seeds
from satid_gym.files import check_writable, write_bytes, write_json
from satid_gym.laws import PAPER_LAWS
from satid_gym.metrics import FINAL_FRACTION
from satid_gym.policies.scripted import ScriptedPolicy, Signal, staggered_square
from satid_gym.profiles import PROFILES, prbs
from satid_gym.satellite import SATELLITES
from satid_gym.scenario import Scenario


def phased_sine(time: np.ndarray, *, frequency: float, horizon: float | None = None) -> np.ndarray:
    """One tone, a third of a period apart on the three axes; (N, 3) for time (N,) s."""
    return np.sin(2.0 * np.pi * (frequency * time[:, None] + np.arange(3) / 3.0))


def one_axis_at_a_time(time: np.ndarray, *, period: float, horizon: float | None = None) -> np.ndarray:
    """A square wave that moves on to the next axis after each period; (N, 3) for time (N,) s."""
    side = np.where(np.mod(time / period + 0.25, 1.0) < 0.5, 1.0, -1.0)
    axis = np.floor(time / period).astype(int) % 3
    return side[:, None] * (axis[:, None] == np.arange(3))


FAMILY: dict[str, Signal] = {
    **PROFILES,
    "prbs_other": partial(prbs, seed=2),
    **{f"staggered_{p}s": partial(staggered_square, period=float(p)) for p in (12, 36, 84)},
    **{f"phased_{m}mHz": partial(phased_sine, frequency=1e-3 * m) for m in (5, 20, 50)},
    "one_axis_30s": partial(one_axis_at_a_time, period=30.0),
}

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
class Ladder:
    """What to fly."""

    satellite: str = "microsat"
    """Satellite to fly."""
    torque: float = 0.02
    """Root mean square torque about a body axis that all profiles have, of a wheel's limit."""
    episodes: int = 20
    """Episodes of each profile in each world."""
    output: Path = Path("results/ladder")
    """Folder for ladder.json and ladder.png."""

    def check(self) -> None:
        """Refuse what cannot be flown.

        Raises:
            ValueError: the satellite is unknown, or a number out of range.
        """
        check_names("satellite", (self.satellite,), SATELLITES)
        check_number("torque", self.torque, strict=True, high=1.0)
        check_whole("episodes", self.episodes)


def matched(name: str, torque: float, scenario: Scenario) -> ScriptedPolicy:
    """A profile of the family whose root mean square torque over axes and horizon is `torque`."""
    time = scenario.decision_period * np.arange(scenario.decisions)
    signal = FAMILY[name]
    strength = np.sqrt(np.mean(np.square(signal(time, horizon=scenario.horizon))))
    return ScriptedPolicy(name, signal, torque / float(strength))


def information(recording: Recording, briefing: Briefing) -> dict[str, float]:
    """Log det of the information on relative parameters, mean over the episodes.

    Returns:
        "logdet": Fisher's, of the whole flight; "held": the MomentumEKF's, mean over the final window.
    """
    parameters = briefing.needed_parameters
    scale = briefing.theta_scale(parameters)
    bounds = [
        posterior_bound(recording.course, briefing, settings, recording.dt) / np.outer(scale, scale)
        for settings in (MomentumEKFSettings(inertia_walk=0.0), MomentumEKFSettings())
    ]
    fisher = np.linalg.inv(bounds[0][:, -1]) - np.diag((scale / briefing.prior_theta_std(parameters)) ** 2)
    window = -round(FINAL_FRACTION * recording.gyro.shape[1])
    held = -np.linalg.slogdet(bounds[1][:, window:])[1]
    return {"logdet": float(np.linalg.slogdet(fisher)[1].mean()), "held": float(held.mean())}


def errors(recording: Recording, briefing: Briefing, samples: int) -> dict[str, list[float]]:
    """Relative error of each estimator in each episode; filters by their mean over the final window.

    Args:
        recording: readings and truth.
        briefing: what the estimators are told.
        samples: readings a decision.
    """
    found: dict[str, list[float]] = {name: [] for name in ESTIMATORS}
    prior = inertia_parameters(briefing.inertia, briefing.needed_parameters)
    window = -round(FINAL_FRACTION * recording.gyro.shape[1])
    for row in range(len(recording.gyro)):
        readings = (briefing, recording.gyro[row], recording.tachometer[row], recording.dt)
        seldom = (briefing, readings[1][::samples], readings[2][::samples], samples * recording.dt)
        truth = recording.course.inertia[row, window:]
        estimates = {
            "ls": _batch(partial(differentiated, *seldom), prior),
            "momentum_ls": _batch(partial(momentum_form, *readings), prior),
            "iv": _batch(partial(instrumental_variable, *readings), prior),
            "rate_ekf": RateEKF().run(*readings).inertia[window:],
            "momentum_ekf": MomentumEKF().run(*readings).inertia[window:],
            "momentum_ekf_static": MomentumEKF(inertia_walk=0.0).run(*readings).inertia[window:],
        }
        for name, estimate in estimates.items():
            apart = np.linalg.norm(inertia_tensors(estimate) - truth, axis=(1, 2))
            error = apart / np.linalg.norm(truth, axis=(1, 2))
            found[name].append(float(error.mean()))
    return found


def _batch(solve: Callable[[], Any], prior: np.ndarray) -> np.ndarray:
    """(p,) estimate; the prior mean where the data do not identify one."""
    try:
        return solve().theta
    except NotIdentifiedError:
        return prior


def climb(ladder: Ladder, chosen: Sequence[int]) -> list[dict[str, Any]]:
    """One record for each world and profile: information, and the median error of each estimator."""
    records = []
    cells = [(world, name) for world in WORLDS for name in FAMILY]
    for world, name in tqdm(cells, desc="climbing", unit="profile"):
        changes, mode = WORLDS[world]
        scenario = IDEAL.replace(**changes)
        told = scenario.replace(gyro_noise_std=None, tachometer_noise_std=None)  # data sheets know no noiseless sensor
        briefing = brief(SATELLITES[ladder.satellite], told)
        policy = matched(name, ladder.torque, scenario)
        recording = record(policy, satellite=ladder.satellite, inertia=mode, seeds=chosen, scenario=scenario)
        median = {
            key: float(np.median(values)) for key, values in errors(recording, briefing, scenario.samples).items()
        }
        records.append({"world": world, "profile": name, **information(recording, briefing), **median})
    return records


def correlations(records: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Spearman's rank correlation of information with error, for each world and estimator.

    "held" is the MomentumEKF's with the information that it holds; None where an estimator refused throughout.
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
    """Error against information, a panel with its rank correlation for each world and estimator."""
    from baselines.paper.figure_style import plt

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


def main() -> int:
    """Climb the ladder that the command line asks for; the exit code."""
    ladder = tyro.cli(Ladder, description=__doc__)
    with refusal():
        ladder.check()
    check_writable(ladder.output)
    chosen = seeds("validation", ladder.episodes)
    records = climb(ladder, chosen)
    table = correlations(records)
    results = {
        "command": command("baselines.ladder"),
        "revision": revision(),
        "versions": versions(),
        "settings": {**dataclasses.asdict(ladder), "output": str(ladder.output)},
        "seeds": {"split": "validation", "first": chosen[0], "count": len(chosen)},
        "correlations": table,
        "records": records,
    }
    write_json(ladder.output / "ladder.json", results)
    draw(records, table, ladder.output / "ladder.png")
    print(f"rank correlation of log det information with error, {len(FAMILY)} profiles, {ladder.satellite}")
    print(" " * 18 + "".join(f"{name:>20s}" for name in [*ESTIMATORS, "held"]))
    for line in table:
        print(f"{line['world']:18s}" + "".join(f"{_text(line[name]):>20s}" for name in [*ESTIMATORS, "held"]))
    return 0


if __name__ == "__main__":
    sys.exit(ended(main))
