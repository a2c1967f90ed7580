"""MomentumEKF: its settings and its compiled form, with adaptation and gate as options."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.special

from satid_gym.config import check_integer, check_number
from satid_gym.core.belief.filters import FilterKind
from satid_gym.core.belief.modes import STATES
from satid_gym.estimators.alignment import DataSheet, noise_taps, write_alignment
from satid_gym.estimators.attitude import write_attitude
from satid_gym.estimators.calibration import write_calibration
from satid_gym.estimators.compiled import CompiledEKF
from satid_gym.estimators.gate import write_gate
from satid_gym.estimators.inertia import PARAMETER_COUNT, Parameters
from satid_gym.estimators.modes import write_modes
from satid_gym.estimators.prior import FilterPrior
from satid_gym.estimators.settings import EstimatorSettings

FIXED_WALK, FIRST_WALK = 0.004, 0.0015  # default inertia_walk without and with adaptation
_SUBSTEPS_MAX = 1000
_TURN = 0.035  # rad


@dataclass(frozen=True, eq=False, kw_only=True)
class MomentumEKFSettings(EstimatorSettings):
    """Tuning of the MomentumEKF.

    Attributes:
        name: "momentum".
        adaptive: whether it estimates the process noise of the inertia, and finds its steps; see
            `satid_gym.core.belief.adaptation`.
        inertia_walk: process noise: random walk of each moment relative to its prior, per sqrt(s); with adaptation
            that of the start. None is 0.0015 with adaptation and 0.004 without.
        inertia_walk_min: with adaptation, the least that matters, per sqrt(s): below it the variance is estimated
            instead of its logarithm, and may be 0.
        inertia_walk_max: with adaptation, the largest, per sqrt(s): an inertia that varies faster is followed too
            slowly, and the covariance is then too small.
        log_q_drift: with adaptation, variance that the logarithm of the process noise gains a second.
        disturbance_walk: random walk of the disturbance relative to its std, per sqrt(s); None takes the prior's.
        substeps: midpoint steps between two readings; None: as many as the prior's `nutation` asks for.
        calibrate: whether it estimates, in addition to the inertia, the errors of gyro and wheels that the data sheet's
            tolerances allow; see `satid_gym.core.belief.calibration`. Without, it takes both as nominal.
        flexible: whether it estimates the modes that the data sheet's panels and slosh masses give, see
            `satid_gym.core.belief.modes`. Without, it takes the body as rigid.
        rate_coordinates: whether updates are made in errors of the body rate instead of the momentum's, see
            `satid_gym.core.belief.retraction`; where it estimates errors, modes or the attitude they always are.
            None: where the prior's `agitation` is below the gyro's noise, so that readings of a body that hardly moves
            pass for information on its inertia.
        gate: probability at which a reading of gyro or star tracker of a consistent filter is rejected as an outlier;
            with it the readings of sensors that repeat themselves are rejected too, see
            `satid_gym.core.belief.gating`. 0: no gate.
        announced: whether it is told when a deployment or a release is commanded and how long that takes, not what it
            does to the tensor; see `satid_gym.core.belief.announcement`.
        inflate: whether it inflates its covariance and the readings' noise while its innovations are larger or more
            coloured than those of a consistent filter, see `satid_gym.core.belief.whiteness`. Without, info's
            `unmodelled` says so and nothing else changes. None: where it estimates modes; there an early alarm
            restarts it, as does a mode's estimate that is far from the data sheet.

    Raises:
        ValueError: a value is out of range, or with adaptation a walk is more than inertia_walk_max.
    """

    kind = FilterKind.MOMENTUM
    coordinates = "momentum"

    name: Literal["momentum"] = "momentum"
    adaptive: bool = False
    inertia_walk: float = None  # type: ignore[assignment]  # settled when built
    inertia_walk_min: float = 0.0001
    inertia_walk_max: float = 0.02
    log_q_drift: float = 0.05
    disturbance_walk: float | None = None
    substeps: int | None = None
    calibrate: bool = True
    flexible: bool = True
    rate_coordinates: bool | None = None
    gate: float = 0.0
    announced: bool = True
    inflate: bool | None = None

    def __post_init__(self) -> None:
        if self.inertia_walk is None:
            object.__setattr__(self, "inertia_walk", FIRST_WALK if self.adaptive else FIXED_WALK)
        super().__post_init__()
        check_number("inertia_walk", self.inertia_walk)
        check_number("gate", self.gate, high=0.1)
        if self.disturbance_walk is not None:
            check_number("disturbance_walk", self.disturbance_walk)
        if self.substeps is not None:
            check_integer("substeps", self.substeps, high=_SUBSTEPS_MAX)
        check_number("inertia_walk_max", self.inertia_walk_max, strict=True)
        check_number("inertia_walk_min", self.inertia_walk_min, strict=True)
        check_number("log_q_drift", self.log_q_drift)
        for name in ("inertia_walk", "inertia_walk_min") if self.adaptive else ():
            if getattr(self, name) > self.inertia_walk_max:
                raise ValueError(
                    f"{name} of an adaptive MomentumEKF must be at most inertia_walk_max, {self.inertia_walk_max:g}, "
                    f"got {getattr(self, name):g}: raise inertia_walk_max as well for an inertia that varies faster"
                )

    @property
    def gate_distance(self) -> float:
        """Normalised innovation squared of a reading beyond which it is rejected; 0 without a gate."""
        return float(scipy.special.chdtri(3, self.gate)) if self.gate > 0.0 else 0.0

    def steps(self, prior: FilterPrior) -> int:
        """Midpoint steps between two readings: one in which body and momentum turn by 0.035 rad is near enough.

        Its error, a 24th of the angle's third power, then stays below what a reading tells of the momentum.
        """
        if self.substeps is not None:
            return self.substeps
        return max(1, min(int(np.ceil(prior.nutation / _TURN)), _SUBSTEPS_MAX))

    def updates_rate(self, prior: FilterPrior) -> bool:
        """Whether updates are made in errors of the rate where it does not calibrate."""
        if self.rate_coordinates is not None:
            return self.rate_coordinates
        return prior.agitation is not None and prior.agitation < prior.reading_std

    def torque_walk(self, prior: FilterPrior) -> float:
        """Random walk of the disturbance torque, N m per sqrt(s)."""
        if self.disturbance_walk is None:
            return prior.disturbance_walk
        return self.disturbance_walk * prior.disturbance_std

    def calibration_states(self, sheet: DataSheet) -> int:
        """Number of the errors of sensors and wheels that it estimates."""
        allowed = sheet.tolerances.states(sheet.wheels.count) if self.calibrate else 0
        return allowed + 3 * noise_taps(sheet)

    def mode_count(self, sheet: DataSheet) -> int:
        """Number of modes that it estimates for such a data sheet."""
        return len(sheet.modes) if self.flexible else 0

    def other_states(self, sheet: DataSheet) -> int:
        """Momentum, disturbance torque, modes, attitude error, and errors of sensors and wheels."""
        attitude = 3 if self.tells_attitude(sheet) else 0
        return 6 + STATES * self.mode_count(sheet) + attitude + self.calibration_states(sheet)

    def tells_attitude(self, sheet: DataSheet) -> bool:
        """Whether there is a star tracker."""
        return sheet.sensors.star_tracker is not None

    def write(self, row: np.void, prior: FilterPrior, parameters: Parameters) -> None:
        """Write prior and tuning to a belief record.

        Raises:
            ValueError: a star tracker with readings that are not of one instant, without the prior's sample period.
        """
        p, wheels = PARAMETER_COUNT[parameters], prior.wheels
        row["gyro_std"], row["tachometer_std"] = prior.reading_std, prior.tachometer_noise_std
        spin_std = wheels.inertia * prior.tachometer_noise_std
        row["wheel_momentum_covariance"] = (wheels.axes * spin_std**2) @ wheels.axes.T
        row["prior_theta_std"] = prior.prior_theta_std(parameters)
        row["prior_torque_std"] = prior.disturbance_std
        row["walk"][3 : 3 + p] = self.inertia_walk * row["theta_scale"]
        row["walk"][3 + p : 6 + p] = self.torque_walk(prior)
        row["substeps"] = self.steps(prior)
        write_gate(row["gate"], prior, self.gate_distance)
        adaptation = row["adaptation"]
        adaptation["on"] = self.adaptive
        for name in ("inertia_walk", "inertia_walk_min", "inertia_walk_max", "log_q_drift"):
            adaptation[name] = getattr(self, name)
        modes = self.mode_count(prior)
        if modes > 0:
            write_modes(row["modes"], prior, first=6 + p)
        first = 6 + p + STATES * modes
        if prior.sensors.star_tracker is not None:
            if prior.sensors.are_timed and prior.sample_period is None:
                raise ValueError(
                    "a star tracker with readings that are late or averaged needs the prior's sample_period, s: they "
                    "are brought to one instant by it"
                )
            write_attitude(row["attitude"], prior.sensors.star_tracker, first, prior.sample_period or 0.0)
            first += 3
        if self.calibration_states(prior) > 0:
            write_calibration(row, prior, first, self.calibrate)
        write_alignment(row, prior)
        row["is_told"] = self.announced
        row["whiteness"]["inflate"] = modes > 0 if self.inflate is None else self.inflate
        known = self.calibration_states(prior) > 0 or modes > 0 or self.tells_attitude(prior)
        row["rate_coordinates"] = known or self.updates_rate(prior)


class MomentumEKF(CompiledEKF):
    """The EKF in momentum coordinates: x = [M, theta, tau].

    Args:
        **settings: fields of `MomentumEKFSettings`.
    """

    settings: MomentumEKFSettings

    def __init__(self, **settings: object) -> None:
        super().__init__(MomentumEKFSettings.from_dict(settings))

    @property
    def inertia_walk(self) -> float:
        """Random walk of each moment relative to its prior, per sqrt(s), that the last prediction used."""
        row = self.record
        adaptation = row["adaptation"]
        return float(adaptation["walk"] if adaptation["on"] else row["walk"][3] / row["theta_scale"][0])

    @property
    def steps(self) -> int:
        """Steps of the inertia that were found, with adaptation."""
        return int(self.record["adaptation"]["steps"])


class AdaptiveEKF(MomentumEKF):
    """The default filter: the MomentumEKF with adaptation.

    Args:
        **settings: fields of `MomentumEKFSettings`.
    """

    def __init__(self, **settings: object) -> None:
        super().__init__(**{"adaptive": True, **settings})
