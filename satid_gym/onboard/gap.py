"""Gap in the wheel speeds: what it leaves open, where the filter crosses it in a straight line."""

from __future__ import annotations

from satid_gym.core.algebra import axpy, dot, inverse, load, multiply
from satid_gym.core.belief.filters import FilterKind
from satid_gym.core.belief.kalman import estimated_inertia
from satid_gym.core.jit import inline
from satid_gym.core.wheels import wheel_axis

_MOMENTUM = int(FilterKind.MOMENTUM)


@inline
def widen(belief, torque_max, gap):
    """Add to the momentum's covariance what the wheels may have done in a gap, s; `torque_max` (n,) is in N m.

    Within the motors' limits u the body turns by up to J^-1 A u T^2 / 4 from where a line leads: at full torque for
    half the gap and back. Taken as uniform within that, the turn moves the momentum across itself. The RateEKF has no
    momentum, and keeps its covariance. Readings from before the gap that are aligned with later ones count as mixed
    until they have left the means.
    """
    if belief.alignment.on != 0:
        belief.alignment.mixed = belief.alignment.span + 1
    if belief.kind != _MOMENTUM:
        return
    J_inv, turn = inverse(estimated_inertia(belief)), (0.0, 0.0, 0.0)
    for k in range(torque_max.shape[0]):
        x, y, z = multiply(J_inv, wheel_axis(belief.axes, k))
        turn = axpy(0.25 * gap * gap * torque_max[k], (abs(x), abs(y), abs(z)), turn)
    variance = max(turn[0], turn[1], turn[2]) ** 2 / 3.0
    momentum = load(belief.mean)
    square = dot(momentum, momentum)
    for i in range(3):
        belief.covariance[i, i] += variance * square
        for j in range(3):
            belief.covariance[i, j] -= variance * momentum[i] * momentum[j]
