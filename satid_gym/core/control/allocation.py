"""Allocation of the wheels: what they can give of a torque, and store of a momentum.

Where a vector takes more than the wheels have, each of its axes goes only a share of its way, and the shares are as
near to 1 as the wheels can make them. To cut each wheel's torque by itself would turn the torque, and with it the
rate, wherever the wheels or the principal axes are not the body axes.
"""

from __future__ import annotations

import numpy as np

from satid_gym.core.algebra import add, axpy, cross, dot, inverse, multiply, norm, scale, subtract
from satid_gym.core.jit import inline, outline
from satid_gym.core.wheels import sum_wheels

_ADDED_MAX = 50  # more than it ever takes
_EXACT = 1e-12  # of a share, and of a limit
_PARALLEL = 1e-12  # square of the sine of an angle between normals
_ROUNDING = 1e-9  # of a limit
_ZERO = (0.0, 0.0, 0.0)


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


@inline
def _exceeded(share, target, symmetric, wheels):
    """Unit normal, outward, of the constraint that shares exceed most, and by how much; none if that is rounding."""
    allocation, bias, limit = wheels
    x, y, z = share
    normal, excess = _ZERO, _EXACT
    for k in range(bias.shape[0]):
        row = scale(target, multiply(symmetric, (allocation[k, 0], allocation[k, 1], allocation[k, 2])))
        length = norm(row)
        value, most = bias[k] + dot(row, share), max(limit[k], abs(bias[k]))
        if abs(value) > (1.0 + _EXACT) * most and abs(value) - most > excess * length:
            normal, excess = axpy(np.sign(value) / length, row, _ZERO), (abs(value) - most) / length
    if max(-x, x - 1.0) > excess:
        normal, excess = (np.sign(x), 0.0, 0.0), max(-x, x - 1.0)
    if max(-y, y - 1.0) > excess:
        normal, excess = (0.0, np.sign(y), 0.0), max(-y, y - 1.0)
    if max(-z, z - 1.0) > excess:
        normal, excess = (0.0, 0.0, np.sign(z)), max(-z, z - 1.0)
    return normal, excess


@inline
def _components(v, normals, count):
    """Components of a vector along the first `count` of three vectors, and its part across them."""
    a, b, c = normals
    if count < 2:
        along = dot(a, v)
        return (along, 0.0, 0.0), axpy(-along, a, v)
    if count < 3:
        c = cross(a, b)
    bc, ca, ab = cross(b, c), cross(c, a), cross(a, b)
    volume = dot(a, bc)
    first, second, third = dot(bc, v) / volume, dot(ca, v) / volume, dot(ab, v) / volume
    if count < 3:
        return (first, second, 0.0), axpy(third, c, _ZERO)
    return (first, second, third), _ZERO


@inline
def _put(new, old, place):
    """Three things with a new one at a place, from 0."""
    if place < 1:
        return new, old[1], old[2]
    return (old[0], new, old[2]) if place < 2 else (old[0], old[1], new)


@inline
def _drop(none, old, place):
    """Three things without that at a place, from 0; those after it move up, and the last is none."""
    if place < 1:
        return old[1], old[2], none
    return (old[0], old[2], none) if place < 2 else (old[0], old[1], none)


@inline
def _activate(share, normal, excess, normals, multipliers, count):
    """Shares that keep one constraint more, which they exceed; the constraints that are active with it.

    Active are the first `count` of three unit normals and Lagrange multipliers, and all others are 0. Count is below 0
    where the constraint contradicts them.
    """
    multiplier = 0.0
    for _ in range(4):  # at most three are let go
        along, across = _components(normal, normals, count)
        square = dot(across, across)
        step = excess / square if square > _PARALLEL else np.inf
        place = -1
        if along[0] > 0.0 and multipliers[0] < step * along[0]:
            step, place = multipliers[0] / along[0], 0
        if along[1] > 0.0 and multipliers[1] < step * along[1]:
            step, place = multipliers[1] / along[1], 1
        if along[2] > 0.0 and multipliers[2] < step * along[2]:
            step, place = multipliers[2] / along[2], 2
        if step >= np.inf:
            return share, normals, multipliers, -1
        multiplier += step
        multipliers = axpy(-step, along, multipliers)
        if square > _PARALLEL:
            share = axpy(-step, across, share)
            excess -= step * square
        if place < 0:
            return share, _put(normal, normals, count), _put(multiplier, multipliers, count), count + 1
        normals, multipliers = _drop(_ZERO, normals, place), _drop(0.0, multipliers, place)
        count -= 1
    return share, normals, multipliers, -1


