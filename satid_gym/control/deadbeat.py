"""Deadbeat law: the wheel torque that brings the body rates as near to a reference as one decision can.

The torque that reaches the reference at the end of the decision is

    -A u = (J - A j A^T) (omega_ref - omega) / T + omega_mid x M - tau,    omega_mid = (omega + omega_ref) / 2

from dM/dt = -omega x M + tau and h = j (Omega + A^T omega). Where it takes more than the wheels have, the body goes
only as far as they can (`core.control.allocation`).
"""

from __future__ import annotations

from satid_gym.core.algebra import add, axpy, axpy_symmetric, cross, multiply, subtract
from satid_gym.core.control.allocation import allocate, within_reach
from satid_gym.core.jit import inline
from satid_gym.core.wheels import sum_wheels


@inline
def reach(omega, reference, state, inertia, wheels, period, torque):
    """Rate at the end of a decision, rad/s; the motor torque (n,) that takes the body there is left in `torque`, N m.

    Args:
        omega, reference: body rates, rad/s.
        state: momentum, N m s, and external torque, N m, body frame.
        inertia: J - A j A^T, kg m^2, and its inverse.
        wheels: axes (3, n), allocation (n, 3) and torque limits (n,), N m.
        period: of the decision, s.
    """
    momentum, tau = state
    free, free_inverse = inertia
    axes, allocation, limit = wheels
    way, middle, end = subtract(reference, omega), omega, omega
    scaled = axpy_symmetric(-1.0 / period, free, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    for _ in range(2):  # the second time with the mean rate that the torque will have
        drift = add(tau, cross(momentum, middle))
        for k in range(torque.shape[0]):
            torque[k] = allocate(allocation, drift, k)
        slew = multiply(scaled, within_reach(way, scaled, allocation, torque, limit))
        for k in range(torque.shape[0]):
            torque[k] = min(max(torque[k] + allocate(allocation, slew, k), -limit[k]), limit[k])
        change = multiply(free_inverse, subtract(drift, sum_wheels(axes, torque)))
        end = axpy(period, change, omega)
        middle = axpy(0.5 * period, change, omega)
    return end
