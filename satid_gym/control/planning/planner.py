"""Planner: forecast of what a sequence of body-rate commands would teach the filter, which the planners share.

A planner keeps the covariance that the MomentumEKF must have: the same equations, along the rates that were
observed, for observations give only part of it. (In place of an adaptive one it keeps one of a process noise between
those that it finds.) From there it flies candidate commands, as `RateLoop` would turn them into torque, on the
estimated satellite without noise, and adds up what the filter's updates gain and leave to be known. Time goes in
`steps` a decision, with the readings of a step taken as one of their mean's noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from satid_gym.control.decoded_observation import Belief, PlantConstants, times
from satid_gym.control.planning.forecast import Observed, Scratch, Start, Trail, World, follow, forecast_many
from satid_gym.control.planning.plan_search import improve_many
from satid_gym.core.observation import observed_std
from satid_gym.estimators.inertia import Parameters, inertia_parameters
from satid_gym.estimators.momentum import MomentumEKFSettings
from satid_gym.estimators.records import new_belief, new_work
from satid_gym.estimators.settings import EstimatorSettings
from satid_gym.policy import Mission
from satid_gym.reaction_wheels import ReactionWheels
from satid_gym.sensors import Sensors
from satid_gym.tolerances import Tolerances

PLANNING_MARGIN = 2.75  # of the rate loop, standard deviations, where no tuning has found a better one
CLEARANCE = 0.02  # of wheels from the band that operators avoid, over their speed limit
ADAPTIVE_WALK = 0.0012  # of the MomentumEKF that stands for an adaptive one; of 0.0003 to 0.004 on tuning seeds


@dataclass(frozen=True, eq=False, kw_only=True)
class Forecast:
    """Information and error that candidates promise.

    Attributes:
        gained: (N, C) nats, sum over updates of 1/2 log(det P before / det P after).
        error: (N, C) relative error of the inertia that the filter expects, root mean square, mean over the horizon.
    """

    gained: np.ndarray
    error: np.ndarray


class Planner:
    """Forecasts for N episodes of one satellite.

    Args:
        mission: what is flown.
        episodes: N.
        steps: of the forecast in each decision.
        margin: of the rate loop, see `RateLoop`.
        walk: of the inertia, per sqrt(s), that forecasts take where the filter that is flown is adaptive.
        amplitude: of the rates, over what the envelope allows.
        clearance: that wheels keep from the band that operators avoid, over their speed limit.
    """

    def __init__(
        self,
        mission: Mission,
        episodes: int,
        steps: int,
        margin: float,
        walk: float = ADAPTIVE_WALK,
        amplitude: float = 1.0,
        clearance: float = CLEARANCE,
    ) -> None:
        scenario, layout = mission.scenario, mission.layout
        self.constants, self.layout = PlantConstants.of([mission]), layout
        self._margin, self._amplitude = margin, amplitude
        step = scenario.decision_period / steps
        theta = layout["inertia"].stop - layout["inertia"].start
        self._parameters: Parameters = "principal" if theta == 3 else "full"
        settings = MomentumEKFSettings(
            parameters=self._parameters,
            inertia_walk=planning_walk(mission.estimator, walk),
            calibrate=False,  # a plan takes sensors and wheels as nominal,
            flexible=False,  # and the body as rigid
        )
        averaged = np.sqrt(scenario.sample_period / step)  # noise of a step's mean over a reading's
        prior = mission.prior.replace(
            gyro_noise_std=mission.prior.reading_std * averaged,
            tachometer_noise_std=mission.prior.tachometer_noise_std * averaged,
            sensors=Sensors(),  # nor does it wait for a reading
            tolerances=Tolerances(),
        )
        self.beliefs = np.repeat(new_belief(prior, settings), episodes)
        constants = self.constants
        self._world = World(
            allocation=constants.allocation[0],
            rotor_inertia=constants.rotor_inertia[0],
            max_torque=constants.max_torque[0],
            max_spin=np.maximum(constants.max_spin - margin * constants.impulse_std, 0.0)[0],
            avoided=_widened(mission.satellite.wheels, clearance),
            step=step,
            steps=steps,
        )
        self._scratch = Scratch(new_work(self.beliefs), np.empty(prior.wheels.count), np.empty(3))
        self._before: Belief | None = None

    def observe(self, observation: np.ndarray) -> Belief:
        """Take in the observations (N, size) of a new decision, and what they say in physical units."""
        belief = Belief.read(observation, self.layout, self.constants)
        if "inertia_walk" in self.layout:  # of the filter that is flown, in place of one between those it finds
            walk = observed_std(observation[:, self.layout["inertia_walk"]].astype(float))
            p = self.beliefs.dtype["prior_theta"].shape[0]
            self.beliefs["walk"][:, 3 : 3 + p] = walk * self.beliefs["theta_scale"]
        theta = inertia_parameters(belief.inertia, self._parameters)
        seen = Observed(
            before=(self._before or belief).omega,
            after=belief.omega,
            wheel_speed=belief.wheel_momentum / self.constants.wheel_inertia,
            mean=np.concatenate([belief.momentum, theta, belief.disturbance], axis=1),
            wheel_momentum=times(self.constants.axes, belief.wheel_momentum),
        )
        follow(self._before is None, self.beliefs, seen, self._world, self._scratch)
        self._before = belief
        return belief

    def rate_cap(self) -> np.ndarray:
        """(N, 3) rad/s: the rate limit less the margin for the motors' noise and the gyro's, times the amplitude."""
        constants, belief = self.constants, self._before
        assert belief is not None
        J_inv = np.linalg.inv(belief.inertia)
        noise = (((J_inv @ constants.axes) * constants.impulse_std[:, None, :]) ** 2).sum(axis=2)
        margin = self._margin * np.sqrt(noise + constants.gyro_noise_std**2)
        return self._amplitude * np.maximum(constants.rate_limit - margin, 0.0)

    def forecast(self, commands: np.ndarray) -> Forecast:
        """Fly candidates (N or 1, C, H, 3): H decisions of rate commands in [-1, 1]."""
        shape = (len(self.beliefs), commands.shape[1])
        out = Forecast(gained=np.empty(shape), error=np.empty(shape))
        trail, commands = self._trail(commands.shape[2]), np.ascontiguousarray(commands)  # what numba has compiled
        forecast_many(self._start(), trail, self._scratch, commands, self._world, out.gained, out.error)
        return out

    def improve(self, plans: np.ndarray, streams: np.ndarray, edits: int, ahead: int) -> None:
        """Reduce the error that plans (N, H, 3) of rate commands promise over `ahead` decisions.

        Local search: one edit after another, drawn from the streams (N, 4), is kept where it helps.
        """
        trails = self._trail(ahead), self._trail(ahead)
        improve_many(self._start(), *trails, self._scratch, plans, streams, edits, self._world)

    def side_value(self, plans: np.ndarray, ahead: int) -> np.ndarray:
        """How much less error each axis promises by turning to the plus side now than by turning to the minus side.

        One of the two is what the plan (N, H, 3) does; the other is flown for this decision alone or until the
        plan's next reversal, whichever promises less error.

        Returns:
            (N, 3) sum of the difference over the next `ahead` decisions, over the plan's mean error.
        """
        plans = plans[:, :ahead]
        # the plan, then each axis the other way: now, and until it reverses
        trials = np.repeat(plans[:, None], 7, axis=1)
        held = np.logical_and.accumulate(plans == plans[:, :1], axis=1)
        for k in range(3):
            trials[:, 1 + k, 0, k] *= -1.0
            trials[:, 4 + k, :, k] *= np.where(held[:, :, k], -1.0, 1.0)
        error = self.forecast(trials).error
        other = np.minimum(error[:, 1:4], error[:, 4:])
        return plans[:, 0] * ahead * (other / error[:, :1] - 1.0)

    def _trail(self, ahead: int) -> Trail:
        return Trail.of(self.beliefs.dtype, ahead)

    def _start(self) -> Start:
        assert self._before is not None
        constants, h = self.constants, self._before.wheel_momentum
        null = (h - times(constants.allocation, times(constants.axes, h))) / constants.wheel_inertia
        return Start(self.beliefs, self._before.omega, self.rate_cap(), null)


def _widened(wheels: ReactionWheels, clearance: float) -> np.ndarray:
    """Band of wheel speed (2,) that plans keep out of, rad/s."""
    low, high = wheels.avoided_speed
    room = clearance * wheels.max_speed.min() if high > low else 0.0
    return np.array([max(low - room, 0.0), high + room])


def planning_walk(estimator: EstimatorSettings, adaptive: float = ADAPTIVE_WALK) -> float:
    """Inertia walk, per sqrt(s), of the MomentumEKF that a forecast takes for the filter that is flown."""
    if not isinstance(estimator, MomentumEKFSettings):
        return MomentumEKFSettings().inertia_walk
    return adaptive if estimator.adaptive else estimator.inertia_walk
