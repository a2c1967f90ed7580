"""Record of a design: the manoeuvre as a table, plain values for JSON, and the lines that a terminal shows."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any

import numpy as np

from satid_gym.estimators.batch.regression import NAMES
from satid_gym.gym_api import COSTS
from satid_gym.manoeuvres.designer import Design
from satid_gym.manoeuvres.trial import Trial


def csv(design: Design) -> str:
    """The manoeuvre as a table: one row per decision with the commands held, and the nominal attitude at its start."""
    plan = design.manoeuvre
    wheels = range(1, plan.torque.shape[1] + 1)
    head = ["time_s", *(f"rate_{axis}_rad_per_s" for axis in "xyz"), *(f"torque_{k}_Nm" for k in wheels)]
    head += [f"attitude_{part}" for part in ("x", "y", "z", "w")]
    out = io.StringIO()
    rows = np.column_stack([plan.time, plan.rate, plan.torque, plan.attitude])
    np.savetxt(out, rows, fmt="%.9g", delimiter=",", header=",".join(head), comments="")
    return out.getvalue()


def record(design: Design) -> dict[str, Any]:
    """Record of a design without the flights' time series."""
    mission, plan = design.mission, design.manoeuvre
    return {
        "satellite": mission.satellite.to_dict(),
        "request": design.request.to_dict(),
        "control": mission.control,
        "scenario": mission.scenario.to_dict(),
        "estimator": mission.estimator.to_dict(),
        "manoeuvre": {
            "frame": "body; motor torque on the wheels; attitude from the body frame to its first one, scalar last",
            "decision_period_s": mission.scenario.decision_period,
            "time_s": plan.time.tolist(),
            "rate_rad_per_s": plan.rate.tolist(),
            "torque_Nm": plan.torque.tolist(),
            "attitude": plan.attitude.tolist(),
        },
        "least_std_of_any_motion": float(design.least[-1]),
        "flights": _flights(design.trial),
        "flights_of_its_torque_in_open_loop": None if design.open_loop is None else _flights(design.open_loop),
        "rivals": {trial.name: _flights(trial) for trial in design.rivals},
        "harder_worlds": {name: _flights(trial) for name, trial in design.stressed.items()},
        "notes": list(design.notes),
    }


def _flights(trial: Trial) -> dict[str, Any]:
    """Results of a trial; null where flights ended early."""
    error, std, median = trial.error[-1], trial.parameter_std[-1], trial.median_std
    return {
        "flights": int(error.size),
        "std": {name: _finite(value) for name, value in zip(NAMES, std.tolist(), strict=False)},
        "std_median": {name: _finite(value) for name, value in zip(NAMES, median.tolist(), strict=False)},
        "error_median": _finite(float(np.median(error))),
        "error_95_percent": _finite(float(np.quantile(error, 0.95, method="higher"))),
        "nees": float(trial.nees.mean()),
        "share_with_restart_inflation_or_alarm": float(trial.doubted.mean()),
        "share_of_time_beyond": dict(zip(COSTS, trial.costs.mean(axis=0).tolist(), strict=True)),
        "ended_early": int(trial.terminated.sum()),
        "largest": {
            "rate_over_limit": float(trial.rate.max()),
            "wheel_speed_over_limit": float(trial.wheel_speed.max()),
            "deflection_over_limit": float(trial.deflection.max()),
            "turn_rad": float(trial.turn.max()),
        },
        "at_the_end": {
            "turn_rad_median": float(np.median(trial.turn[-1])),
            "rate_rad_per_s_median": float(np.median(trial.end_rate)),
        },
        "least_clearance_rad": [float(angle) for angle in trial.clearance.min(axis=0)],
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def percent(value: float) -> str:
    """A share in per cent with two digits; "-" if missing."""
    if not np.isfinite(value):
        return "-"
    return f"{100.0 * value:.2g} %" if abs(value) < 0.995 else f"{100.0 * value:.0f} %"


def comparison(design: Design) -> list[tuple[str, Trial]]:
    """Names and trials of the manoeuvre and of what it is compared with."""
    rows = [("this manoeuvre", design.trial)]
    if design.open_loop is not None:
        rows.append(("its torque in open loop", design.open_loop))
    return rows + [(trial.name, trial) for trial in design.rivals]


def lines(design: Design) -> Iterator[str]:
    """Tables for a terminal."""
    trial, request = design.trial, design.request
    yield f"{'':5s}{'std, kg m^2':>14s}{'std, rms':>10s}{'median':>10s}   of {trial.error.shape[1]} flights"
    for name, std, median, size in zip(NAMES, trial.parameter_std[-1], trial.median_std, design.scale, strict=False):
        yield f"{name:5s}{std * size:14.2g}{percent(std):>10s}{percent(median):>10s}"
    least = percent(float(design.least[-1]))
    yield f"for the nominal satellite no motion within the limits determines every moment better than {least}"
    yield ""
    rate, speed = percent(float(trial.rate.max())), percent(float(trial.wheel_speed.max()))
    yield f"largest rate {rate} of its limit, wheel speed {speed}"
    turned = f"turns by up to {np.degrees(trial.turn.max()):.0f} deg"
    if request.returns:
        turned += f" and comes back to {np.degrees(np.median(trial.turn[-1])):.1f} deg (median)"
    yield f"{turned}; ends at {np.median(trial.end_rate):.1g} rad/s (median)"
    yield ""
    yield f"{'':44s}{'std':>9s}{'error':>9s}{'beyond':>9s}{'NEES':>6s}"
    for name, other in [*comparison(design), *design.stressed.items()]:
        cells = map(percent, (other.accuracy, float(np.median(other.error[-1])), other.beyond))
        early = f"   {other.terminated.sum()} ended early" if other.terminated.any() else ""
        yield f"{name:44s}{''.join(f'{cell:>9s}' for cell in cells)}{other.nees.mean():6.2f}{early}"
