"""Satellite with its panels and tanks as logs have them: frequency, damping and mass of each.

What the data sheet takes as exactly known is not estimated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from satid_gym.data_sheet.consequences import DerivedMode, derived
from satid_gym.identification.delays import Parameter
from satid_gym.identification.flexible_body.search import scaled, search
from satid_gym.satellite import Satellite
from satid_gym.telemetry import Log

_BEYOND = 3.0  # standard deviations of the data sheet
_READINGS_MIN = 8.0  # in an oscillation on the free body, for the readings to follow it
_EXACT = (
    "taken as the data sheet has it, exactly; with a frequency_std, damping_std or mass_std these are estimated, and "
    "count in the intervals"
)
_UNITS = {"frequency": "Hz", "damping": "", "mass": "kg"}


@dataclass(frozen=True, eq=False, kw_only=True)
class Flexible:
    """Satellite with panels and tanks as the logs have them.

    Attributes:
        satellite: with these; without those that the readings cannot follow.
        nominal: as in the data sheet, of the same.
        unknowns: of each: its number among these, and "frequency", "damping" or "mass".
        values: (k,) logarithms of each over its nominal value.
        covariance: (k, k).
        numbers: place of each of the satellite's oscillators in the data sheet, from 1.
        too_fast: those that the readings cannot follow.
    """

    satellite: Satellite
    nominal: Satellite
    unknowns: tuple[tuple[int, str], ...]
    values: np.ndarray
    covariance: np.ndarray
    numbers: tuple[int, ...]
    too_fast: tuple[DerivedMode, ...]

    def parameters(self) -> list[Parameter]:
        """Each estimated number with its standard deviation."""
        found = []
        for (place, what), value, variance in zip(self.unknowns, self.values, np.diag(self.covariance), strict=True):
            size = getattr(self.nominal.oscillators[place], what) * float(np.exp(value))
            name = f"{what} of oscillator {self.numbers[place]}"
            found.append(Parameter(name=name, value=size, std=size * float(np.sqrt(variance)), unit=_UNITS[what]))
        return found

    def notes(self) -> list[str]:
        """A line for each oscillator, and for those that the readings cannot follow."""
        lines = []
        for place, number in enumerate(self.numbers):
            sheet, told, far = self.nominal.oscillators[place], [], 0.0
            for k, (own, what) in enumerate(self.unknowns):
                if own == place:
                    size, std = float(np.exp(self.values[k])), float(np.sqrt(self.covariance[k, k]))
                    was, unit = getattr(sheet, what), f" {_UNITS[what]}".rstrip()
                    told.append(f"{what} {was * size:.4g} +- {was * size * std:.1g}{unit}, nominally {was:.4g}")
                    far = max(far, abs(self.values[k]) / getattr(sheet, f"{what}_std"))
            line = f"oscillator {number}: " + ("; ".join(told) or _EXACT)
            beyond = f"; {far:.1f} of the data sheet's standard deviations away" if far > _BEYOND else ""
            lines.append(line + beyond)
        if self.too_fast:
            share = np.sum([mode.share for mode in self.too_fast], axis=0)
            shares = ", ".join(f"{part:.0%} of {name}" for part, name in zip(share, ("Jxx", "Jyy", "Jzz"), strict=True))
            lines.append(
                "readings are too far apart to follow the data sheet's panels and tanks of "
                f"{', '.join(f'{mode.free:.3g}' for mode in self.too_fast)} Hz, which are taken as rigid: they carry "
                f"{shares}, and where they ring in the log these moments are off by up to that, which is not in the "
                "intervals"
            )
        return lines

    def moved(self) -> Iterator[Satellite]:
        """The satellite, one standard deviation off in each direction of the covariance."""
        if not self.unknowns:
            return
        variances, directions = np.linalg.eigh(self.covariance)
        for variance, direction in zip(variances, directions.T, strict=True):
            off = self.values + np.sqrt(max(variance, 0.0)) * direction
            yield scaled(self.nominal, self.unknowns, off)


def flexible(logs: Sequence[Log], satellite: Satellite, window: float) -> Flexible:
    """Panels and tanks of the data sheet, fitted to logs.

    Raises:
        NotIdentifiedError: no log has a window with enough readings.
    """
    interval = max(log.interval for log in logs)
    modes = derived(satellite).modes
    slow = [k for k, mode in enumerate(modes) if mode.free * interval * _READINGS_MIN <= 1.0]
    nominal = satellite.replace(oscillators=[satellite.oscillators[k] for k in slow])
    unknowns = tuple(
        (place, what)
        for place, oscillator in enumerate(nominal.oscillators)
        for what in _UNITS
        if getattr(oscillator, f"{what}_std") > 0.0 and getattr(oscillator, what) > 0.0
    )
    values, covariance = np.zeros(len(unknowns)), np.zeros((len(unknowns), len(unknowns)))
    if unknowns:
        values, covariance = search(logs, nominal, window, unknowns)
    return Flexible(
        satellite=scaled(nominal, unknowns, values),
        nominal=nominal,
        unknowns=unknowns,
        values=values,
        covariance=covariance,
        numbers=tuple(k + 1 for k in slow),
        too_fast=tuple(mode for k, mode in enumerate(modes) if k not in slow),
    )
