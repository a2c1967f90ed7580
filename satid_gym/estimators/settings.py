"""What an estimator is told before launch, and how it is tuned."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy.special

from satid_gym.config import Config, check_number, check_whole, unknown_name
from satid_gym.satellite import ReactionWheels, Satellite, inertia_tensor
from satid_gym.scenario import Scenario

Parameters = Literal["principal", "full"]
PARAMETER_COUNT: dict[Parameters, int] = {"principal": 3, "full": 6}
PRODUCTS = ((0, 1), (0, 2), (1, 2))  # rows and columns of parameters 4 to 6
LEAST_PRODUCT = 3e-5  # of the geometric mean of two moments: below it a filter of three moments stays consistent

_MOST_SUBSTEPS = 1000
_LEAST_STD = 1e-9  # a sensor said to be noiseless is believed this far


def inertia_parameters(tensor: np.ndarray, parameters: Parameters) -> np.ndarray:
    """theta (p,) of inertia tensors (..., 3, 3): moments, and for "full" the products xy, xz, yz."""
    theta = [tensor[..., i, i] for i in range(3)]
    if parameters == "full":
        theta += [tensor[..., i, j] for i, j in PRODUCTS]
    return np.stack(theta, axis=-1)


def inertia_tensors(theta: np.ndarray) -> np.ndarray:
    """Tensors (..., 3, 3) of inertia parameters theta (..., p); the products that p = 3 leaves out are 0."""
    tensor = np.zeros((*theta.shape[:-1], 3, 3))
    for i in range(3):
        tensor[..., i, i] = theta[..., i]
    for k, (i, j) in enumerate(PRODUCTS[: theta.shape[-1] - 3]):
        tensor[..., i, j] = tensor[..., j, i] = theta[..., 3 + k]
    return tensor


def products_of_inertia(tensor: np.ndarray, moments: np.ndarray) -> str:
    """The products of inertia that a filter of three moments would miss, in words; "" where there are none.

    Args:
        tensor: (3, 3) kg m^2, body frame.
        moments: (3,) kg m^2 about the body axes, that products are compared with.
    """
    found = [(i, j) for i, j in PRODUCTS if abs(tensor[i, j]) > LEAST_PRODUCT * np.sqrt(moments[i] * moments[j])]
    names = ", ".join(f"J{'xyz'[i]}{'xyz'[j]} = {tensor[i, j]:.4g}" for i, j in found)
    return f"{names} kg m^2" if found else ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Briefing(Config):
    """All that a filter may know before launch. It holds nothing of the true satellite.

    Attributes:
        wheels: reaction wheels, as built.
        inertia: (3, 3) prior mean, kg m^2.
        prior_std: std of the prior on each moment, relative.
        product_std: std of the prior on each product, relative to the geometric mean of two moments.
        gyro_noise_std: rad/s per sample.
        tachometer_noise_std: rad/s per sample.
        disturbance_std: N m, of the unknown torque about each axis.
        disturbance_walk: N m per sqrt(s), how fast that torque may wander.
        parameters: what is to be estimated, "principal" or "full"; None: see `needed_parameters`.

    Raises:
        ValueError: a value is out of range, or the prior inertia is not that of a rigid body.
    """

    wheels: ReactionWheels
    inertia: np.ndarray
    prior_std: float
    product_std: float
    gyro_noise_std: float
    tachometer_noise_std: float
    disturbance_std: float
    disturbance_walk: float = 0.0
    parameters: Parameters | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.wheels, Mapping):
            object.__setattr__(self, "wheels", ReactionWheels.from_dict(self.wheels))
        if not isinstance(self.wheels, ReactionWheels):
            raise ValueError(f"wheels must be ReactionWheels or a mapping of its settings, got {self.wheels!r}")
        object.__setattr__(self, "inertia", inertia_tensor(self.inertia, "prior inertia"))
        check_number("gyro_noise_std", self.gyro_noise_std, strict=True)
        for name in ("prior_std", "product_std", "tachometer_noise_std", "disturbance_std", "disturbance_walk"):
            check_number(name, getattr(self, name))

    @property
    def gyro_is_noisy(self) -> bool:
        """Whether the gyro has noise of its own, by which a reading that repeats itself gives itself away."""
        return self.gyro_noise_std > _LEAST_STD

    @property
    def needed_parameters(self) -> Parameters:
        """What a filter estimates that was not told: as asked for, else "full" where the inertia has products."""
        if self.parameters is not None:
            return self.parameters
        return "full" if products_of_inertia(self.inertia, np.diag(self.inertia)) else "principal"

    def theta_scale(self, parameters: Parameters) -> np.ndarray:
        """(p,) moments, and geometric means of two of them for the products."""
        moments = np.diag(self.inertia)
        products = [np.sqrt(moments[i] * moments[j]) for i, j in PRODUCTS] if parameters == "full" else []
        return np.array([*moments, *products])

    def prior_theta_std(self, parameters: Parameters) -> np.ndarray:
        """(p,) std of the prior, kg m^2."""
        count = PARAMETER_COUNT[parameters] - 3
        return self.theta_scale(parameters) * np.array([self.prior_std] * 3 + [self.product_std] * count)


def estimated_parameters(given: Parameters | None, briefing: Briefing) -> Parameters:
    """What an estimator estimates whose setting `parameters` is `given`: None is what the briefing needs."""
    return briefing.needed_parameters if given is None else given


def brief(satellite: Satellite, scenario: Scenario, parameters: Parameters | None = None) -> Briefing:
    """What is known of a satellite in a scenario: nominal values and data sheets.

    Args:
        satellite: nominal.
        scenario: the world.
        parameters: what is to be estimated; None: what the satellite and the scenario's `tilt_std` need.
    """
    if parameters is None and scenario.tilt_std > 0.0:
        parameters = "full"
    scale = scenario.prior_scale.get(satellite.name, scenario.prior_scale.get("*", 1.0))
    operating = scenario.operate(satellite)
    return Briefing(
        wheels=operating.wheels,
        inertia=scale * operating.inertia,
        prior_std=scenario.prior_std,
        product_std=scenario.product_std,
        gyro_noise_std=max(operating.gyro_noise_std, _LEAST_STD),
        tachometer_noise_std=operating.tachometer_noise_std,
        disturbance_std=operating.disturbance_std,
        disturbance_walk=_disturbance_walk(operating, scenario),
        parameters=parameters,
    )


def _disturbance_walk(satellite: Satellite, scenario: Scenario) -> float:
    """Random walk that spreads as far as the known causes move the disturbance, N m per sqrt(s).

    The orbit-periodic torque has rms slope n std / sqrt(2), held over the horizon; the gravity gradient, of
    amplitude A = 3/2 n^2 (J_max - J_min), forgets itself within the time the body takes to turn by a radian at
    its rate limit omega: A sqrt(2 omega).
    """
    n = scenario.orbit_rate
    periodic = 0.5 * satellite.disturbance_std * n * np.sqrt(0.5 * scenario.horizon)
    moments = np.linalg.eigvalsh(satellite.inertia)
    gradient = 1.5 * n**2 * (moments[-1] - moments[0]) * np.sqrt(2.0 * satellite.rate_limit)
    return float(np.hypot(periodic, gradient if scenario.gravity_gradient else 0.0))


def disturbance_walk(settings: MomentumEKFSettings, briefing: Briefing) -> float:
    """The filter's random walk of the disturbance, N m per sqrt(s)."""
    if settings.disturbance_walk is None:
        return briefing.disturbance_walk
    return settings.disturbance_walk * briefing.disturbance_std


