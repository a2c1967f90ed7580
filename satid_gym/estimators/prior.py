"""Prior of a filter: what is known of a satellite before launch."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from satid_gym.config import Config, check_number
from satid_gym.estimators.inertia import PARAMETER_COUNT, PRODUCTS, Parameters, products_of_inertia
from satid_gym.modes import Mode, modes_of
from satid_gym.reaction_wheels import ReactionWheels
from satid_gym.rigid_body import inertia_tensor
from satid_gym.sensors import Sensors
from satid_gym.tolerances import Tolerances

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
        modes: of panels and slosh masses.
        agitation: rad/s, std by which the motors' noise changes the rate between two readings, about the axis that it
            moves least; None: not known.
        nutation: rad, by which body and momentum may turn against each other between two readings, |M| dt / J.
        sensors: what readings stand for and how late they are.
        sample_period: s between two readings, by which encoders and gyros with a quantum divide what they count.

    Raises:
        ValueError: a value is out of range, the prior inertia is not that of a rigid body, or sensors that count have
            no sample period.
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
    modes: tuple[Mode, ...] = ()
    agitation: float | None = None
    nutation: float = 0.0
    sensors: Sensors = field(default_factory=Sensors)
    sample_period: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self._settle("wheels", ReactionWheels)
        object.__setattr__(self, "inertia", inertia_tensor(self.inertia, "prior inertia"))
        check_number("gyro_noise_std", self.gyro_noise_std, strict=True)
        self._settle("tolerances", Tolerances)
        object.__setattr__(self, "modes", modes_of(self.modes))
        self._settle("sensors", Sensors)
        self.sensors.check(self.tolerances)
        if self.sample_period is not None:
            check_number("sample_period", self.sample_period, strict=True)
        elif self.sensors.counts or self.sensors.gyro_quantum > 0.0:
            raise ValueError("sensors that count need the prior's sample_period, s, by which the counts are divided")
        for name in (
            "prior_std",
            "product_std",
            "tachometer_noise_std",
            "disturbance_std",
            "disturbance_walk",
            "gyro_bias_walk",
            "nutation",
        ):
            check_number(name, getattr(self, name))
        if self.agitation is not None:
            check_number("agitation", self.agitation)

    @property
    def gyro_is_noisy(self) -> bool:
        """Whether the gyro has noise of its own, by which a reading that repeats itself gives itself away."""
        return self.gyro_noise_std > GYRO_STD_MIN

    @property
    def reading_std(self) -> float:
        """Noise of a gyro's reading, rad/s, with that of whole quanta; see `counting_std`."""
        if self.sensors.gyro_quantum == 0.0:
            return self.gyro_noise_std
        assert self.sample_period is not None
        count = np.sqrt(2.0) * counting_std(self.sensors.gyro_quantum) / self.sample_period
        return float(np.hypot(self.gyro_noise_std, count))

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


def counting_std(quantum: float) -> float:
    """Standard deviation of an angle that is known to whole quanta: uniform within one, quantum / sqrt(12).

    A rate is the difference of two such angles over the sample period, and the angle in their middle stands in both its
    neighbours with opposite sign: its variance is quantum^2 / (6 dt^2), its spectrum is 0 at frequency 0.
    Source: Bennett, Spectra of quantized signals, Bell System Technical Journal 27(3), 1948.
    """
    return quantum / np.sqrt(12.0)


def estimated_parameters(given: Parameters | None, prior: FilterPrior) -> Parameters:
    """What an estimator estimates whose setting `parameters` is `given`: None is what the prior needs."""
    return prior.needed_parameters if given is None else given
