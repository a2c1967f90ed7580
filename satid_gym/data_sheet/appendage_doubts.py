"""Doubts about panels, tanks and star trackers."""

from __future__ import annotations

import numpy as np

from satid_gym.oscillators import Oscillator, Panel
from satid_gym.satellite import Satellite
from satid_gym.star_tracker import StarTracker

_FREQUENCY = (0.005, 50.0)  # Hz
_DAMPING = 0.1  # of critical
_ANGLE = 0.5  # rad, of a deflection limit
_REACH = 10.0  # distance over that at which the body's mass would give its inertia
_STD = (2e-7, 1e-3)  # rad, 0.04 to 206 arcsec
_BLIND_RATE = 0.35  # rad/s, 20 deg/s
_REACQUIRE = 600.0  # s


def oscillator_doubts(oscillator: Oscillator, satellite: Satellite) -> list[str]:
    """What is hard to believe of a panel or a slosh mass, one line each."""
    found, limit = [], oscillator.deflection_limit
    place, far = float(np.linalg.norm(oscillator.place)), "hinge and arm" if _bends(oscillator) else "position"
    if not _FREQUENCY[0] <= oscillator.frequency <= _FREQUENCY[1]:
        found.append(f"the frequency is {oscillator.frequency:.3g} Hz: is it in Hz?")
    if oscillator.damping > _DAMPING:
        found.append(f"the damping is {oscillator.damping:.3g} of critical: is it in per cent?")
    if satellite.mass is not None:
        about = float(np.sqrt(np.trace(satellite.inertia) / (2.0 * satellite.mass)))
        if place > _REACH * about:
            found.append(
                f"its centre of mass is {place:.3g} m from the satellite's, whose inertia is that of its mass at "
                f"{about:.2g} m: are {far} in m?"
            )
    if limit is not None and _bends(oscillator) and limit > _ANGLE:
        found.append(f"the deflection limit is {limit:.3g} rad: is it in deg?")
    if limit is not None and not _bends(oscillator) and limit > place:
        found.append(f"the deflection limit, {limit:.3g} m, is more than its distance from the centre: is it in m?")
    return found


def _bends(oscillator: Oscillator) -> bool:
    return isinstance(oscillator, Panel)


def tracker_doubts(tracker: StarTracker) -> list[str]:
    """What is hard to believe of a star tracker, one line each."""
    found = []
    for name in ("across_std", "round_std"):
        if not _STD[0] <= (std := getattr(tracker, name)) <= _STD[1]:
            found.append(f"{name} is {std:.3g} rad, {np.degrees(std) * 3600.0:.3g} arcsec: is it in rad?")
    if tracker.round_std < tracker.across_std:
        found.append(
            f"its noise about the boresight, {tracker.round_std:.3g} rad, is less than that across it, "
            f"{tracker.across_std:.3g}: are they exchanged?"
        )
    if tracker.rate_limit is not None and tracker.rate_limit > _BLIND_RATE:
        found.append(f"it is blind beyond {tracker.rate_limit:.3g} rad/s only: is that in deg/s?")
    if tracker.reacquire > _REACQUIRE:
        found.append(f"it takes {tracker.reacquire:.3g} s to track again: is that in s?")
    return found
