"""Allocation of the wheels: what they can give of a torque, and store of a momentum.

Where a vector takes more than the wheels have, each of its axes goes only a share of its way, and the shares are as
near to 1 as the wheels can make them. To cut each wheel's torque by itself would turn the torque, and with it the
rate, wherever the wheels or the principal axes are not the body axes.
"""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import add, axpy, dot, inverse, multiply, scale, subtract
from satid_gym.core.jit import inline, outline
from satid_gym.core.wheels import sum_wheels

_SWEEPS = 200
_SETTLED = 1e-5  # of a share: what the last sweep left is made good by going a little less far
_ROUNDING = 1e-9  # of a limit


@inline
def allocate(allocation, v, k):
    """Wheel k's part of a vector on the body: row k of `allocation` (n, 3), the pseudo-inverse of the axes, times v."""
    return allocation[k, 0] * v[0] + allocation[k, 1] * v[1] + allocation[k, 2] * v[2]


@inline
def fits(v, allocation, bias, limit):
    """Whether the wheels' parts of a vector on the body, added to their bias (n,), are all within their limit (n,)."""
    within = True
    for k in range(bias.shape[0]):
        within = within and abs(bias[k] + allocate(allocation, v, k)) <= limit[k]
    return within


@outline
def within_reach(target, symmetric, allocation, bias, limit, multiplier):
    """The target with each component as much reduced as the wheels ask for, by shares in [0, 1] as near 1 as can be.

    The wheels allow x where |bias_k + (allocation S x)_k| <= limit_k for every wheel k, or <= |bias_k| where that is
    more, so that 0 is always allowed. Distance is counted in shares, so that a small correction, which costs the
    wheels little, is hardly reduced for the sake of a large one. Projections of the shares (1, 1, 1) on each wheel's
    slab and on the unit cube take turns until they agree.

    Args:
        target: 3-vector.
        symmetric: matrix S that takes it to the body: an inertia, or an inertia over a time.
        allocation: (n, 3) pseudo-inverse of the wheel axes.
        bias, limit: (n,).
        multiplier: (n,) scratch.

    Source: Boyle and Dykstra 1986, A method for finding projections onto the intersection of convex sets.
    """
    count = multiplier.shape[0]
    if fits(multiply(symmetric, target), allocation, bias, limit):
        return target
    for k in range(count):
        multiplier[k] = 0.0
    share, pushed = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)
    for _ in range(_SWEEPS):
        start, worst = share, 0.0
        for k in range(count):
            row = scale(target, multiply(symmetric, (allocation[k, 0], allocation[k, 1], allocation[k, 2])))
            square = dot(row, row)
            if square > 0.0:
                most = max(limit[k], abs(bias[k]))
                worst = max(worst, abs(bias[k] + dot(row, start)) - (1.0 + _SETTLED) * most)
                share = axpy(multiplier[k], row, share)
                value = bias[k] + dot(row, share)
                multiplier[k] = (value - min(max(value, -most), most)) / square
                share = axpy(-multiplier[k], row, share)
        wanted = add(share, pushed)
        share = min(max(wanted[0], 0.0), 1.0), min(max(wanted[1], 0.0), 1.0), min(max(wanted[2], 0.0), 1.0)
        pushed = subtract(wanted, share)
        moved = subtract(share, start)
        if worst <= 0.0 and dot(moved, moved) < _SETTLED**2:
            break
    x = scale(target, share)
    reached, rest = multiply(symmetric, x), 1.0
    for k in range(count):
        value, most = allocate(allocation, reached, k), max(limit[k], abs(bias[k]))
        if abs(bias[k] + value) > (1.0 + _ROUNDING) * most:  # by rounding alone none is held back
            rest = min(rest, (most - np.sign(value) * bias[k]) / abs(value))
    return rest * x[0], rest * x[1], rest * x[2]


@inline
def storable(reference, momentum, inertia, wheels, spin, scratch):
    """The reference as far as the wheels can store the momentum that it leaves to them, rad/s.

    Args:
        reference: body rate, rad/s.
        momentum: total, body frame, N m s.
        inertia: estimated J, kg m^2.
        wheels: axes (3, n), allocation (n, 3) and the momentum that each may store (n,), N m s.
        spin: (n,) j Omega of each wheel, N m s; overwritten.
        scratch: (n,).
    """
    axes, allocation, limit = wheels
    change = subtract(momentum, sum_wheels(axes, spin))
    for k in range(spin.shape[0]):
        spin[k] = -(spin[k] + allocate(allocation, change, k))  # with the body at rest, sign reversed
    reference = within_reach(reference, inertia, allocation, spin, limit, scratch)
    body = multiply(inertia, reference)
    for k in range(spin.shape[0]):  # what a wheel holds beyond its limit with the body at rest, the body takes
        spin[k] = min(max(-(spin[k] + allocate(allocation, body, k)), -limit[k]), limit[k])
    left = subtract(subtract(momentum, body), sum_wheels(axes, spin))
    return add(reference, multiply(inverse(inertia), left))
