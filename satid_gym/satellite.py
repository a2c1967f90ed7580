"""Satellites: inertia, reaction wheels, sensors and operating envelope."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from satid_gym.config import Config, check_number, real_array
from satid_gym.tolerances import Tolerances, tolerances_of

_LENGTH_TOLERANCE = 1e-6  # of a wheel axis, whose length must be 1
_MOMENT_RANGE = (1e-9, 1e12)  # kg m^2: a chip satellite of 1 g has 1e-7, the International Space Station 2e8
_TRIANGLE = 1e-9  # relative slack of the triangle inequalities: flat plates meet them with equality


def second_moment(inertia: np.ndarray) -> np.ndarray:
    """Second moment of the mass S = sum m r r^T (3, 3), kg m^2, of an inertia tensor J (3, 3): S = tr(J)/2 1 - J.

    J is that of a rigid body if and only if S is positive semidefinite. Each eigenvalue of S is half the sum of two
    principal moments of J minus the third, so it is negative where a triangle inequality is broken; one eigenvalue of
    a flat plate is 0.
    Source: Wensing, Kim, Slotine, IEEE RA-L 3(1), 2018.
    """
    return 0.5 * np.trace(inertia) * np.eye(3) - inertia


def least_second_moment(inertia: np.ndarray) -> float:
    """Smallest eigenvalue of the second moment of an inertia tensor (3, 3), kg m^2; negative if not a rigid body's."""
    return float(np.linalg.eigvalsh(second_moment(inertia))[0])


def inertia_tensor(inertia: object, name: str = "inertia") -> np.ndarray:
    """Inertia tensor of a rigid body, kg m^2, body frame.

    Args:
        inertia: (3,) principal moments along the body axes, or (3, 3) symmetric tensor.
        name: its name in error messages.

    Returns:
        (3, 3) read-only array.

    Raises:
        ValueError: not symmetric, not positive definite, its principal moments are beyond those of any
            spacecraft (1e-9 to 1e12 kg m^2), or they break a triangle inequality, which every rigid body meets.
    """
    array = real_array(name, inertia, (3,), (3, 3))
    tensor = np.diag(array) if array.ndim == 1 else array
    if np.abs(tensor).max() > _MOMENT_RANGE[1]:  # before the others, because products of such moments overflow
        raise _out_of_range(name, np.abs(tensor).max())
    if not np.allclose(tensor, tensor.T, rtol=0.0, atol=1e-9 * np.abs(tensor).max()):
        raise ValueError(f"{name} must be symmetric, got {tensor.tolist()}")
    moments = np.linalg.eigvalsh(tensor)
    if moments[0] <= 0.0:
        raise ValueError(f"{name} must be positive definite; its principal moments are {moments.tolist()}")
    if moments[0] < _MOMENT_RANGE[0]:
        raise _out_of_range(name, moments[0])
    if least_second_moment(tensor) < -0.5 * _TRIANGLE * moments[2]:
        raise ValueError(
            f"{name} breaks the triangle inequality of principal moments: "
            f"{moments[0]:.6g} + {moments[1]:.6g} < {moments[2]:.6g}, so no rigid body can have it"
        )
    tensor = 0.5 * (tensor + tensor.T)
    tensor.flags.writeable = False
    return tensor


