"""Features of the corners of the rate envelope, by which a score chooses among them (`control.corners.tour`).

A feature is a product of properties of a `Choice`, where each is said in full.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from satid_gym.control.corners.choice import Choice
from satid_gym.policy import Mission
from satid_gym.scenario import Scenario

SLEWS = 3.0
FEATURES: dict[str, Callable[[Choice], np.ndarray]] = {
    "waited": lambda c: c.wait_score,  # of axes that reverse, waits over the hold, -1 each that is too early
    "waited_slews": lambda c: c.sum_of(np.where(c.slewed >= SLEWS, c.slewed / SLEWS, -1.0)),  # over what slews take
    "waited_early": lambda c: c.wait_score * c.early,
    "waited_walk": lambda c: c.wait_score * c.walk,
    "reversals": lambda c: c.count,
    "reversals_2s": lambda c: c.sum_of(np.exp(-c.waited / 2.0)),
    "reversals_4s": lambda c: c.sum_of(np.tanh(c.waited / 4.0)),
    "reversals_12s": lambda c: c.sum_of(c.slow),
    "reversals_squared": lambda c: c.count**2 / 3.0,
    "reversals_uncertainty": lambda c: c.count * c.uncertainty,
    "reversals_elapsed": lambda c: c.count * c.gone,
    "reversals_early": lambda c: c.count * c.early,
    "reversals_late": lambda c: c.count * c.late,
    "reversals_walk": lambda c: c.count * c.walk,
    "reversals_slew": lambda c: c.count * c.slew,
    "reversals_slewed": lambda c: c.sum_of(np.tanh(c.slewed)),
    "reversals_frequency": lambda c: c.count * c.mode.frequency,
    "reversals_speed": lambda c: c.count * np.abs(c.mode.speed),
    "unknown": lambda c: c.sum_of(c.unknown),
    "unknown_12s": lambda c: c.sum_of(c.unknown * c.slow),
    "coupled": lambda c: c.sum_of(np.abs(c.mode.direction)),
    "coupled_12s": lambda c: c.sum_of(np.abs(c.mode.direction) * c.slow),
    "any": lambda c: c.some,
    "any_uncertainty": lambda c: c.some * c.uncertainty,
    "any_elapsed": lambda c: c.some * c.gone,
    "any_early": lambda c: c.some * c.early,
    "any_late": lambda c: c.some * c.late,
    "any_walk": lambda c: c.some * c.walk,
    "any_slew": lambda c: c.some * c.slew,
    "any_nis": lambda c: c.some * c.seen["nis"],
    "any_frequency": lambda c: c.some * c.mode.frequency,
    "any_deflection": lambda c: c.some * np.abs(c.mode.deflection),
    "gain": lambda c: c.complete_gain,  # of a complete turn, see above
    "gain_1": lambda c: c.next_gain,  # of what is turned in one decision
    "gain_3": lambda c: c.gain(3.0),
    "gain_10": lambda c: c.gain(10.0),
    "gain_uncertainty": lambda c: c.complete_gain * c.uncertainty,
    "gain_early": lambda c: c.complete_gain * c.early,
    "gain_1_early": lambda c: c.next_gain * c.early,
    "gain_walk": lambda c: c.complete_gain * c.walk,
    "gain_1_walk": lambda c: c.next_gain * c.walk,
    "underway": lambda c: np.tanh((np.abs(c.turn) / c.seen["control_authority"][:, None]).max(axis=2) / 4.0),
    "fullness": lambda c: c.fullness,
    "fullness_beyond": lambda c: 3.0 * np.maximum(c.fullness - 0.7, 0.0),
    "load": lambda c: c.load,
    "load_beyond": lambda c: 3.0 * np.maximum(c.load - 0.5, 0.0),
    "peak": lambda c: np.minimum(c.peak, 1.2),  # of modes, over their limit
    "peak_3": lambda c: c.later,
    "peak_kept": lambda c: c.kept,
    "peak_kept_frequency": lambda c: c.kept * c.mode.frequency,
    "drive": lambda c: np.abs(c.drive),
    "drive_frequency": lambda c: np.abs(c.drive) * c.mode.frequency,
    "drive_deflection": lambda c: c.drive * c.mode.deflection,
    "drive_speed": lambda c: c.drive * c.mode.speed,
    "pull": lambda c: np.abs(c.pull),
    "pull_deflection": lambda c: c.pull * c.mode.deflection,
    "pull_speed": lambda c: c.pull * c.mode.speed,
    "reversals_closing": lambda c: c.count * c.closing,
    "any_closing": lambda c: c.some * c.closing,
    "gain_closing": lambda c: c.complete_gain * c.closing,
    "towards": lambda c: c.towards,
    "towards_closing": lambda c: c.towards * c.closing,
    "stars_closing": lambda c: c.star_gain * c.closing,
    "stars": lambda c: c.star_gain,
    "stars_early": lambda c: c.star_gain * c.early,
    "stars_uncertainty": lambda c: c.star_gain * c.uncertainty,
    "stars_onward": lambda c: c.onward,
    "band_crossing": lambda c: c.crossing,
    "band_crossing_early": lambda c: c.crossing * c.early,
    "band_crossing_late": lambda c: c.crossing * c.late,
    "band_crossing_uncertainty": lambda c: c.crossing * c.uncertainty,
    "band_crossing_walk": lambda c: c.crossing * c.walk,
    "band_crosses": lambda c: np.minimum(c.crossing, 1.0),
    "band_stay": lambda c: c.stay,
    "band_size": lambda c: np.abs(c.corners).max(axis=2),
}
"""Features (N, 8) of corners by name: products of the properties of a `Choice`."""
_OF_MODES = ("frequency", "speed", "coupled", "deflection", "peak", "drive", "pull")
_OF_STARS = ("stars",)
_OF_WINDOWS = ("closing", "towards")
_OF_BAND = ("band",)


def _without(*parts: str) -> tuple[str, ...]:
    return tuple(name for name in FEATURES if not any(part in name for part in parts))


def features_of(scenario: Scenario, is_shaped: bool = False) -> tuple[str, ...]:
    """Features that a scenario has: of modes, stars, imaging windows and a band of wheel speed where there are any.

    A shaped tour forecasts no peaks, so that it has no features of them.
    """
    absent = ["peak"] if is_shaped else []
    if scenario.appendages is None:
        absent += _OF_MODES
    if scenario.sensors is None or scenario.sensors.star_tracker is None:
        absent += _OF_STARS
    if scenario.operations is None:
        absent += _OF_WINDOWS
    if scenario.wheels is None or not scenario.wheels.avoided[1] > scenario.wheels.avoided[0]:
        absent += _OF_BAND
    return _without(*absent)


def takes_stars(names: Sequence[str]) -> bool:
    """Whether one of the features takes the fixes of a star tracker."""
    return any(part in name for name in names for part in _OF_STARS)


def takes_windows(names: Sequence[str]) -> bool:
    """Whether one of the features takes imaging windows and their targets."""
    return any(part in name for name in names for part in _OF_WINDOWS)


def takes_band(names: Sequence[str]) -> bool:
    """Whether one of the features takes the band of wheel speed that operators avoid."""
    return any(part in name for name in names for part in _OF_BAND)


def takes_walk(names: Sequence[str]) -> bool:
    """Whether one of the features takes the filter's random walk of the inertia, as observed with `include_walk`."""
    return any("walk" in name for name in names)


def check_seen(names: Sequence[str], mission: Mission) -> None:
    """Check that imaging windows and the inertia's walk are observed where features take them.

    Raises:
        ValueError: they are not.
    """
    world = mission.scenario
    if takes_windows(names) and world.operations is None:
        raise ValueError(
            f'features of imaging windows are chosen and scenario {world.name!r} has none: take "operations", or a '
            "policy for this scenario"
        )
    if takes_walk(names) and "inertia_walk" not in mission.layout:
        raise ValueError(
            "features of the inertia's walk are chosen but it is not observed: make the environment, or the policy, "
            "with include_walk=True"
        )


def check_features(names: Sequence[str]) -> tuple[str, ...]:
    """The names, checked.

    Raises:
        ValueError: one is unknown or twice there.
    """
    unknown = [name for name in names if name not in FEATURES]
    if unknown or len(set(names)) < len(names):
        raise ValueError(f"features of corners are each of {', '.join(FEATURES)}, at most once; got {list(names)}")
    return tuple(names)
