"""What a sequence of body-rate commands would teach the filter: the model that the planning baselines share.

A planner keeps the covariance that the MomentumEKF must have: the same equations, along the rates that were
observed, for observations give only part of it. (In place of an AdaptiveEKF it keeps a MomentumEKF of a walk between
those that it finds.) From there it flies candidate commands, as `RateLoop` would turn them into torque, on the
estimated satellite without noise, and adds up what the filter's updates gain and leave to be known. Time goes in
`steps` a decision, with the readings of a step taken as one of their mean's noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from satid_gym.control.decoded_observation import Belief, Craft
from satid_gym.control.forecast import follow, forecast_many, improve_many
from satid_gym.estimators.belief import new_belief, new_work
from satid_gym.estimators.settings import (
    AdaptiveEKFSettings,
    MomentumEKFSettings,
    Parameters,
    brief,
    estimator_settings,
)
from satid_gym.policy import Mission
from satid_gym.scenario import Scenario

PLANNING_MARGIN = 2.75  # of the rate loop, standard deviations, where no tuning has found a better one
ADAPTIVE_WALK = 0.0012  # of the MomentumEKF that stands for an AdaptiveEKF; of .0003 to .004 on tuning seeds


@dataclass(frozen=True, eq=False, kw_only=True)
class Forecast:
    """What candidates promise.

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
        walk: of the inertia, per sqrt(s), that forecasts take where the scenario's filter is an AdaptiveEKF.
    """

    def __init__(self, mission: Mission, episodes: int, steps: int, margin: float, walk: float = ADAPTIVE_WALK) -> None:
        scenario, layout = mission.scenario, mission.layout
        self.craft, self.layout = Craft.of([mission]), layout
        self._margin, self._steps = margin, steps
        self._step = scenario.decision_period / steps
        parameters: Parameters = "principal" if layout["inertia"].stop - layout["inertia"].start == 3 else "full"
        settings = MomentumEKFSettings(parameters=parameters, inertia_walk=planning_walk(scenario, walk))
        averaged = np.sqrt(scenario.sample_period / self._step)  # noise of a step's mean over a reading's
        satellite = mission.satellite  # as operated, so that the scenario's factors are in it already
        briefing = brief(satellite, scenario.replace(wheel_speed_scale=1.0, disturbance_scale=1.0))
        briefing = briefing.replace(
            gyro_noise_std=briefing.gyro_noise_std * averaged,
            tachometer_noise_std=briefing.tachometer_noise_std * averaged,
        )
        self.beliefs = np.repeat(new_belief(briefing, settings), episodes)
        self._work = new_work(self.beliefs)
        self._before: Belief | None = None

    def observe(self, observation: np.ndarray) -> Belief:
        """Take in the observations (N, size) of a new decision, and what they say in physical units."""
        belief = Belief.read(observation, self.layout, self.craft)
        speed = belief.wheel_momentum / self.craft.wheel_inertia
        before = self._before or belief
        theta = self.layout["inertia"].stop - self.layout["inertia"].start
        mean = np.concatenate([belief.momentum, _parameters(belief.inertia, theta), belief.disturbance], axis=1)
        spin = (self.craft.axes @ belief.wheel_momentum[..., None])[..., 0]
        first, allocation = self._before is None, self.craft.allocation[0]
        times = (self._step, self._steps)
        follow(first, self.beliefs, self._work, before.omega, belief.omega, speed, allocation, *times, mean, spin)
        self._before = belief
        return belief

    def rate_cap(self) -> np.ndarray:
        """(N, 3) rad/s: the rate limit less the margin for the motors' noise and the gyro's."""
        craft, belief = self.craft, self._before
        assert belief is not None
        flexibility = np.linalg.inv(belief.inertia)
        noise = (((flexibility @ craft.axes) * craft.impulse_std[:, None, :]) ** 2).sum(axis=2)
        return np.maximum(craft.rate_limit - self._margin * np.sqrt(noise + craft.gyro_noise_std**2), 0.0)

    def forecast(self, commands: np.ndarray) -> Forecast:
        """Fly candidates (N or 1, C, H, 3): H decisions of rate commands in [-1, 1]."""
        shape = (len(self.beliefs), commands.shape[1])
        out = Forecast(gained=np.empty(shape), error=np.empty(shape))
        trail, commands = self._trail(commands.shape[2]), np.ascontiguousarray(commands)  # what numba has compiled
        forecast_many(self.beliefs, trail, self._work, *self._start(), commands, *self._world(), out.gained, out.error)
        return out

    def improve(self, plans: np.ndarray, streams: np.ndarray, edits: int, ahead: int) -> None:
        """Lessen the error that plans (N, H, 3) of rate commands, each -1 or 1, promise over `ahead` decisions.

        Local search: one edit after another, drawn from the streams (N, 4), is kept where it helps.
        """
        trails = (self._trail(ahead), self._trail(ahead))
        improve_many(self.beliefs, *trails, self._work, *self._start(), plans, streams, edits, ahead, *self._world())

    def advantage(self, plans: np.ndarray, ahead: int) -> np.ndarray:
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

    def _trail(self, ahead: int) -> np.ndarray:
        """Room for the beliefs along a plan."""
        return np.empty(ahead + 1, self.beliefs.dtype)

    def _start(self) -> tuple[np.ndarray, np.ndarray]:
        """(N, 3) rates that forecasts begin with and (N, 3) caps, rad/s."""
        assert self._before is not None
        return self._before.omega, self.rate_cap()

    def _world(self) -> tuple[tuple[np.ndarray, ...], float, int]:
        """What a forecast flies, and its steps."""
        craft = self.craft
        limit = np.maximum(craft.max_spin - self._margin * craft.impulse_std, 0.0)[0]
        return (craft.allocation[0], craft.rotor_inertia[0], craft.max_torque[0], limit), self._step, self._steps


def planning_walk(scenario: Scenario, adaptive: float = ADAPTIVE_WALK) -> float:
    """Inertia walk, per sqrt(s), of the MomentumEKF that a forecast takes for the scenario's filter."""
    own = estimator_settings(scenario.estimator)
    if isinstance(own, AdaptiveEKFSettings):
        return adaptive
    return own.inertia_walk if isinstance(own, MomentumEKFSettings) else MomentumEKFSettings().inertia_walk


def _parameters(inertia: np.ndarray, count: int) -> np.ndarray:
    parts = [inertia[:, i, i] for i in range(3)] + [inertia[:, i, j] for i, j in ((0, 1), (0, 2), (1, 2))]
    return np.stack(parts[:count], axis=1)