def _out_of_range(name: str, moment: float) -> ValueError:
    low, high = _MOMENT_RANGE
    return ValueError(
        f"{name} is beyond any spacecraft's: its moments must be within {low:g} and {high:g} kg m^2, got {moment:g}; "
        "is it in kg m^2?"
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class ReactionWheels(Config):
    """Set of n >= 3 reaction wheels.

    Attributes:
        axes: (3, n) spin axes, unit columns, body frame; they must span space.
        inertia: spin inertia of a wheel, kg m^2, one number or (n,).
        max_torque: motor torque limit, N m, one number or (n,).
        max_speed: speed limit relative to the body, rad/s, one number or (n,).

    Raises:
        ValueError: a shape, a sign or an axis is wrong.
    """

    axes: np.ndarray = field(default_factory=lambda: np.eye(3))
    inertia: np.ndarray
    max_torque: np.ndarray
    max_speed: np.ndarray

    def __post_init__(self) -> None:
        super().__post_init__()
        axes = real_array("wheel axes", self.axes)
        if axes.ndim != 2 or axes.shape[0] != 3 or axes.shape[1] < 3:
            raise ValueError(f"wheel axes must have shape (3, n) with n >= 3, got {axes.shape}")
        length = np.linalg.norm(axes, axis=0)
        if np.abs(length - 1.0).max() > _LENGTH_TOLERANCE:
            raise ValueError(f"wheel axes must be unit columns; their lengths are {length.tolist()}: divide by them")
        if np.linalg.matrix_rank(axes, tol=1e-6) < 3:
            raise ValueError("wheel axes must span space; these lie in a plane")
        axes = axes / length
        axes.flags.writeable = False
        object.__setattr__(self, "axes", axes)
        n = axes.shape[1]
        for name in ("inertia", "max_torque", "max_speed"):
            value = real_array(f"wheel {name}", getattr(self, name), (), (n,))
            if np.any(value <= 0.0):
                raise ValueError(f"wheel {name} must be positive, got {value.tolist()}")
            value = np.broadcast_to(value, n)
            object.__setattr__(self, name, value)

    @property
    def count(self) -> int:
        """Number of wheels n."""
        return int(self.axes.shape[1])

    @property
    def rotor_inertia(self) -> np.ndarray:
        """Inertia of the rotors about their spin axes, A j A^T (3, 3), kg m^2, which the free body lacks."""
        return (self.axes * self.inertia) @ self.axes.T


@dataclass(frozen=True, eq=False)
class Satellite(Config):
    """Satellite with its nominal values, about which the true ones are drawn.

    Attributes:
        name: its name in tables.
        inertia: nominal inertia about the centre of mass, wheels locked, kg m^2, body frame; (3,) principal
            moments or (3, 3) tensor, kept as (3, 3).
        wheels: reaction wheels, or a mapping with their settings.
        mass: kg, for display only.
        size: (3,) m, for display only.
        rate_limit: largest body rate about any axis in operation, rad/s.
        gyro_noise_std: white noise of a gyro sample, rad/s.
        tachometer_noise_std: white noise of a wheel speed sample, rad/s.
        disturbance_std: standard deviation of the unknown disturbance torque about each axis, N m.
        tolerances: how far gyro and wheels may be off nominal, or a mapping with their settings.

    Raises:
        ValueError: a value is not physically possible; the message says which and why.
    """

    name: str
    inertia: np.ndarray
    wheels: ReactionWheels
    mass: float | None = field(default=None, kw_only=True)
    size: np.ndarray | None = field(default=None, kw_only=True)
    rate_limit: float = field(default=0.03, kw_only=True)
    gyro_noise_std: float = field(default=5e-5, kw_only=True)
    tachometer_noise_std: float = field(default=0.05, kw_only=True)
    disturbance_std: float = field(default=5e-5, kw_only=True)
    tolerances: Tolerances = field(default_factory=Tolerances, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.name:
            raise ValueError(f"satellite name must be a non-empty string, got {self.name!r}")
        object.__setattr__(self, "inertia", inertia_tensor(self.inertia, f"inertia of {self.name}"))
        if isinstance(self.wheels, Mapping):
            object.__setattr__(self, "wheels", ReactionWheels.from_dict(self.wheels))
        if not isinstance(self.wheels, ReactionWheels):
            raise ValueError(f"wheels must be ReactionWheels or a mapping of its settings, got {self.wheels!r}")
        rest = np.linalg.eigvalsh(self.inertia - self.wheels.rotor_inertia)
        if rest[0] <= 0.0:
            raise ValueError(
                f"inertia of {self.name} must exceed its rotors' inertia, A j A^T; "
                f"the principal moments of the difference are {rest.tolist()}"
            )
        if self.mass is not None:
            check_number("mass", self.mass, strict=True)
        if self.size is not None:
            size = real_array("size", self.size, (3,))
            if np.any(size <= 0.0):
                raise ValueError(f"size must be positive, got {size.tolist()}")
            object.__setattr__(self, "size", size)
        check_number("rate_limit", self.rate_limit, strict=True)
        check_number("gyro_noise_std", self.gyro_noise_std)
        check_number("tachometer_noise_std", self.tachometer_noise_std)
        check_number("disturbance_std", self.disturbance_std)
        object.__setattr__(self, "tolerances", tolerances_of(self.tolerances))


def _paper(
    name: str,
    mass: float,
    size: tuple[float, float, float],
    inertia: tuple[float, float, float],
    wheels: tuple[float, float, float],
    rate_limit: float,
    gyro_noise_std: float,
    disturbance_std: float,
) -> Satellite:
    """Satellite of the paper's Table II, with the default scenario's envelope and sensors."""
    max_torque, max_speed, wheel_inertia = wheels
    return Satellite(
        name,
        np.array(inertia),
        ReactionWheels(inertia=np.array(wheel_inertia), max_torque=np.array(max_torque), max_speed=np.array(max_speed)),
        mass=mass,
        size=np.array(size),
        rate_limit=rate_limit,
        gyro_noise_std=gyro_noise_std,
        disturbance_std=disturbance_std,
    )


SATELLITES: dict[str, Satellite] = {
    satellite.name: satellite
    for satellite in (
        _paper("cubesat", 24.0, (0.2, 0.2, 0.3), (0.26, 0.26, 0.16), (0.01, 460.0, 1e-4), 0.05, 1e-4, 1e-5),
        _paper("microsat", 95.0, (0.5, 0.6, 0.8), (6.53, 5.96, 4.53), (0.1, 900.0, 2e-3), 0.03, 5e-5, 5e-5),
        _paper("smallsat", 118.0, (0.7, 0.8, 1.0), (10.6, 14.2, 15.3), (0.1, 1500.0, 3e-3), 0.02, 2e-5, 1e-4),
    )
}
BENCHMARK_SATELLITES = ("cubesat", "microsat", "smallsat")
"""Names of the satellites of the benchmark, of satellite "random" and of training: the paper's three.

Not the whole catalogue, so that a satellite added to `SATELLITES` changes no draw and no cell.
"""
