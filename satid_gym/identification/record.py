"""Record of an identification: plain values for JSON, and the lines that a terminal shows."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from satid_gym.estimators.batch.regression import NAMES
from satid_gym.identification.identify import Identification
from satid_gym.identification.variation.changes import FALSE_ALARM
from satid_gym.identification.variation.steps_and_drift import Variation

SAID = {
    "constant": "constant, as far as the data show",
    "steps": "it steps",
    "drift": "it drifts",
    "steps and drift": "it steps, and drifts between the steps",
    "not told": "too few data to decide whether it is constant",
    "not explained": "no course of it explains the data",
}


def plain(value: Any) -> Any:
    """Value as JSON holds it; unknown values are null."""
    if isinstance(value, np.ndarray):
        return [plain(item) for item in value.tolist()]
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    return value


def rounded(value: float, std: float) -> tuple[str, str]:
    """A value and its standard deviation, both to the second digit of the latter."""
    places = max(0, 1 - math.floor(math.log10(std))) if std > 0.0 else 6
    return f"{value:.{places}f}", f"{std:.{places}f}"


def record(found: Identification) -> dict[str, Any]:
    """Record of an identification without the residuals of each reading."""
    return {
        "satellite": found.satellite.name,
        "frame": "body, wheels locked, kg m^2; covariance in the order xx yy zz xy xz yz; null: not identified",
        "inertia": plain(found.inertia),
        "covariance": plain(found.covariance),
        "over_rotor": plain(found.over_rotor),
        "over_rotor_covariance": plain(found.over_rotor_covariance),
        "rotor_inertia": float(found.satellite.wheels.inertia[0]),
        "parameters": [
            {"name": p.name, "value": plain(p.value), "std": plain(p.std), "unit": p.unit, "determined": p.determined}
            for p in found.parameters
        ],
        "inflation": plain(found.inflation),
        "scatter": {"windows": plain(found.scatter[0]), "flights": plain(found.scatter[1])},
        "residuals": {
            "white": found.whiteness.white,
            "autocorrelation": plain(found.whiteness.autocorrelation),
            "distance": plain(found.whiteness.distance),
            "stamp_scatter_s": plain(found.jitter),
        },
        "flights": [
            {
                "name": flight.name,
                "rows": flight.rows,
                "used": flight.used,
                "outliers_at_s": plain(flight.outliers),
                "tachometer_faults": [
                    {"time_s": fault.time, "wheel": fault.wheel, "excess_rad_per_s": fault.excess}
                    for fault in flight.faults
                ],
                "theta": dict(zip(NAMES, plain(flight.theta), strict=True)),
                "std": dict(zip(NAMES, plain(flight.std), strict=True)),
                "share_of_information": dict(zip(NAMES, plain(flight.share), strict=True)),
                "delays_s": plain(flight.delays),
                "predicted_by_the_others_rad_per_s": plain(flight.predicted),
                "wheel_speed_std_rad_per_s": plain(flight.signal),
            }
            for flight in found.flights
        ],
        **({} if found.variation is None else {"variation": _variation(found.variation)}),
        "notes": list(found.notes),
    }


def _variation(found: Variation) -> dict[str, Any]:
    return {
        "kind": found.kind,
        "p": found.p,
        "false_alarm": FALSE_ALARM,
        "detectable_step": plain(found.detectable),
        "doubted": [{"flight": flight, "time_s": plain(time)} for flight, time in found.doubted],
        "flight": found.flight.tolist(),
        "time_s": plain(found.time),
        "theta": plain(found.theta),
        "std": plain(found.std),
        "steps": [
            {
                "flight": step.flight,
                "time_s": plain(step.time),
                "time_std_s": plain(step.time_std),
                "momentum_jumped": step.jumped,
                **{
                    name: dict(zip(NAMES, plain(getattr(step, name)), strict=True))
                    for name in ("before", "after", "change", "change_std")
                },
            }
            for step in found.steps
        ],
    }


def variation_lines(found: Variation) -> Iterator[str]:
    """Description of a variation, and a table of its steps, for a terminal."""
    yield f"inertia over time: {SAID[found.kind]}"
    if found.kind in ("constant", "not told"):
        yield f"a step of {found.detectable:.2g} of it would be found half of the time"
    for number, step in enumerate(found.steps, start=1):
        where = f"before flight {step.flight + 1}"
        if np.isfinite(step.time):
            where = f"in flight {step.flight + 1} at {step.time:.10g} +- {step.time_std:.2g} s"
        jumped = ", and the momentum with it" if step.jumped else ""
        yield f"step {number}, {where}{jumped}; kg m^2:"
        yield f"{'':5s}{'before':>14s}{'after':>14s}{'change':>14s}{'1 std':>12s}"
        for k, name in enumerate(NAMES):
            if np.isfinite(step.change_std[k]):
                change, std = rounded(step.change[k], step.change_std[k])
                before, after = (f"{value[k]:.{len(std) - 2}f}" for value in (step.before, step.after))
                yield f"{name:5s}{before:>14s}{after:>14s}{change:>14s}{std:>12s}"
            else:
                yield f"{name:5s}{'not identified':>26s}"


def lines(found: Identification) -> Iterator[str]:
    """Table of the parameters and of the flights, for a terminal."""
    over, std = found.over_rotor, np.sqrt(np.diag(found.over_rotor_covariance))
    places = {"Jxx": (0, 0), "Jyy": (1, 1), "Jzz": (2, 2), "Jxy": (0, 1), "Jxz": (0, 2), "Jyz": (1, 2)}
    yield f"{'':5s}{'J, kg m^2':>14s}{'1 std':>12s}{'J / rotor':>14s}{'1 std':>10s}"
    for k, name in enumerate(NAMES):
        parameter = found.parameters[k]
        if not parameter.determined:
            yield f"{name:5s}{'not identified':>26s}"
            continue
        cells = (*rounded(parameter.value, parameter.std), *rounded(over[places[name]], std[k]))
        yield f"{name:5s}{cells[0]:>14s}{cells[1]:>12s}{cells[2]:>14s}{cells[3]:>10s}"
    yield ""
    for rotor in (p for p in found.parameters[6:] if p.name.startswith("rotor") and p.determined):
        yield f"{rotor.name}, by its motor's torque: {rotor.value:.4g} +- {rotor.std:.1g} kg m^2"
    yield f"{'flight':28s}{'rows':>7s}{'used':>7s}{'outliers':>10s}{'pred. error':>13s}{'speed std':>11s}, rad/s"
    for flight in found.flights:
        predicted = f"{flight.predicted:13.2f}" if np.isfinite(flight.predicted) else f"{'-':>13s}"
        yield (
            f"{flight.name[:27]:28s}{flight.rows:7d}{flight.used:7d}{len(flight.outliers):10d}{predicted}"
            f"{flight.signal:11.1f}"
        )