@outline
def within_reach(target, symmetric, allocation, bias, limit):
    """The target with each component as much reduced as the wheels ask for, by shares in [0, 1] as near 1 as can be.

    The wheels allow x where |bias_k + (allocation S x)_k| <= limit_k for every wheel k, or <= |bias_k| where that is
    more, so that 0 is always allowed. Distance is counted in shares, so that a small correction, which costs the
    wheels little, is hardly reduced for the sake of a large one. From shares of (1, 1, 1) the constraint that is
    exceeded most is made to hold, one after another, and those that no longer bind are let go.

    Args:
        target: 3-vector.
        symmetric: matrix S that takes it to the body: an inertia, or an inertia over a time.
        allocation: (n, 3) pseudo-inverse of the wheel axes.
        bias, limit: (n,).

    Source: Goldfarb and Idnani 1983, A numerically stable dual method for solving strictly convex quadratic programs.
    """
    if fits(multiply(symmetric, target), allocation, bias, limit):
        return target
    share, normals, multipliers, count = (1.0, 1.0, 1.0), (_ZERO, _ZERO, _ZERO), _ZERO, 0
    wheels = (allocation, bias, limit)
    normal, excess = _exceeded(share, target, symmetric, wheels)
    for _ in range(_ADDED_MAX):
        share, normals, multipliers, count = _activate(share, normal, excess, normals, multipliers, count)
        normal, excess = _exceeded(share, target, symmetric, wheels)
        if excess <= _EXACT or count < 0:
            break
    x, y, z = share
    x = scale(target, (min(max(x, 0.0), 1.0), min(max(y, 0.0), 1.0), min(max(z, 0.0), 1.0)))
    reached, rest = multiply(symmetric, x), 1.0
    for k in range(bias.shape[0]):
        value, most = allocate(allocation, reached, k), max(limit[k], abs(bias[k]))
        if abs(bias[k] + value) > (1.0 + _ROUNDING) * most:  # by rounding alone none is held back
            rest = min(rest, (most - np.sign(value) * bias[k]) / abs(value))
    return rest * x[0], rest * x[1], rest * x[2]


@inline
def storable(reference, momentum, inertia, wheels, spin):
    """The reference as far as the wheels can store the momentum that it leaves to them, rad/s.

    Args:
        reference: body rate, rad/s.
        momentum: total, body frame, N m s.
        inertia: estimated J, kg m^2.
        wheels: axes (3, n), allocation (n, 3) and the momentum that each may store (n,), N m s.
        spin: (n,) j Omega of each wheel, N m s; overwritten.
    """
    axes, allocation, limit = wheels
    change = subtract(momentum, sum_wheels(axes, spin))
    for k in range(spin.shape[0]):
        spin[k] = -(spin[k] + allocate(allocation, change, k))  # with the body at rest, sign reversed
    reference = within_reach(reference, inertia, allocation, spin, limit)
    body = multiply(inertia, reference)
    for k in range(spin.shape[0]):  # what a wheel holds beyond its limit with the body at rest, the body takes
        spin[k] = min(max(-(spin[k] + allocate(allocation, body, k)), -limit[k]), limit[k])
    left = subtract(subtract(momentum, body), sum_wheels(axes, spin))
    return add(reference, multiply(inverse(inertia), left))
