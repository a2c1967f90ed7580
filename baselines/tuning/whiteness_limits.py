"""Limits of the whiteness test, from white noise: `python -m baselines.tuning.whiteness_limits`.

Prints for each time constant the quantile of the largest R of a flight that gives the wanted share of flights with an
alarm by any of them, and the share with the limits that `satid_gym.core.belief.whiteness` has.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from baselines.command import cli
from satid_gym.config import check_integer, check_number
from satid_gym.core.belief.whiteness import FALSE_ALARM_RATE, LIMITS, MEMORY, PRIOR, TIME_CONSTANTS

_HALVINGS = 30


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Settings of the command."""

    flights: int = 20_000
    """Flights to draw."""
    readings: int = 3000
    """Readings of a flight."""
    rate: float = FALSE_ALARM_RATE
    """Share of the flights with an alarm."""
    seed: int = 0
    """Seed of the noise."""

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a number is out of range.
        """
        check_integer("flights", self.flights)
        check_integer("readings", self.readings)
        check_integer("seed", self.seed, low=0)
        check_number("rate", self.rate, strict=True, high=0.5)


def largest(flights: int, readings: int, seed: int) -> np.ndarray:
    """(flights, L) largest R of white flights over time and axes, for each of the L time constants."""
    rng = np.random.default_rng(seed)
    kept = np.array([np.exp(-1.0 / T) if T > 0.0 else 0.0 for T in TIME_CONSTANTS], np.float32)
    smoothed, mean = (np.full((flights, 3, len(kept)), x, np.float32) for x in (0.0, 1.0))
    found, left = np.zeros((flights, len(kept)), np.float32), np.ones_like(kept)
    for reading in range(1, readings + 1):
        smoothed += (1.0 - kept) * (rng.standard_normal((flights, 3, 1), dtype=np.float32) - smoothed)
        left *= kept**2
        scale = (1.0 + kept) / ((1.0 - kept) * (1.0 - left))
        mean += (smoothed**2 * scale - mean) / np.float32(min(reading + PRIOR, MEMORY))
        np.maximum(found, mean.max(axis=1), out=found)
    return found


def limits(found: np.ndarray, rate: float) -> np.ndarray:
    """(L,) quantiles of one probability, beyond which that share of the flights (N, L) lies."""
    low, high = 0.0, rate
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        share = (found > np.quantile(found, 1.0 - middle, axis=0)).any(axis=1).mean()
        low, high = (middle, high) if share < rate else (low, middle)
    return np.quantile(found, 1.0 - 0.5 * (low + high), axis=0)


def main(settings: Limits) -> int:
    """Draw the flights of the command line; returns the exit code."""
    found = largest(settings.flights, settings.readings, settings.seed)
    print("T, readings  " + " ".join(f"{T:7.0f}" for T in TIME_CONSTANTS))
    print("limit        " + " ".join(f"{limit:7.3f}" for limit in limits(found, settings.rate)))
    print("in use       " + " ".join(f"{limit:7.3f}" for limit in LIMITS))
    print(
        f"alarms with those in use: {(found > np.array(LIMITS)).any(axis=1).mean():.2%} of {settings.flights} flights"
    )
    return 0


if __name__ == "__main__":
    cli.run(main)
