"""Scenarios: the world of an episode, the scatter of the truth about nominal, and the prior that follows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from satid_gym.appendages import Appendages, appendages_of
from satid_gym.config import Config, check_number
from satid_gym.estimators.inertia import Parameters
from satid_gym.estimators.prior import GYRO_STD_MIN, FilterPrior
from satid_gym.estimators.registry import estimator_settings
from satid_gym.estimators.settings import EstimatorSettings
from satid_gym.expectation import agitation, disturbance_walk, nutation
from satid_gym.faults import Faults
from satid_gym.friction import WheelFriction
from satid_gym.law_ranges import LawRanges
from satid_gym.operations import Operations
from satid_gym.satellite import Satellite
from satid_gym.sensors import Sensors
from satid_gym.tolerances import Tolerances
from satid_gym.wheel_pyramid import WheelPyramid

_SAMPLES_MAX = 100_000  # a decision
_DECISIONS_MAX = 1_000_000_000  # an episode
_DELAY_MAX = 1000  # of a command, in samples
_STEP_MAX = 0.5  # of the rate error that the rate loop takes away in a sample
_PHASE_MAX = 0.2  # rad, that a late command may cost the rate loop
_PARTS: dict[str, type[Config]] = {"wheels": WheelPyramid, "friction": WheelFriction, "operations": Operations}
_SHEETS: dict[str, type[Config]] = {"tolerances": Tolerances, "sensors": Sensors}  # in place of a satellite's own


@dataclass(frozen=True, eq=False, kw_only=True)
class Scenario(Config):
    """Settings of the world; `None` means the satellite's own value.

    Attributes:
        name: name in tables.
        decision_period: s between two actions.
        sample_period: s between two readings and filter steps; it divides the decision period.
        horizon: s, an integer multiple of decision_period.
        inertia_std: std of the logarithm of the true moments about nominal, by axis.
        tilt_std: std of the rotation of the true principal axes about each body axis, rad.
        prior_std: std of the filter's prior on each moment, relative to its mean.
        product_std: std of its prior on the products of inertia, relative to the geometric mean of moments.
        prior_scale: mean of that prior over nominal, by satellite name; "*" names all others.
        laws: ranges of the inertia laws.
        wheel_speed_range: first wheel speeds are uniform within this fraction of the limit.
        wheel_speed_scale: factor on the wheels' speed limit (a tenth of it: a tenth of the momentum).
        initial_rate_std: std of the first body rates over the rate limit.
        torque_noise: std of the motor torque noise over the torque limit, drawn again each sample.
        torque_lag: time constant of the motors, s.
        friction: friction of the wheels, or a mapping with its settings.
        gyro_noise_std: rad/s per sample.
        gyro_bias_walk: rad/s per sqrt(s).
        tachometer_noise_std: rad/s per sample.
        disturbance_scale: factor on the satellite's disturbance torque.
        gravity_gradient: whether it acts.
        solar_pressure: N, force of the sunlight, fixed in inertial space; it acts 1 cm from the centre of mass.
        orbit_rate: rad/s.
        random_attitude: whether the first attitude is random (else body and inertial frame coincide).
        rate_limit: rad/s.
        rate_bandwidth: rad/s, of the rate loop under control="rate"; see `tracking_bandwidth`.
        reference_slope: slope limit of that loop's reference, as a share of the acceleration that the weakest motor
            gives the largest moment; 0: no limit.
        termination_factor: the episode ends when a body rate exceeds this many rate limits.
        deflection_factor: the episode ends when a deflection exceeds its limit by this factor.
        appendages: panels or a tank that its satellites get, drawn from ranges, or a mapping with their settings.
        wheels: four wheels that its satellites get in place of their own, or a mapping with their settings.
        estimator: the scenario's default filter, by name, or a mapping with its settings.
        faults: what can go wrong with sensors and wheels.
        tolerances: how far gyro and wheels may be off nominal, or a mapping with their settings.
        sensors: averaging, counting and delays of readings, and a star tracker, or a mapping with their settings.
        operations: imaging windows and a keep-out of a payload, or a mapping with their settings.

    Raises:
        ValueError: a value is out of range, or the periods do not divide.
    """

    name: str = "default"
    decision_period: float = 1.0
    sample_period: float = 0.1
    horizon: float = 300.0
    inertia_std: float = 0.15
    tilt_std: float = 0.0
    prior_std: float = 0.3
    product_std: float = 0.05
    prior_scale: Mapping[str, float] = field(default_factory=dict)
    laws: LawRanges = field(default_factory=LawRanges)
    wheel_speed_range: float = 0.2
    wheel_speed_scale: float = 1.0
    initial_rate_std: float = 0.02
    torque_noise: float = 0.05
    torque_lag: float = 0.0
    friction: WheelFriction | None = None
    gyro_noise_std: float | None = None
    gyro_bias_walk: float = 1e-7
    tachometer_noise_std: float | None = None
    disturbance_scale: float = 1.0
    gravity_gradient: bool = True
    solar_pressure: float = 1e-6
    orbit_rate: float = 1e-3
    random_attitude: bool = True
    rate_limit: float | None = None
    rate_bandwidth: float = 1.0
    reference_slope: float = 0.0
    termination_factor: float = 3.0
    deflection_factor: float = 4.0
    appendages: Appendages | None = None
    wheels: WheelPyramid | None = None
    estimator: EstimatorSettings = field(default_factory=lambda: estimator_settings("adaptive"))
    faults: Faults = field(default_factory=Faults)
    tolerances: Tolerances | None = None
    sensors: Sensors | None = None
    operations: Operations | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("decision_period", "sample_period", "horizon", "prior_std", "product_std", "wheel_speed_scale"):
            check_number(name, getattr(self, name), strict=True)
        for name in ("inertia_std", "tilt_std", "initial_rate_std", "torque_noise", "torque_lag", "gyro_bias_walk"):
            check_number(name, getattr(self, name))
        for name in ("disturbance_scale", "solar_pressure", "orbit_rate", "reference_slope"):
            check_number(name, getattr(self, name))
        check_number("rate_bandwidth", self.rate_bandwidth, strict=True)
        check_number("wheel_speed_range", self.wheel_speed_range, high=1.0)
        for name in ("termination_factor", "deflection_factor"):
            check_number(name, getattr(self, name), low=1.0)
        if self.appendages is not None:
            object.__setattr__(self, "appendages", appendages_of(self.appendages))
        for name, kind in (_PARTS | _SHEETS).items():
            if getattr(self, name) is not None:
                self._settle(name, kind)
        for name, strict in (("gyro_noise_std", False), ("tachometer_noise_std", False), ("rate_limit", True)):
            if getattr(self, name) is not None:
                check_number(name, getattr(self, name), strict=strict)
        object.__setattr__(self, "estimator", estimator_settings(self.estimator))
        object.__setattr__(self, "prior_scale", _prior_scale(self.prior_scale))
        self._settle("laws", LawRanges)
        self._settle("faults", Faults)
        _whole("decision_period / sample_period", self.decision_period / self.sample_period, _SAMPLES_MAX)
        _whole("horizon / decision_period", self.horizon / self.decision_period, _DECISIONS_MAX)
        longest = min(self.samples, _DELAY_MAX)
        if self.faults.torque_delay[1] > longest:
            raise ValueError(
                f"torque_delay must be at most a decision and {_DELAY_MAX} samples, here {longest}, "
                f"got {self.faults.torque_delay}"
            )

    @property
    def samples(self) -> int:
        """Filter steps a decision."""
        return round(self.decision_period / self.sample_period)

    @property
    def command_lateness(self) -> float:
        """s, the most by which the motors follow their commands late: the longest delay and the motors' lag."""
        return self.faults.torque_delay[1] * self.sample_period + self.torque_lag

    @property
    def tracking_bandwidth(self) -> float:
        """rad/s, of the rate loop: `rate_bandwidth`, or what sampling and late commands allow.

        At most half of the error goes in a sample, and 0.2 rad of phase is lost to a command that comes late.
        """
        allowed = _STEP_MAX / self.sample_period
        if self.command_lateness > 0.0:
            allowed = min(allowed, _PHASE_MAX / self.command_lateness)
        return min(self.rate_bandwidth, allowed)

    @property
    def tracking_noise(self) -> float:
        """s, std of the momentum that motor noise leaves in the rate loop, over a motor's torque limit."""
        kept = 1.0 - self.tracking_bandwidth * self.sample_period
        return self.torque_noise * self.sample_period / (1.0 - kept**2) ** 0.5

    @property
    def decisions(self) -> int:
        """Decisions an episode."""
        return round(self.horizon / self.decision_period)

    def equip(self, satellites: Sequence[Satellite]) -> tuple[Satellite, ...]:
        """The satellites with the scenario's wheels and appendages, once for each data sheet of these.

        Raises:
            ValueError: one cannot carry them.
        """
        own = [s if self.wheels is None else self.wheels.equip(s, self.rate_limit) for s in satellites]
        if self.appendages is None:
            return tuple(own)
        return tuple(equipped for satellite in own for equipped in self.appendages.equip(satellite))

    def operate(self, satellite: Satellite) -> Satellite:
        """The satellite as operated in this scenario: with the scenario's limits and sensors where it sets them."""
        wheels = satellite.wheels
        friction = wheels.friction if self.friction is None else self.friction
        changes: dict[str, Any] = {
            "wheels": wheels.replace(max_speed=wheels.max_speed * self.wheel_speed_scale, friction=friction),
            "disturbance_std": satellite.disturbance_std * self.disturbance_scale,
        }
        for name in ("rate_limit", "gyro_noise_std", "tachometer_noise_std", *_SHEETS):
            if getattr(self, name) is not None:
                changes[name] = getattr(self, name)
        return satellite.replace(**changes)


