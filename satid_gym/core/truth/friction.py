"""Friction of the wheels: its torque, and the momentum of wheels that rub in a Runge-Kutta step.

    dh/dt = u - f(Omega),   f = sqrt(2 e) (T_s - T_c) x exp(-x^2) + T_c tanh(10 Omega / Omega_s) + c Omega
    x = Omega / (sqrt(2) Omega_s)

with Coulomb's friction T_c, stiction T_s, which f reaches at Omega_s, and viscous friction c. It is internal, as motor
torque is: M does not change by it, and what the wheel loses the body gets. It acts where plant.rubs is not 0; then h
is a state of the step as well, and the mean torque on each wheel in it goes to plant.net_torque.
Source: Armstrong-Helouvry, Dupont, Canudas de Wit, A survey of models, analysis tools and compensation methods for the
control of machines with friction, Automatica 30 (1994); this form, smooth at rest, is that of Basilisk's
reactionWheelStateEffector and of Simscape's Rotational Friction.
"""

from __future__ import annotations

import numpy as np

from satid_gym.core.jit import inline, outline
from satid_gym.core.wheels import along_axis, sum_wheels

_SHARE = 0.2  # of the speed over which friction changes, that a wheel may gain in one step
_STIFFNESS = 0.5  # of a step: its length times the largest slope of the friction over the rotor's inertia
_REST, _BROKEN_AWAY = 2.0, 9.0  # times Omega_s: below it tanh, and the stiction, still change in double precision


@inline
def friction(plant, speed):
    """Friction torque that brakes a wheel at `speed`, rad/s; N m."""
    x = speed / (np.sqrt(2.0) * plant.stribeck_speed)
    stiction = np.sqrt(2.0 * np.e) * (plant.friction_static - plant.friction_coulomb) * x * np.exp(-x * x)
    coulomb = plant.friction_coulomb * np.tanh(10.0 * speed / plant.stribeck_speed)
    return stiction + coulomb + plant.friction_viscous * speed


@inline
def write_net_torque(plant, torque):
    """Write motor torque (n,) less friction at the present speeds."""
    for k in range(torque.shape[0]):
        plant.net_torque[k] = torque[k] - friction(plant, plant.wheel_speed[k])


@outline
def wheels_after(plant, torque, stage, h, omega):
    """A h after `stage` 0 to 3 of a Runge-Kutta step of h seconds, at the rate omega: of the next stage, or of its end.

    Locked wheels keep their momentum. After stage 3 the mean torque of the step is in plant.net_torque.
    """
    slope, momentum = plant.wheel_slope, plant.stage_momentum
    for k in range(torque.shape[0]):
        start = plant.wheel_momentum[k]
        if plant.locked[k] != 0:
            momentum[k], plant.net_torque[k] = start, 0.0
            continue
        at = start if stage == 0 else momentum[k]
        speed = at / plant.wheel_inertia[k] - along_axis(plant.axes, k, omega)
        slope[stage, k] = torque[k] - friction(plant, speed)
        if stage == 3:
            mean = (slope[0, k] + 2.0 * (slope[1, k] + slope[2, k]) + slope[3, k]) / 6.0
            plant.net_torque[k] = mean
            momentum[k] = start + h * mean
        else:
            momentum[k] = start + (1.0 if stage == 2 else 0.5) * h * slope[stage, k]
    return sum_wheels(plant.axes, momentum)


@outline
def longest_step(plant, torque, most):
    """Longest step, at most `most` seconds, in which no wheel passes too much of the zone where friction bends."""
    coulomb, scale = plant.friction_coulomb, plant.stribeck_speed
    stiction = plant.friction_static - coulomb
    h = most
    for k in range(torque.shape[0]):
        if plant.locked[k] != 0:
            continue
        speed, j = abs(plant.wheel_speed[k]), plant.wheel_inertia[k]
        gain = 1.2 * abs(torque[k] - friction(plant, plant.wheel_speed[k])) / j  # 1.2: for what the body does
        if gain == 0.0:
            continue
        slope = plant.friction_viscous / j
        if speed < _BROKEN_AWAY * scale:
            width = 0.1 * scale if speed < _REST * scale and coulomb > 0.0 else scale
            slope += (10.0 * coulomb + np.sqrt(np.e) * stiction) / (j * scale)
            h = min(h, _SHARE * width / gain)
        else:
            h = min(h, (speed - _BROKEN_AWAY * scale + _SHARE * scale) / gain)
        h = min(h, _STIFFNESS / slope) if slope > 0.0 else h
    return h
