"""Interacting multiple models: a bank of MomentumEKFs, alike but for how fast the inertia may walk.

One of the K models is taken to hold; every `dwell` seconds on average it is drawn anew, all K alike, the present one
among them. A model starts from the mixture of the estimates by which it may have come to hold, and its weight w goes
with the likelihood of the reading. The belief is mean and covariance of the mixture of all. As any model may be drawn,
the mixture that a model starts from is one of its own estimate and of the belief:

    c_k = (1 - a) w_k + a / K,   its own share (1 - a) w_k / c_k,   a = 1 - exp(-dt / dwell)

A filter without models is a bank of one, which is the belief itself.
Source: Blom and Bar-Shalom, The interacting multiple model algorithm for systems with Markovian switching
coefficients (1988).
"""

from __future__ import annotations

import numpy as np

from satid_gym.core import momentum_filter
from satid_gym.core.algebra import load, store
from satid_gym.core.jit import inline
from satid_gym.core.kalman import clear


@inline
def start(belief, bank, work, gyro, tachometer):
    """Belief and models (K,) after the first reading."""
    for k in range(bank.shape[0]):
        momentum_filter.start(bank[k], work, gyro, tachometer)
        bank[k].weight = 1.0 / bank.shape[0]
    if bank.shape[0] > 1:
        belief.broken = 0
        _combine(belief, bank)


@inline
def predict(belief, bank, work, tachometer, dt):
    """Move belief and models on from the last reading to this one, dt seconds later."""
    if bank.shape[0] > 1:
        _mix(belief, bank, dt)
    for k in range(bank.shape[0]):
        momentum_filter.predict(bank[k], work, tachometer, dt)
    if bank.shape[0] > 1:
        _combine(belief, bank)


@inline
def condition(belief, bank, work, gyro):
    """Update with one gyro reading (3,); the models' mean normalised innovation squared (3 degrees of freedom)."""
    nis, best = 0.0, -np.inf
    for k in range(bank.shape[0]):
        model = bank[k]
        own = momentum_filter.condition(model, work, gyro)
        nis += model.weight * own if bank.shape[0] > 1 else own
        if bank.shape[0] > 1:
            determinant = work.noise_determinant * work.whitened_determinant
            model.evidence = np.log(model.weight) - 0.5 * (own + np.log(determinant))
            best = max(best, model.evidence)
    if bank.shape[0] > 1:
        total = 0.0
        for k in range(bank.shape[0]):
            bank[k].weight = np.exp(bank[k].evidence - best)
            total += bank[k].weight
        for k in range(bank.shape[0]):
            bank[k].weight /= total
        _combine(belief, bank)
    return nis


@inline
def _mix(belief, bank, dt):
    """Let every model start from its own estimate and the belief, by the chance that another held before."""
    count, size = bank.shape[0], belief.mean.shape[0]
    change = -np.expm1(-dt / belief.dwell)
    for k in range(count):
        model = bank[k]
        stayed = (1.0 - change) * model.weight
        model.weight = stayed + change / count
        own = stayed / model.weight
        for i in range(size):
            for j in range(i, size):
                apart = (model.mean[i] - belief.mean[i]) * (model.mean[j] - belief.mean[j])
                mixed = own * model.covariance[i, j] + (1.0 - own) * (belief.covariance[i, j] + own * apart)
                model.covariance[i, j] = model.covariance[j, i] = mixed
        for i in range(size):
            model.mean[i] = belief.mean[i] + own * (model.mean[i] - belief.mean[i])


@inline
def _combine(belief, bank):
    """Mean and covariance of the models' mixture."""
    size, guarded = belief.mean.shape[0], 0
    clear(belief)
    for k in range(bank.shape[0]):
        guarded = max(guarded, bank[k].guarded)
        for i in range(size):
            belief.mean[i] += bank[k].weight * bank[k].mean[i]
    belief.guarded = guarded
    store(belief.wheel_input, load(bank[0].wheel_input))
    for k in range(bank.shape[0]):
        model = bank[k]
        for i in range(size):
            for j in range(i, size):
                apart = (model.mean[i] - belief.mean[i]) * (model.mean[j] - belief.mean[j])
                belief.covariance[i, j] += model.weight * (model.covariance[i, j] + apart)
    for i in range(size):
        for j in range(i):
            belief.covariance[i, j] = belief.covariance[j, i]