@dataclass(frozen=True, eq=False, kw_only=True)
class MomentumEKFSettings(Config):
    """Tuning of the MomentumEKF.

    Attributes:
        name: "momentum".
        parameters: "principal" for 3 moments along the body axes, "full" for all 6 of the tensor; None is "full" where
            a satellite, the inertia law or `tilt_std` has products of inertia about the body axes, else "principal".
        inertia_walk: random walk of each moment relative to its prior, per sqrt(s).
        disturbance_walk: random walk of the disturbance relative to its std, per sqrt(s); None takes the
            briefing's.
        substeps: midpoint steps between two readings.
        gate: probability at which a gyro reading of an honest filter is rejected as an outlier; with it sensors
            that repeat themselves are not believed, see `satid_gym.core.vetting`. 0: every reading is believed.
    """

    name: Literal["momentum"] = "momentum"
    parameters: Parameters | None = None
    inertia_walk: float = 0.004
    disturbance_walk: float | None = None
    substeps: int = 1
    gate: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_number("inertia_walk", self.inertia_walk)
        check_number("gate", self.gate, high=0.1)
        if self.disturbance_walk is not None:
            check_number("disturbance_walk", self.disturbance_walk)
        check_whole("substeps", self.substeps, high=_MOST_SUBSTEPS)


