"""Report of a decision: tallies of its samples, its costs, and the estimate compared with the truth."""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import axpy_symmetric, frobenius_square, store_symmetric
from satid_gym.core.belief import filters, modes
from satid_gym.core.belief.kalman import estimated_inertia, factor_theta
from satid_gym.core.factors import mahalanobis
from satid_gym.core.jit import inline, outline
from satid_gym.core.records import Cost
from satid_gym.core.reward import saturated_share
from satid_gym.core.truth.inertia_law import inertia_at

_RATE, _SATURATION = int(Cost.RATE), int(Cost.SATURATION)
_DEFLECTION, _AVOIDED_BAND = int(Cost.DEFLECTION), int(Cost.AVOIDED_BAND)
_WINDOW, _KEEP_OUT = int(Cost.WINDOW), int(Cost.KEEP_OUT)


@inline
def note_peaks(plant, belief, report):
    """Tally rate and deflection of this instant, as the filter has them: the reward's penalties are of the largest."""
    rate = filters.rate_used(belief, plant.gyro)
    for i in range(3):
        report.peak_rate[i] = max(report.peak_rate[i], abs(rate[i]))
    report.peak_bend = max(report.peak_bend, modes.bend(belief))


@inline
def note_costs(task, report):
    """Write the decision's costs, and the largest of them."""
    costs = report.costs
    costs[_RATE], costs[_SATURATION] = report.outside, saturated_share(report)
    costs[_DEFLECTION], costs[_AVOIDED_BAND] = report.bent / task.samples, report.in_avoided_band
    costs[_WINDOW], costs[_KEEP_OUT] = report.window_missed / task.samples, report.in_keep_out / task.samples
    report.cost = 0.0
    for i in range(costs.shape[0]):
        report.cost = max(report.cost, costs[i])


@inline
def note_nis(task, nis):
    """Tally the NIS of an instant; 0 is that of one without an update."""
    if nis > 0.0:
        task.nis_sum += nis
        task.nis_count += 1


@outline
def assess(plant, belief, work, report):
    """Compare the estimate with the truth: for info and evaluation, never for reward or observation."""
    p = belief.prior_theta.shape[0]
    truth, estimate = inertia_at(plant, plant.time), estimated_inertia(belief)
    store_symmetric(report.inertia_true, truth)
    store_symmetric(report.inertia_estimate, estimate)
    error = frobenius_square(axpy_symmetric(-1.0, truth, estimate))
    report.relative_error = np.sqrt(error / frobenius_square(truth))
    for k in range(p):
        work.theta[k] = belief.mean[3 + k] - truth[k]
    if factor_theta(belief, work) > 0.0:
        report.nees = mahalanobis(work.block, work.theta, p) / p
    else:
        belief.broken = 1
        report.nees = np.nan
    report.constrained_updates, report.rejected = belief.constrained_updates, belief.rejected
    filters.tell(belief, report)
    report.time = plant.time
