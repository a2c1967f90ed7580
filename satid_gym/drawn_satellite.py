"""Satellites drawn at random: any size, principal axes, arrangement of wheels, authority and sensors.

A policy or filter that is to fly satellites nobody has thought of is trained and tried on these. What a data sheet says
in numbers that grow with the satellite is drawn relative to what it works on: torque to the angular momentum at the
rate limit, noise to the range of what is read.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np

from satid_gym.config import Config, check_integer, check_number, real_array
from satid_gym.reaction_wheels import ReactionWheels
from satid_gym.satellite import Satellite

Range = tuple[float, float]
_WHEELS_MIN, _WHEELS_MAX = 3, 8
_DRAWS_MAX = 1000
_STREAM = 5  # so that an episode of the same seed has other draws
_EVENNESS_MIN = 0.15  # of directions of wheels: the least over the mean of what A A^T does to a unit vector
_EVENNESS_LEFT_MIN = 0.02  # the same of the wheels that are left where any one of four or more is lost
_HALF_ANGLE = np.deg2rad((35.0, 60.0))  # of a pyramid's wheels from its axis


@dataclass(frozen=True, eq=False, kw_only=True)
class SatelliteRanges(Config):
    """Ranges (low, high) from which a satellite is drawn, log-uniform each but for the number of wheels.

    Attributes:
        wheels: least and largest number of wheels, each as likely; 3 to 8.
        inertia: geometric mean of the principal moments, kg m^2.
        edges: of the box whose moments these are, over its shortest edge.
        density: mean density of that box, kg/m^3.
        rate_limit: rad/s.
        authority: torque along the principal axis that has least of it, over moment times rate limit, 1/s: its inverse
            is the time from rest to the limit.
        momentum: of all wheels along the axis that has least of it, over moment times rate limit; 1 is just enough.
        wheel_speed: speed limit of the wheels, rad/s.
        gyro_noise: std of a sample over the rate limit.
        tachometer_noise: std of a sample over the wheels' speed limit.
        disturbance: std of the torque about each axis over a wheel's torque.
        gyroscopic: the most that rate limit times a wheel's momentum may be, over its torque; above 1 full wheels turn
            the body with more torque than they have, and no control holds its rates. Rate limit, authority and momentum
            are drawn together until it is less.

    Raises:
        ValueError: a range is not valid, or the number of wheels is not one that is drawn.
    """

    wheels: tuple[int, int] = (_WHEELS_MIN, _WHEELS_MAX)
    inertia: Range = (1e-3, 1e4)
    edges: Range = (1.0, 3.5)
    density: Range = (100.0, 1000.0)
    rate_limit: Range = (0.005, 0.2)
    authority: Range = (0.03, 2.0)
    momentum: Range = (2.0, 20.0)
    wheel_speed: Range = (400.0, 1500.0)
    gyro_noise: Range = (3e-4, 1e-2)
    tachometer_noise: Range = (3e-5, 1e-3)
    disturbance: Range = (2e-4, 2e-3)
    gyroscopic: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        low, high = (check_integer("wheels of drawn satellites", n) for n in self.wheels)
        if not _WHEELS_MIN <= low <= high <= _WHEELS_MAX:
            raise ValueError(
                f"wheels of drawn satellites must be (low, high) with {_WHEELS_MIN} <= low <= high <= {_WHEELS_MAX}, "
                f"got ({low}, {high})"
            )
        object.__setattr__(self, "wheels", (low, high))
        check_number("gyroscopic of drawn satellites", self.gyroscopic, strict=True)
        for field in fields(self)[1:-1]:
            low, high = real_array(f"{field.name} of drawn satellites", getattr(self, field.name), (2,)).tolist()
            if not 0.0 < low <= high:
                raise ValueError(
                    f"{field.name} of drawn satellites must be (low, high) with 0 < low <= high, got ({low}, {high})"
                )
            object.__setattr__(self, field.name, (low, high))


def draw_satellite(
    rng: np.random.Generator, ranges: SatelliteRanges | None = None, *, name: str = "drawn"
) -> Satellite:
    """Satellite drawn at random.

    Its inertia is that of a box of even density whose edges are drawn, turned in the body frame at random, as where
    mass is spread unevenly: a full tensor. The wheels, all of one kind, stand along the body axes (three of them), on a
    pyramid about one of these (four or more), or in random directions that reach every axis, also where one of four or
    more is lost.

    Args:
        rng: source of all draws.
        ranges: to draw from; None: the default ones.
        name: of the satellite.
    """
    r = ranges or SatelliteRanges()
    size = np.array([_log_uniform(rng, r.edges) for _ in range(3)])
    moments = size @ size - size**2  # of the box, but for a factor
    target, density = _log_uniform(rng, r.inertia), _log_uniform(rng, r.density)
    # J = m / 12 (b^2 + c^2) and m = density a b c: all edges grow by one factor, J by its fifth power
    mass_at_one = density * float(np.prod(size))
    growth = (target / (mass_at_one / 12.0 * np.prod(moments) ** (1.0 / 3.0))) ** 0.2
    size, mass = growth * size, growth**3 * mass_at_one
    moments = mass / 12.0 * growth**2 * moments
    principal = _rotation(rng)
    axes = _directions(rng, int(rng.integers(r.wheels[0], r.wheels[1] + 1)))
    rate_limit, authority, momentum = _limits(rng, r)
    reach = np.abs(principal.T @ axes).sum(axis=1)  # of wheels of unit torque, along each principal axis
    needed = np.max(moments * rate_limit / reach)  # N m s of each wheel to turn about any principal axis at the limit
    max_torque = needed * authority
    stored, max_speed = needed * momentum, _log_uniform(rng, r.wheel_speed)
    return Satellite(
        name,
        (principal * moments) @ principal.T,
        ReactionWheels(
            axes=axes,
            inertia=np.array(stored / max_speed),
            max_torque=np.array(max_torque),
            max_speed=np.array(max_speed),
        ),
        mass=mass,
        size=size,
        rate_limit=rate_limit,
        gyro_noise_std=rate_limit * _log_uniform(rng, r.gyro_noise),
        tachometer_noise_std=max_speed * _log_uniform(rng, r.tachometer_noise),
        disturbance_std=max_torque * _log_uniform(rng, r.disturbance),
    )


def draw_satellites(
    seeds: Iterable[int], ranges: SatelliteRanges | None = None, *, wheels: int | None = None
) -> tuple[Satellite, ...]:
    """One satellite a seed, each named after its own; `wheels` is the number of all of them, for one environment."""
    ranges = ranges or SatelliteRanges()
    if wheels is not None:
        ranges = ranges.replace(wheels=(wheels, wheels))
    return tuple(draw_satellite(np.random.default_rng([seed, _STREAM]), ranges, name=f"drawn_{seed}") for seed in seeds)


def _limits(rng: np.random.Generator, r: SatelliteRanges) -> tuple[float, float, float]:
    """Rate limit, authority and momentum, such that full wheels can be turned at the limit.

    Raises:
        ValueError: the ranges hold next to none.
    """
    for _ in range(_DRAWS_MAX):
        rate_limit, authority = _log_uniform(rng, r.rate_limit), _log_uniform(rng, r.authority)
        momentum = _log_uniform(rng, r.momentum)
        if rate_limit * momentum <= r.gyroscopic * authority:
            return rate_limit, authority, momentum
    raise ValueError(
        f"in {_DRAWS_MAX} draws, authority {r.authority} never gave enough torque for rate_limit {r.rate_limit} and "
        f"momentum {r.momentum}: lower these or raise authority"
    )


def _log_uniform(rng: np.random.Generator, bounds: Range) -> float:
    low, high = np.log(bounds)
    return float(np.exp(rng.uniform(low, high)))


def _rotation(rng: np.random.Generator) -> np.ndarray:
    """Rotation (3, 3) drawn evenly (Shoemake, Graphics Gems III, 1992): a unit quaternion in any direction."""
    x, y, z, w = (q := rng.standard_normal(4)) / np.linalg.norm(q)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2.0 * (w * cross + cross @ cross)


def _directions(rng: np.random.Generator, count: int) -> np.ndarray:
    """(3, count) spin axes in one of the arrangements."""
    if rng.uniform() < 0.5:
        return _scattered(rng, count)
    if count == 3:
        return np.eye(3)
    half, around = rng.uniform(*_HALF_ANGLE), 2.0 * np.pi * (np.arange(count) + 0.5) / count
    axes = np.array([np.sin(half) * np.cos(around), np.sin(half) * np.sin(around), np.full(count, np.cos(half))])
    return np.roll(axes, rng.integers(3), axis=0)


def _scattered(rng: np.random.Generator, count: int) -> np.ndarray:
    """(3, count) random directions that reach every axis."""
    for _ in range(_DRAWS_MAX):
        axes = rng.standard_normal((3, count))
        axes /= np.linalg.norm(axes, axis=0)
        left = [np.delete(axes, i, axis=1) for i in range(count)] if count > 3 else []
        if _evenness(axes) >= _EVENNESS_MIN and all(_evenness(a) >= _EVENNESS_LEFT_MIN for a in left):
            return axes
    raise RuntimeError(f"none of {_DRAWS_MAX} draws of {count} wheel axes was spread evenly enough")


def _evenness(axes: np.ndarray) -> float:
    """Least eigenvalue of A A^T over their mean; 1 of directions that are spread evenly."""
    moments = np.linalg.eigvalsh(axes @ axes.T)
    return float(moments[0] / moments.mean())
