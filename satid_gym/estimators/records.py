"""Belief record of the core, built from a prior and an estimator's settings."""

from __future__ import annotations

import numpy as np

from satid_gym.core.belief.records import belief_dtype, work_dtype
from satid_gym.estimators.inertia import PARAMETER_COUNT, inertia_parameters
from satid_gym.estimators.prior import FilterPrior, estimated_parameters
from satid_gym.estimators.settings import EstimatorSettings


def new_belief(prior: FilterPrior, settings: EstimatorSettings) -> np.ndarray:
    """One row of belief, not yet started by a reading."""
    wheels, parameters = prior.wheels, estimated_parameters(settings.parameters, prior)
    n, p = wheels.count, PARAMETER_COUNT[parameters]
    size, errors = p + settings.other_states(prior), settings.calibration_states(prior)
    modes, trackers = settings.mode_count(prior), int(settings.tells_attitude(prior))
    rows = np.zeros(1, belief_dtype(n, p, size, errors, modes, trackers, prior.sensors.lines))
    row = rows[0]
    row["kind"], row["substeps"] = settings.kind, 1
    row["axes"], row["wheel_inertia"] = wheels.axes, wheels.inertia
    row["prior_theta"] = inertia_parameters(prior.inertia, parameters)
    row["theta_scale"] = prior.theta_scale(parameters)
    settings.write(row, prior, parameters)
    return rows


def new_work(beliefs: np.ndarray) -> np.ndarray:
    """Scratch space for one thread that works on such beliefs."""
    n, p, size = (beliefs[name].shape[1] for name in ("wheel_inertia", "prior_theta", "mean"))
    return np.zeros(1, work_dtype(n, p, size, beliefs["modes"]["coupling"].shape[1]))
