"""Open-loop simulation of the truth, without noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from satid_gym.config import check_integer, check_number, real_array
from satid_gym.core import kernels
from satid_gym.disturbance import Disturbance
from satid_gym.laws import InertiaLaw
from satid_gym.modes import fastest_oscillation
from satid_gym.oscillators import oscillator_count
from satid_gym.plants import new_plant
from satid_gym.satellite import Satellite

_SUBSTEPS_MIN = 10
_ANGLE = 0.01  # rad, that body and momentum may turn against each other in one step


@dataclass(frozen=True, eq=False, kw_only=True)
class Trajectory:
    """Result of `simulate`; N torques give N + 1 states.

    Attributes:
        time: (N + 1,) s.
        omega: (N + 1, 3) body rate, rad/s, body frame.
        wheel_speed: (N + 1, n) relative to the body, rad/s.
        momentum: (N + 1, 3) total angular momentum, N m s, body frame.
        attitude: (N + 1, 4) quaternion, body to inertial, scalar last.
        torque: (N, n) motor torque applied, less friction, mean over each interval, N m.
        inertia: (N + 1, 3, 3) kg m^2, oscillators at rest.
        deflection: (N + 1, c) of the oscillators: rad of a panel, m of a slosh mass; first and second of a mirrored
            pair follow each other.
    """

    time: np.ndarray
    omega: np.ndarray
    wheel_speed: np.ndarray
    momentum: np.ndarray
    attitude: np.ndarray
    torque: np.ndarray
    inertia: np.ndarray
    deflection: np.ndarray


def simulate(
    satellite: Satellite,
    torque: np.ndarray,
    dt: float,
    *,
    omega0: object = (0.0, 0.0, 0.0),
    wheel_speed0: object = None,
    attitude0: object = (0.0, 0.0, 0.0, 1.0),
    deflection0: object = None,
    law: InertiaLaw | None = None,
    disturbance: Disturbance | object = None,
    substeps: int | None = None,
) -> Trajectory:
    """Fly a torque history; exact dynamics with torque and speed limits, no noise.

    Args:
        satellite: its nominal inertia is taken as the true one.
        torque: (N, n) motor torque on the wheels, N m, each held for dt; cut to the torque limit. The body
            feels -A u.
        dt: s.
        omega0: (3,) first body rate, rad/s.
        wheel_speed0: (n,) first wheel speeds, rad/s; at rest where None.
        attitude0: (4,) first attitude, body to inertial, scalar last; it is normalised.
        deflection0: (c,) first deflection of the oscillators, at rest relative to the body; 0 where None.
        law: how the inertia varies; static where None.
        disturbance: external torque: a `Disturbance`, or (3,) N m constant in the body frame.
        substeps: Runge-Kutta steps in each dt; the error goes with the fourth power of the angle turned in one
            of them. One that would not keep |M| is halved. None takes ten, or more where that angle could exceed
            0.01 rad.

    Returns:
        Trajectory.

    Raises:
        ValueError: an argument is not finite, has another shape, or a wheel starts beyond its limit.
    """
    if not isinstance(satellite, Satellite):
        raise ValueError(f'satellite must be a Satellite, such as SATELLITES["microsat"], got {satellite!r}')
    if law is not None and not isinstance(law, InertiaLaw):
        raise ValueError(f"law must be an InertiaLaw, got {law!r}")
    wheels = satellite.wheels
    torque = np.ascontiguousarray(real_array("torque", torque))
    if torque.ndim != 2 or torque.shape[1] != wheels.count:
        raise ValueError(f"torque must have shape (N, {wheels.count}), got {torque.shape}")
    dt = check_number("dt", dt, strict=True)
    if substeps is not None:
        substeps = check_integer("substeps", substeps)
    if disturbance is not None and not isinstance(disturbance, Disturbance):
        disturbance = Disturbance(constant=real_array("disturbance", disturbance, (3,)))
    rows = new_plant(satellite, law, disturbance)
    row = rows[0]
    row["rate"] = real_array("omega0", omega0, (3,))
    if wheel_speed0 is not None:
        speed = real_array("wheel_speed0", wheel_speed0, (wheels.count,))
        if np.any(np.abs(speed) > wheels.max_speed):
            raise ValueError(f"wheel_speed0 must be within +-{wheels.max_speed.tolist()} rad/s, got {speed.tolist()}")
        row["wheel_speed"] = speed
    attitude = real_array("attitude0", attitude0, (4,))
    norm = np.linalg.norm(attitude)
    if norm < 1e-6:
        raise ValueError("attitude0 must be a quaternion of nonzero length")
    row["attitude"] = attitude / norm
    if deflection0 is not None:
        shape = (oscillator_count(satellite.oscillators),)
        row["oscillators"]["deflection"] = real_array("deflection0", deflection0, shape)
    count, n = torque.shape
    if substeps is None:
        substeps = max(_SUBSTEPS_MIN, math.ceil(_fastest(satellite, row, torque, dt) * dt / _ANGLE))
    out = Trajectory(
        time=dt * np.arange(count + 1),
        omega=np.empty((count + 1, 3)),
        wheel_speed=np.empty((count + 1, n)),
        momentum=np.empty((count + 1, 3)),
        attitude=np.empty((count + 1, 4)),
        torque=np.empty((count, n)),
        inertia=np.empty((count + 1, 3, 3)),
        deflection=np.empty((count + 1, oscillator_count(satellite.oscillators))),
    )
    path = (out.momentum, out.omega, out.wheel_speed, out.attitude, out.inertia, out.deflection)
    kernels.simulate(rows, torque, dt, substeps, path, out.torque)
    return out


def _fastest(satellite: Satellite, row: np.void, torque: np.ndarray, dt: float) -> float:
    """Upper bound of the body rate, of the nutation that stored momentum causes and of the oscillators, rad/s.

    The first two are at most (|M| + |A h|) / J_min, with the wheels at their limit or at what the torque can reach.
    """
    start = np.linalg.norm(row["inertia"] @ row["rate"] + row["axes"] @ (row["wheel_inertia"] * row["wheel_speed"]))
    given = row["wheel_inertia"] * np.abs(row["wheel_speed"]) + dt * np.abs(torque).sum(axis=0)
    stored = np.minimum(given, row["wheel_inertia"] * row["wheel_speed_max"])
    carried = (row["axes"] * row["wheel_inertia"]) @ row["axes"].T
    least = np.linalg.eigvalsh(row["inertia"] - carried)[0]
    turning = float((start + np.linalg.norm(np.abs(row["axes"]) @ stored)) / least)
    return max(turning, fastest_oscillation(satellite.modes, satellite.inertia))
