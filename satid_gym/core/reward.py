"""Reward: information on the inertia, less the cost of leaving the envelope.

Belief and measurement only. Information is counted in nats, by one of three criteria of optimal design on
the normalised covariance C of theta (std over prior std): D  log det C / 2, A  p/2 log(tr C / p),
E  p/2 log(largest eigenvalue of C). By the inequality of the means D <= A <= E for the same C.
Source: Pukelsheim, Optimal Design of Experiments (1993), ch. 6.
"""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import largest_eigenvalue
from satid_gym.core.belief.kalman import factor_theta, theta_covariance
from satid_gym.core.jit import inline, outline
from satid_gym.core.records import Criterion

_LOGDET, _TRACE = int(Criterion.LOGDET), int(Criterion.TRACE)


@outline
def dispersion(belief, work, criterion):
    """Dispersion of theta, 1 for the prior: det C, tr C / p or the largest eigenvalue of C.

    NaN, and belief.broken = 1, where P is not positive definite.
    """
    p = belief.prior_theta.shape[0]
    block = work.block
    if criterion == _LOGDET:
        prior, size = 1.0, factor_theta(belief, work)
        for i in range(p):
            prior *= belief.prior_theta_std[i] ** 2
        size /= prior
    else:
        for i in range(p):
            for j in range(p):
                scale = belief.prior_theta_std[i] * belief.prior_theta_std[j]
                block[i, j] = theta_covariance(belief, i, j) / scale
        size = 0.0
        if criterion == _TRACE:
            for i in range(p):
                size += block[i, i] / p
        else:
            size = largest_eigenvalue(block, p)
    if not size > 0.0:
        belief.broken = 1
        return np.nan
    return size


@inline
def nats(belief, dispersed, criterion):
    """Nats that a dispersion stands for, or a ratio of two of them."""
    return (0.5 if criterion == _LOGDET else 0.5 * belief.prior_theta.shape[0]) * np.log(dispersed)


@inline
def uncertainty_nats(belief, work, criterion):
    """Uncertainty of theta in nats, 0 for the prior; NaN where `dispersion` is."""
    return nats(belief, dispersion(belief, work, criterion), criterion)


@inline
def envelope_excess(task, report):
    """Excess of the decision's largest rates, as the filter uses them, over the margin: relative, summed over axes."""
    total = 0.0
    for i in range(3):
        total += max(0.0, report.peak_rate[i] / task.rate_limit - task.envelope_margin)
    return total


@inline
def saturated_share(report):
    """Share of the wheels that were at their speed limit in the decision, as their drives report it."""
    count = 0.0
    for k in range(report.saturated.shape[0]):
        count += report.saturated[k]
    return count / report.saturated.shape[0]


@inline
def reward(task, report):
    """Reward of a decision: the sum that `satid_gym.reward.RewardSettings` gives."""
    return (
        task.gain_scale * report.information_gain
        + task.held_scale * (report.information_held - task.held_reference)
        - task.envelope_weight * envelope_excess(task, report)
        - task.saturation_weight * saturated_share(report)
        - task.deflection_weight * max(0.0, report.peak_bend - 1.0)
        - task.avoided_band_weight * report.read_in_band / task.samples
        - task.effort_weight * report.effort
    )
