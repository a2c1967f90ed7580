"""Prior of a filter: what is known of a satellite before launch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from satid_gym.config import Config, check_number
from satid_gym.estimators.inertia import PARAMETER_COUNT, PRODUCTS, Parameters, products_of_inertia
from satid_gym.satellite import ReactionWheels, inertia_tensor
from satid_gym.tolerances import Tolerances, tolerances_of

GYRO_STD_MIN = 1e-9  # a sensor said to be noiseless is believed this far


@dataclass(frozen=True, eq=False, kw_only=True)
class FilterPrior(Config):
    """Prior: all that a filter may know before launch, nothing of the true satellite.

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
        tolerances: of sensors and wheels.
        gyro_bias_walk: random walk of the gyro's bias, rad/s per sqrt(s).

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
    tolerances: Tolerances = field(default_factory=Tolerances)
    gyro_bias_walk: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.wheels, Mapping):
            object.__setattr__(self, "wheels", ReactionWheels.from_dict(self.wheels))
        if not isinstance(self.wheels, ReactionWheels):
            raise ValueError(f"wheels must be ReactionWheels or a mapping of its settings, got {self.wheels!r}")
        object.__setattr__(self, "inertia", inertia_tensor(self.inertia, "prior inertia"))
        check_number("gyro_noise_std", self.gyro_noise_std, strict=True)
        object.__setattr__(self, "tolerances", tolerances_of(self.tolerances))
        for name in (
            "prior_std",
            "product_std",
            "tachometer_noise_std",
            "disturbance_std",
            "disturbance_walk",
            "gyro_bias_walk",
        ):
            check_number(name, getattr(self, name))

    @property
    def gyro_is_noisy(self) -> bool:
        """Whether the gyro has noise of its own, by which a reading that repeats itself gives itself away."""
        return self.gyro_noise_std > GYRO_STD_MIN

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


def estimated_parameters(given: Parameters | None, prior: FilterPrior) -> Parameters:
    """What an estimator estimates whose setting `parameters` is `given`: None is what the prior needs."""
    return prior.needed_parameters if given is None else given
