"""Episode as drawn: satellite and law in the words of their settings, from the core's record of the truth."""

from __future__ import annotations

import numpy as np

from satid_gym.core.records import InertiaMode
from satid_gym.laws import MASS_MODES, TABLE, InertiaLaw
from satid_gym.oscillators import Oscillator, Panel
from satid_gym.satellite import Satellite
from satid_gym.truth.protocol import Episode


def drawn_episode(satellite: Satellite, plant: np.void, sample_period: float) -> Episode:
    """Episode of a drawn plant.

    Args:
        satellite: nominal, as the scenario operates it.
        plant: record of the truth, drawn.
        sample_period: s.
    """
    o = plant["oscillators"]
    wheels = satellite.wheels.replace(axes=plant["axes"], inertia=plant["wheel_inertia"])
    built = satellite.replace(
        inertia=plant["inertia"], wheels=wheels, oscillators=_built(satellite.oscillators, o["scale"])
    )
    return Episode(
        satellite=built,
        law=_law(plant),
        rate=plant["rate"].copy(),
        wheel_speed=plant["wheel_speed"].copy(),
        attitude=plant["attitude"].copy(),
        deflection=o["deflection"].copy(),
        deflection_rate=o["speed"].copy(),
        sample_period=sample_period,
        seed=int(plant["stream"][0]),
    )


def _built(oscillators: tuple[Oscillator, ...], scale: np.ndarray) -> tuple[Oscillator, ...]:
    """Oscillators off nominal by drawn factors (c, 3) of mass, frequency and damping ratio."""
    built: list[Oscillator] = []
    place = 0
    for o in oscillators:
        mass, frequency, damping = scale[place]
        changes = {"mass": mass * o.mass, "frequency": frequency * o.frequency, "damping": damping * o.damping}
        built.append(o.replace(**changes, **({"inertia": mass * o.inertia} if isinstance(o, Panel) else {})))
        place += o.count
    return tuple(built)


def _law(plant: np.void) -> InertiaLaw:
    """Law of a drawn plant, its change absolute."""
    mode = InertiaMode(int(plant["law"])).name.lower()
    time, change = float(plant["law_time"]), plant["change"].copy()
    if mode == TABLE:
        count = int(plant["knots"])
        values = plant["knot_change"][:count][:, [0, 3, 4, 3, 1, 5, 4, 5, 2]].reshape(count, 3, 3)
        return InertiaLaw("table", times=plant["knot_time"][:count].copy(), values=values)
    if mode in MASS_MODES:  # a mass at 1 m along the axis about which the change has no moment
        values, axes = np.linalg.eigh(change)
        place = axes[:, np.argmin(np.abs(values))]
        mass, duration = 0.5 * abs(float(np.trace(change))), float(plant["law_duration"])
        return InertiaLaw(mode, mass=mass, place=place, time=time, duration=duration or 1.0)  # type: ignore[arg-type]
    if mode == "static":
        return InertiaLaw("static")
    frequency, phase = float(plant["law_frequency"]), float(plant["law_phase"])
    return InertiaLaw(mode, change=change, time=time, frequency=frequency, phase=phase)  # type: ignore[arg-type]