def gate_distance(settings: MomentumEKFSettings) -> float:
    """Normalised innovation squared of a gyro reading beyond which it is rejected; 0 where none is."""
    return float(scipy.special.chdtri(3, settings.gate)) if settings.gate > 0.0 else 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class RateEKFSettings(Config):
    """Tuning of the RateEKF; the defaults are the paper's.

    Attributes:
        name: "rate".
        parameters: as for the MomentumEKF.
        gyro_std: measurement noise it assumes, rad/s.
        wheel_speed_std: likewise of the wheel speeds, rad/s.
        rate_walk: process noise, rad/s per sqrt(s).
        inertia_walk: kg m^2 per sqrt(s).
        wheel_speed_walk: rad/s per sqrt(s).
        prior_rate_std: rad/s.
        prior_inertia_std: kg m^2.
        prior_wheel_speed_std: rad/s.
    """

    name: Literal["rate"] = "rate"
    parameters: Parameters | None = None
    gyro_std: float = 1e-3
    wheel_speed_std: float = 1.0
    rate_walk: float = 1e-3
    inertia_walk: float = 1e-5
    wheel_speed_walk: float = 1e-3
    prior_rate_std: float = 1e-2
    prior_inertia_std: float = 1.0
    prior_wheel_speed_std: float = 0.1

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("gyro_std", "wheel_speed_std", "prior_rate_std", "prior_inertia_std", "prior_wheel_speed_std"):
            check_number(name, getattr(self, name), strict=True)
        for name in ("rate_walk", "inertia_walk", "wheel_speed_walk"):
            check_number(name, getattr(self, name))


@dataclass(frozen=True, eq=False, kw_only=True)
class AdaptiveEKFSettings(Config):
    """Tuning of the AdaptiveEKF: the MomentumEKF that finds out how fast the inertia walks.

    Attributes:
        name: "adaptive".
        parameters: as for the MomentumEKF.
        inertia_walk: random walk of each moment relative to its prior, per sqrt(s), that it begins with.
        least_walk: the slowest that matters, per sqrt(s): below it the variance is estimated instead of its logarithm,
            which may be 0.
        most_walk: the fastest that is believed, per sqrt(s): an inertia that varies faster is followed too slowly, and
            the covariance is then too small.
        walk_drift: variance by which the logarithm of the walk's variance may wander a second.
        disturbance_walk: as for the MomentumEKF.
        substeps: midpoint steps between two readings.
    """

    name: Literal["adaptive"] = "adaptive"
    parameters: Parameters | None = None
    inertia_walk: float = 0.0015
    least_walk: float = 0.0001
    most_walk: float = 0.02
    walk_drift: float = 0.05
    disturbance_walk: float | None = None
    substeps: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        self.momentum()
        check_number("most_walk", self.most_walk, strict=True)
        check_number("least_walk", self.least_walk, strict=True)
        for name in ("inertia_walk", "least_walk"):
            if getattr(self, name) > self.most_walk:
                raise ValueError(
                    f"{name} of the AdaptiveEKF must be at most most_walk, {self.most_walk:g}, got "
                    f"{getattr(self, name):g}: raise most_walk as well for an inertia that walks faster"
                )
        check_number("walk_drift", self.walk_drift)

    def momentum(self) -> MomentumEKFSettings:
        """The MomentumEKF that it begins as."""
        return MomentumEKFSettings(
            parameters=self.parameters,
            inertia_walk=self.inertia_walk,
            disturbance_walk=self.disturbance_walk,
            substeps=self.substeps,
        )


EstimatorSettings = MomentumEKFSettings | AdaptiveEKFSettings | RateEKFSettings
ESTIMATORS: dict[str, type[MomentumEKFSettings] | type[AdaptiveEKFSettings] | type[RateEKFSettings]] = {
    "momentum": MomentumEKFSettings,
    "adaptive": AdaptiveEKFSettings,
    "rate": RateEKFSettings,
}


def estimator_settings(value: str | Mapping[str, Any] | EstimatorSettings) -> EstimatorSettings:
    """Settings from a name, a mapping with a "name", or themselves.

    Raises:
        ValueError: the name or a setting is unknown.
    """
    if isinstance(value, EstimatorSettings):
        return value
    if isinstance(value, str):
        value = {"name": value}
    if not isinstance(value, Mapping):
        raise ValueError(
            f"estimator must be a name, a mapping or its settings, or in the single environment an object that "
            f"follows Estimator, got {value!r}"
        )
    name = value.get("name")
    if not isinstance(name, str) or name not in ESTIMATORS:
        raise unknown_name("estimator", name, ESTIMATORS)
    return ESTIMATORS[name].from_dict(value)
