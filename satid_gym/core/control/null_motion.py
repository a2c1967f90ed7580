"""Null motion: torques that cancel each other keep more than three wheels out of a band of speed.

Wheels that hold the momentum H between them hold h = A^+ H + z v, where v leaves none: A v = 0. With the body at rest
H is M, and a body that turns within its envelope changes wheel k by at most its swing

    s_k = sum_i |(A^+ J)_ki| omega_max

so that the room of the wheel at speed Omega_k, negative where a turn may bring it into the band or to its limit, is

    j_k min(|Omega_k| - high, Omega_max,k - |Omega_k|) - s_k

Of a grid the z is taken whose least room is largest, and room beyond a reserve counts for nothing. A change of z brings
wheels through the band too: the present one stays unless another has more room by a part of the way there.

Source: this project's design; that null motion is what is free with four wheels, Markley and Crassidis, Fundamentals of
Spacecraft Attitude Determination and Control (2014), ch. 7.
"""

from __future__ import annotations

import functools

import numpy as np

from satid_gym.core.control.allocation import allocate
from satid_gym.core.jit import inline, outline
from satid_gym.core.records import FLOAT, INT

AWAY = 5.0  # s, time constant with which wheels are led to z
_STEPS = 32  # of the grid, either side of 0
_STAY = 0.05  # room that a change of z has to bring, over the change


@functools.cache
def null_dtype(n: int) -> np.dtype:
    """Settings and state of the null motion of n wheels."""
    return np.dtype(
        [
            ("on", INT),  # 0: wheels share the momentum evenly
            ("direction", FLOAT, n),  # v, its largest component 1 or -1
            ("avoided", FLOAT, (n, 2)),  # band of |j Omega|, N m s
            ("swing", FLOAT, n),  # s_k by the prior's inertia, N m s
            ("reserve", FLOAT),  # N m s
            ("most", FLOAT),  # of |z|, N m s
            ("held", FLOAT),  # z, N m s
        ],
        align=True,
    )


@inline
def _room(s, spin_max, k, spin):
    """Room of wheel k that holds `spin` with the body at rest, N m s."""
    low, high = s.avoided[k, 0], s.avoided[k, 1]
    size = abs(spin)
    clear = size - high
    if low > 0.0:
        clear = max(clear, low - size)
    return min(clear, spin_max[k] - size) - s.swing[k]


@outline
def choose(s, allocation, spin_max, momentum):
    """z for a total momentum, body frame, N m s."""
    best, value = s.held, -np.inf
    for step in range(2 * _STEPS + 2):
        z = s.held if step == 0 else s.most * (step - 1 - _STEPS) / _STEPS
        least = s.reserve
        for k in range(spin_max.shape[0]):
            spin = allocate(allocation, momentum, k) + z * s.direction[k]
            least = min(least, _room(s, spin_max, k, spin))
        least -= _STAY * abs(z - s.held)
        if least > value:
            best, value = z, least
    s.held = best
    return best
