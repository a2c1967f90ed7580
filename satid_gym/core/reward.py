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
def uncertainty_nats(belief, work, criterion):
    """Uncertainty of theta in nats, 0 for the prior; NaN and belief.broken = 1 where P is not positive."""
    p = belief.prior_theta.shape[0]
    block = work.block
    if criterion == _LOGDET:
        product = factor_theta(belief, work)
        if not product > 0.0:
            belief.broken = 1
        for i in range(p):
            product /= belief.prior_theta_std[i] ** 2
        return 0.5 * np.log(product)
    for i in range(p):
        for j in range(p):
            scale = belief.prior_theta_std[i] * belief.prior_theta_std[j]
            block[i, j] = theta_covariance(belief, i, j) / scale
    if criterion == _TRACE:
        size = 0.0
        for i in range(p):
            size += block[i, i] / p
    else:
        size = largest_eigenvalue(block, p)
    if not size > 0.0:
        belief.broken = 1
    return 0.5 * p * np.log(size)


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
        - task.effort_weight * report.effort
    )
