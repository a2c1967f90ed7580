"""Values that a data sheet does not give, and what is assumed for them."""

from __future__ import annotations

from dataclasses import MISSING, fields

from satid_gym.oscillators import Oscillator
from satid_gym.satellite import Satellite
from satid_gym.star_tracker import StarTracker
from satid_gym.tolerances import Tolerances

_UNITS = {
    "mass": "kg",
    "size": "m",
    "rate_limit": "rad/s",
    "gyro_noise_std": "rad/s",
    "tachometer_noise_std": "rad/s",
    "disturbance_std": "N m",
}


def left_out(satellite: Satellite) -> list[str]:
    """What the data sheet does not say, or says as the default has it, and what is assumed, one line each."""
    defaults = {field.name: field.default for field in fields(Satellite) if field.default is not MISSING}
    void = {"tachometer_noise_std"} if satellite.sensors.counts else set()
    same = [name for name in _UNITS if _is(getattr(satellite, name), defaults[name]) and name not in void]
    lines = [f"{name}: {_shown(satellite, name)}" for name in same]
    sensors, tolerances = satellite.sensors, satellite.tolerances
    exact = [field.name for field in fields(Tolerances) if getattr(tolerances, field.name) == 0.0]
    if sensors.tachometer_delay == 0.0:
        exact.remove("tachometer_delay")
    if exact:
        lines.append(f"tolerances: taken as exactly nominal: {', '.join(exact)}")
    if not sensors.are_timed:
        lines.append("sensors: readings are taken as of the instant at which they are given")
    lines += _of_tracker(sensors.star_tracker)
    if not satellite.oscillators:
        lines.append("oscillators: the body is taken as rigid")
    for number, oscillator in enumerate(satellite.oscillators, 1):
        lines += [f"oscillator {number}: {line}" for line in _of_oscillator(oscillator)]
    return lines


def _is(value: object, default: object) -> bool:
    return value is None if default is None else isinstance(value, float) and value == default


def _shown(satellite: Satellite, name: str) -> str:
    value = getattr(satellite, name)
    return "not given" if value is None else f"{value:g} {_UNITS[name]}, the default"


def _of_tracker(tracker: StarTracker | None) -> list[str]:
    if tracker is None:
        return ["sensors.star_tracker: none"]
    blinds = {"rate_limit": "a high rate", "sun_exclusion": "the Sun", "earth_exclusion": "the Earth"}
    never = [what for name, what in blinds.items() if getattr(tracker, name) is None]
    return [f"star tracker: never blind because of {' or '.join(never)}"] if never else []


def _of_oscillator(oscillator: Oscillator) -> list[str]:
    known = [name for name in ("mass", "frequency", "damping") if getattr(oscillator, f"{name}_std") == 0.0]
    lines = [f"taken as exactly known: {', '.join(known)}"] if known else []
    if oscillator.deflection_limit is None:
        lines.append("any deflection is allowed")
    return lines
