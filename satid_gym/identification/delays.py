"""Delays between channels as parameters, and notes on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from satid_gym.identification.estimate import Estimated
from satid_gym.telemetry import Log

DELAY_MIN = 0.05  # of the interval between readings, below which a delay is not worth a word
_CHANNELS = ("wheel speeds", "attitude")


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One identified number with its standard deviation and unit; NaN where the data do not identify it."""

    name: str
    value: float
    std: float
    unit: str = "kg m^2"

    @property
    def determined(self) -> bool:
        """Whether the data identify it."""
        return bool(np.isfinite(self.value))


def delays_of(logs: Sequence[Log], estimated: Estimated, inflation: float) -> list[Parameter]:
    """Delays of the time stamps of wheel speeds and, if measured, attitude relative to the gyro, s."""
    measured = any(log.attitude is not None for log in logs)
    return [_delay(which, estimated, inflation) for which in range(2 if measured else 1)]


def _delay(which: int, estimated: Estimated, inflation: float) -> Parameter:
    """Weighted mean over the flights, with their scatter where that is more."""
    name = f"delay of {_CHANNELS[which]}"
    value, std = estimated.delays[:, which], inflation * estimated.delays_std[:, which]
    there = np.isfinite(std)
    if not there.any():
        return Parameter(name=name, value=np.nan, std=np.nan, unit="s")
    weight = 1.0 / std[there] ** 2
    mean = float((weight * value[there]).sum() / weight.sum())
    birge = float((weight * (value[there] - mean) ** 2).sum() / max(there.sum() - 1, 1))
    return Parameter(name=name, value=mean, std=float(np.sqrt(max(birge, 1.0) / weight.sum())), unit="s")


def delay_notes(logs: Sequence[Log], delays: Sequence[Parameter]) -> list[str]:
    """A line for each delay that stands out of its uncertainty."""
    interval = float(np.median([log.interval for log in logs]))
    return [
        f"stamps of {channel} are {abs(delay.value):.3g} +- {delay.std:.1g} s "
        f"{'late' if delay.value > 0.0 else 'early'} against the gyro's; taken into account"
        for channel, delay in zip(_CHANNELS, delays, strict=False)
        if delay.determined and abs(delay.value) > max(3.0 * delay.std, DELAY_MIN * interval)
    ]
