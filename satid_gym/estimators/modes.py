"""Prior of the modes: what a filter is told of panels and slosh masses."""

from __future__ import annotations

import numpy as np

from satid_gym.estimators.prior import FilterPrior


def write_modes(row: np.void, prior: FilterPrior, first: int) -> None:
    """Write what is known of the modes to the belief's record of them; the filter's mean has them from `first` on."""
    row["first"] = first
    for i, mode in enumerate(prior.modes):
        rate = 2.0 * np.pi * mode.frequency
        row["coupling"][i], row["frequency"][i], row["damping"][i] = mode.coupling, rate, mode.damping
        row["inertia_slope"][i], row["inertia_curvature"][i] = mode.inertia_slope, mode.inertia_curvature
        row["limit"][i] = np.inf if mode.deflection_limit is None else mode.deflection_limit
        at_rest = mode.deflection_std, rate * mode.deflection_std
        row["std"][i] = *at_rest, mode.frequency_std, mode.coupling_std, mode.damping_std
