"""Recorded flights made from `simulate`: truth known, with the habits of real telemetry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from satid_gym import InertiaLaw, ReactionWheels, Satellite, Trajectory, simulate
from satid_gym.telemetry import Log

_SHARE = 0.5  # of the rate limit that slews use
BIAS_STD = 1e-3  # rad/s, of the gyro's constant bias, drawn for each flight
CUBESAT = Satellite(  # a 3U with three wheels, nominal
    "threeu",
    np.array([0.044, 0.045, 0.010]),
    ReactionWheels(inertia=np.array(5.7e-5), max_torque=np.array(2e-3), max_speed=np.array(525.0)),
    rate_limit=0.2,
    gyro_noise_std=1e-4,
    tachometer_noise_std=0.1,
    disturbance_std=1e-6,
)


def drawn(satellite: Satellite, rng: np.random.Generator) -> Satellite:
    """The satellite with an inertia tensor 15 % and some degrees off nominal."""
    tilt = Rotation.from_rotvec(0.05 * rng.normal(size=3)).as_matrix()
    while True:
        moments = np.linalg.eigvalsh(satellite.inertia)[np.argsort(np.argsort(np.diag(satellite.inertia)))]
        moments = moments * np.exp(0.15 * rng.normal(size=3))
        if 2.0 * moments.max() < moments.sum():
            return satellite.replace(inertia=tilt @ np.diag(moments) @ tilt.T)


def slews(satellite: Satellite, rng: np.random.Generator, seconds: float) -> np.ndarray:
    """Motor torque (N, n), N m, at 10 Hz: body torque in pulses that bring the rates to and fro within the limit."""
    wheels, count = satellite.wheels, round(10 * seconds)
    wanted = np.zeros((count, 3))
    start = 0
    while start < count:
        length = int(rng.integers(60, 200))
        wanted[start : start + length] = _SHARE * satellite.rate_limit * rng.uniform(-1.0, 1.0, 3)
        start += length
    moments, rate, torque = np.diag(satellite.inertia), np.zeros(3), np.zeros((count, 3))
    limit = 0.5 * wheels.max_torque.min()
    for k in range(count):  # a rate that follows with a lag of 3 s
        torque[k] = np.clip(moments * (wanted[k] - rate) / 3.0, -limit, limit)
        rate = rate + 0.1 * torque[k] / moments
    return torque @ -np.linalg.pinv(wheels.axes).T


def motion(
    satellite: Satellite,
    rng: np.random.Generator,
    seconds: float,
    law: InertiaLaw | None = None,
) -> Trajectory:
    """A flight of slews, sampled at 10 Hz."""
    torque, wheels = slews(satellite, rng, seconds), satellite.wheels
    speed = 0.1 * wheels.max_speed * rng.uniform(-1.0, 1.0, wheels.count)
    push = satellite.disturbance_std * rng.normal(size=3)
    attitude = rng.normal(size=4)
    return simulate(
        satellite,
        torque,
        0.1,
        wheel_speed0=speed,
        disturbance=push,
        attitude0=attitude,
        substeps=2,
        law=law,
    )


def clean_log(flown: Trajectory, satellite: Satellite, rng: np.random.Generator, delay: int = 0) -> Log:
    """White noise and a gyro bias at 10 Hz, no attitude; wheel speeds are stamped `delay` ticks of 0.1 s late."""
    speed = np.roll(flown.wheel_speed, delay, axis=0)
    keep = slice(delay, None)
    return Log(
        time=flown.time[keep],
        rate=_gyro(flown.omega, satellite, rng)[keep],
        wheel_speed=speed[keep] + satellite.tachometer_noise_std * rng.normal(size=speed.shape)[keep],
    )


def _gyro(omega: np.ndarray, satellite: Satellite, rng: np.random.Generator) -> np.ndarray:
    """Readings (N, 3) with a constant bias and white noise."""
    return omega + BIAS_STD * rng.normal(size=3) + satellite.gyro_noise_std * rng.normal(size=omega.shape)


def write_downlink(folder: Path, flown: Trajectory, satellite: Satellite, rng: np.random.Generator) -> None:
    """Four files as a ground station exports them.

    A row every 2 s, stamped in whole seconds, a twelfth of them lost in gaps of up to 16 s; deg/s and rpm with three
    digits and their units in the cells, quaternion scalar first; wheel speeds are taken 0.2 s before the gyro, give or
    take 0.1 s; in a row of fifty the rates are those of the row before.
    """
    folder.mkdir(parents=True)
    ticks = np.arange(20, len(flown.time) - 20, 20)
    lost = np.zeros(len(ticks), bool)
    for start in rng.choice(len(ticks), max(1, len(ticks) // 50), replace=False):
        lost[start : start + rng.integers(1, 8)] = True
    ticks = ticks[~lost]
    wheel_ticks = ticks - rng.integers(1, 4, len(ticks))
    rate = _gyro(flown.omega[ticks], satellite, rng)
    stale = np.flatnonzero(rng.random(len(ticks)) < 0.02)
    rate[stale[stale > 0]] = rate[stale[stale > 0] - 1]
    speed = flown.wheel_speed[wheel_ticks] + satellite.tachometer_noise_std * rng.normal(size=(len(ticks), 3))
    quaternion = np.roll(flown.attitude[ticks], 1, axis=1)
    second = np.floor(flown.time[ticks] + rng.uniform(0.0, 0.999)).astype(int)
    stamps = np.datetime_as_string(np.datetime64("2026-01-01T00:00:00") + second).tolist()
    for stem, head, values, unit in (
        ("Rates-data", '"X","Y","Z"', np.degrees(rate), " °/s"),
        ("RW Speeds-data", '"X","Y","Z"', speed * 30.0 / np.pi, " rpm"),
        ("RW CMDs-data", '"X","Y","Z"', np.zeros_like(speed), " RPM/s"),
        ("Attitude quaternion-data", '"q0","q1","q2","q3"', quaternion, ""),
    ):
        rows = [
            ",".join([stamp.replace("T", " "), *(f"{v:#.3g}{unit}" for v in row)])
            for stamp, row in zip(stamps, values, strict=True)
        ]
        text = "\n".join([f'"Time",{head}', *rows])
        (folder / f"{stem}.csv").write_text(text, encoding="utf-8-sig")