def _prior_scale(scales: object) -> dict[str, float]:
    if not isinstance(scales, Mapping) or not all(isinstance(name, str) for name in scales):
        raise ValueError(f'prior_scale must map names of satellites, or "*", to numbers, got {scales!r}')
    return {name: check_number(f"prior_scale of {name}", scale, strict=True) for name, scale in scales.items()}


def _whole(name: str, ratio: float, most: int) -> None:
    if ratio > most:
        raise ValueError(f"{name} must be at most {most}, got {ratio:g}")
    if abs(ratio - round(ratio)) > 1e-9 * ratio or round(ratio) < 1:
        raise ValueError(f"{name} must be an integer, got {ratio:g}")


def prior_of(satellite: Satellite, scenario: Scenario, parameters: Parameters | None = None) -> FilterPrior:
    """Prior knowledge of a satellite in a scenario: nominal values and data sheets.

    Args:
        satellite: nominal.
        scenario: the world.
        parameters: what is to be estimated; None: what the satellite and the scenario's `tilt_std` need.
    """
    scale = scenario.prior_scale.get(satellite.name, scenario.prior_scale.get("*", 1.0))
    operating = scenario.operate(satellite)
    return FilterPrior(
        wheels=operating.wheels,
        inertia=scale * operating.inertia,
        prior_std=scenario.prior_std,
        product_std=scenario.product_std,
        gyro_noise_std=max(operating.gyro_noise_std, GYRO_STD_MIN),
        tachometer_noise_std=operating.tachometer_noise_std,
        disturbance_std=operating.disturbance_std,
        disturbance_walk=disturbance_walk(operating, scenario),
        parameters="full" if parameters is None and scenario.tilt_std > 0.0 else parameters,
        tolerances=operating.tolerances,
        gyro_bias_walk=scenario.gyro_bias_walk,
        modes=operating.modes,
        agitation=agitation(operating, scenario),
        nutation=nutation(operating, scenario),
        sensors=operating.sensors,
        sample_period=scenario.sample_period,
    )
