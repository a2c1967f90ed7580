"""Lost axis: the rate about an axis that no wheel turns any more is kept by turning about the others.

With the wheel of the axis d lost, of three, p = d^T J omega changes by what the total momentum M brings there alone,

    dp/dt = (d x M)^T omega

so that the other axes' rates steer it. A reference is changed by as little as makes

    -a (p_max + p) <= dp/dt <= a (p_max - p)

which keeps p within p_max, or brings it back; no axis is asked for more than its reference says, or half of the rate
limit. Where |M| is too small compared with what the lost wheel holds, there is no attitude with a p within p_max.

Source: this project's design; the condition on dp/dt is that of Ames, Xu, Grizzle, Tabuada 2017, Control Barrier
Function Based Quadratic Programs for Safety Critical Systems.
"""

from __future__ import annotations

from satid_gym.core.algebra import axpy, cross, dot, multiply, scale
from satid_gym.core.jit import inline, outline

_PULL = 0.4  # a, 1/s
_KEPT = 0.85  # p_max, of what the rate limit about d stands for
_CAP_MIN = 0.5  # of the rate limit
_ROUNDING = 1e-9  # of |M|^2


@inline
def _cut(value, cap):
    """The value within [-cap, cap]."""
    return min(max(value, -cap), cap)


@inline
def _room(value, cap):
    """1 where the value is short of its cap, else 0."""
    return 1.0 if abs(value) < cap else 0.0


@outline
def constrain(reference, d, state, rate_limit):
    """The reference, rad/s, changed so that the rate about d stays within the limit.

    Args:
        reference: body rate, rad/s.
        d: unit vector, body frame.
        state: body rate, rad/s; total momentum, body frame, N m s; estimated J, kg m^2.
        rate_limit: rad/s.
    """
    omega, momentum, inertia = state
    body = multiply(inertia, d)
    along = dot(d, body)
    p, most = dot(body, omega), _KEPT * rate_limit * along
    low, high = -_PULL * (most + p), _PULL * (most - p)
    turn = cross(d, momentum)
    way = axpy(-dot(turn, body) / dot(body, body), body, turn)  # the part of it that leaves p
    cap = (
        max(abs(reference[0]), _CAP_MIN * rate_limit),
        max(abs(reference[1]), _CAP_MIN * rate_limit),
        max(abs(reference[2]), _CAP_MIN * rate_limit),
    )
    wanted = axpy((p - dot(body, reference)) / along, d, reference)
    for _ in range(3):
        slope = dot(turn, wanted)
        missed, gained = min(max(slope, low), high) - slope, dot(turn, way)
        if missed == 0.0 or gained <= _ROUNDING * dot(momentum, momentum):
            break
        x, y, z = axpy(missed / gained, way, wanted)
        wanted = _cut(x, cap[0]), _cut(y, cap[1]), _cut(z, cap[2])
        way = scale(way, (_room(x, cap[0]), _room(y, cap[1]), _room(z, cap[2])))
    return wanted
