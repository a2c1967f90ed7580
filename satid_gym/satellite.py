"""Satellites: inertia, reaction wheels, sensors and operating envelope."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from satid_gym.config import Config, check_number, real_array
from satid_gym.modes import Mode, mode_of
from satid_gym.oscillators import Oscillator, oscillators_of
from satid_gym.reaction_wheels import ReactionWheels
from satid_gym.rigid_body import check_left, inertia_tensor
from satid_gym.sensors import Sensors
from satid_gym.tolerances import Tolerances


@dataclass(frozen=True, eq=False)
class Satellite(Config):
    """Satellite with its nominal values, around which the true ones are drawn.

    Attributes:
        name: its name in tables.
        inertia: nominal inertia about the centre of mass, wheels locked, kg m^2, body frame; (3,) principal
            moments or (3, 3) tensor, kept as (3, 3).
        wheels: reaction wheels, or a mapping with their settings.
        mass: kg; with it oscillators move the centre of mass, which is fixed if None; a scenario's tank is a share of
            it.
        size: (3,) m, for display, and to place a scenario's panels and tank by.
        rate_limit: largest body rate about any axis in operation, rad/s.
        gyro_noise_std: white noise of a gyro sample, rad/s.
        tachometer_noise_std: white noise of a wheel speed sample, rad/s.
        disturbance_std: standard deviation of the unknown disturbance torque about each axis, N m.
        tolerances: how far gyro and wheels may be off nominal, or a mapping with their settings.
        oscillators: hinged panels and slosh masses, `Panel` and `SloshMass`, or mappings with their settings; the
            inertia includes them at rest.
        sensors: averaging, counting and delays of readings, and a star tracker, or a mapping with their settings.

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
    oscillators: tuple[Oscillator, ...] = field(default=(), kw_only=True)
    sensors: Sensors = field(default_factory=Sensors, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.name:
            raise ValueError(f"satellite name must be a non-empty string, got {self.name!r}")
        object.__setattr__(self, "inertia", inertia_tensor(self.inertia, f"inertia of {self.name}"))
        self._settle("wheels", ReactionWheels)
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
        self._settle("tolerances", Tolerances)
        self._settle("sensors", Sensors)
        self.sensors.check(self.tolerances)
        if self.sensors.gyro_range is not None and self.sensors.gyro_range <= self.rate_limit:
            raise ValueError(
                f"gyro_range of {self.name} must be more than its rate_limit, {self.rate_limit:g} rad/s, "
                f"got {self.sensors.gyro_range:g}"
            )
        object.__setattr__(self, "oscillators", oscillators_of(self.oscillators))
        self._check_oscillators()

    @property
    def modes(self) -> tuple[Mode, ...]:
        """Modes that a filter expects, one for each of the oscillators, a mirrored pair being one."""
        return tuple(mode_of(o, self.mass) for o in self.oscillators)

    def _check_oscillators(self) -> None:
        """Refuse oscillators that are heavier than the satellite, or have more inertia than it leaves them."""
        moving = sum(o.count * o.mass for o in self.oscillators)
        if self.mass is not None and moving >= self.mass:
            raise ValueError(f"oscillators of {self.name} must be lighter than it, {self.mass:g} kg; got {moving:g} kg")
        if self.oscillators:
            at_rest = np.sum([o.inertia_at_rest for o in self.oscillators], axis=0)
            check_left(self.name, self.inertia - at_rest, self.wheels.rotor_inertia)


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


_INNOCUBE_ROTOR = 5.7e-5  # kg m^2
_INNOCUBE = Satellite(
    "innocube",
    _INNOCUBE_ROTOR * np.array([[774.6, -4.9, -3.7], [-4.9, 786.7, 4.9], [-3.7, 4.9, 174.2]]),
    ReactionWheels(
        axes=-np.eye(3), inertia=np.array(_INNOCUBE_ROTOR), max_torque=np.array(2e-3), max_speed=np.array(525.0)
    ),
    mass=4.2,
    size=np.array([0.1, 0.1, 0.34]),
    rate_limit=0.2,
    gyro_noise_std=1e-4,
    tachometer_noise_std=0.1,
    disturbance_std=1e-6,
)
"""InnoCube, a CubeSat of three units in orbit; its wheels' axes are signed as its telemetry is.

Mass, wheel torque, wheel momentum (30 mN m s), and rates up to 0.19 rad/s: Djebko et al., arXiv 2512.19576, and their
data. Inertia over rotor inertia: what `satid identify` finds in those, docs/identify.md. Assumed: a speed limit of
5000 rpm, which gives the rotors' inertia and so the scale of the tensor; noise of gyro and tachometers, the
disturbance, and that sensors and wheels are as nominal.
"""

SATELLITES: dict[str, Satellite] = {
    satellite.name: satellite
    for satellite in (
        _paper("cubesat", 24.0, (0.2, 0.2, 0.3), (0.26, 0.26, 0.16), (0.01, 460.0, 1e-4), 0.05, 1e-4, 1e-5),
        _paper("microsat", 95.0, (0.5, 0.6, 0.8), (6.53, 5.96, 4.53), (0.1, 900.0, 2e-3), 0.03, 5e-5, 5e-5),
        _paper("smallsat", 118.0, (0.7, 0.8, 1.0), (10.6, 14.2, 15.3), (0.1, 1500.0, 3e-3), 0.02, 2e-5, 1e-4),
        _INNOCUBE,
    )
}
BENCHMARK_SATELLITES = ("cubesat", "microsat", "smallsat")
"""Names of the satellites of the benchmark, of satellite "random" and of training: the paper's three.

Not the whole catalogue, so that a satellite added to `SATELLITES` changes no draw and no cell.
"""
