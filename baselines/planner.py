"""What a sequence of body-rate commands would teach the filter: the model that the planning baselines share.

A planner keeps the covariance that the MomentumEKF must have: the same equations, along the rates that were
observed, for observations give only part of it. From there it flies candidate commands, as `RateLoop` would
turn them into torque, on the estimated satellite without noise, and adds up what the filter's updates gain.
Time goes in `steps` a decision, with the readings of a step taken as one of their mean's noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from baselines.belief import Belief, Craft
from satid_gym.core import momentum_filter
from satid_gym.core.algebra import (
    add,
    axpy,
    axpy_symmetric,
    cross,
    inverse,
    load,
    load_symmetric,
    multiply,
    store,
    subtract,
)
from satid_gym.core.dynamics import sum_wheels
from satid_gym.core.jit import inline, kernel
from satid_gym.core.kalman import estimated_inertia
from satid_gym.core.records import LOGDET
from satid_gym.core.reward import spread
from satid_gym.estimators.belief import new_belief, new_work
from satid_gym.estimators.settings import MomentumEKFSettings, Parameters, brief
from satid_gym.policy import Mission


@dataclass(frozen=True, eq=False, kw_only=True)
class Forecast:
    """What candidates promise, nats.

    Attributes:
        gained: (N, C) sum over updates of 1/2 log(det P before / det P after).
        held: (N, C) mean over the horizon of 1/2 log(det P of the prior / det P).
    """

    gained: np.ndarray
    held: np.ndarray


class Planner:
    """Forecasts for N episodes of one satellite.

    Args:
        mission: what is flown.
        episodes: N.
        steps: of the forecast in each decision.
        margin: of the rate loop, see `RateLoop`.
    """

    def __init__(self, mission: Mission, episodes: int, steps: int, margin: float) -> None:
        scenario, layout = mission.scenario, mission.layout
        self.craft, self.layout = Craft.of([mission]), layout
        self._margin, self._steps = margin, steps
        self._step = scenario.decision_period / steps
        parameters: Parameters = "principal" if layout["inertia"].stop - layout["inertia"].start == 3 else "full"
        settings = MomentumEKFSettings(parameters=parameters)
        averaged = np.sqrt(scenario.sample_period / self._step)  # noise of a step's mean over a reading's
        satellite = mission.satellite  # as operated, so that the scenario's factors are in it already
        briefing = brief(satellite, scenario.replace(wheel_speed_scale=1.0, disturbance_scale=1.0))
        briefing = briefing.replace(
            gyro_noise_std=briefing.gyro_noise_std * averaged,
            tachometer_noise_std=briefing.tachometer_noise_std * averaged,
        )
        self.beliefs = np.repeat(new_belief(briefing, settings), episodes)
        self._scratch = self.beliefs[:1].copy()
        self._work = new_work(satellite.wheels.count, settings)
        self._before: Belief | None = None

    def observe(self, observation: np.ndarray) -> Belief:
        """Take in the observations (N, size) of a new decision, and what they say in physical units."""
        belief = Belief.read(observation, self.layout, self.craft)
        speed = belief.wheel_momentum / self.craft.wheel_inertia
        before = self._before or belief
        theta = self.layout["inertia"].stop - self.layout["inertia"].start
        mean = np.concatenate([belief.momentum, _parameters(belief.inertia, theta), belief.disturbance], axis=1)
        spin = (self.craft.axes @ belief.wheel_momentum[..., None])[..., 0]
        first, mixer = self._before is None, self.craft.mixer[0]
        times = (self._step, self._steps)
        follow(first, self.beliefs, self._work, before.omega, belief.omega, speed, mixer, *times, mean, spin)
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
        belief, craft = self._before, self.craft
        assert belief is not None
        shape = (len(self.beliefs), commands.shape[1])
        out = Forecast(gained=np.empty(shape), held=np.empty(shape))
        limit = np.maximum(craft.max_spin - self._margin * craft.impulse_std, 0.0)[0]
        wheels = (craft.mixer[0], craft.carried[0], craft.max_torque[0], limit)
        times = (self._step, self._steps)
        forecast_many(
            self.beliefs,
            self._scratch,
            self._work,
            belief.omega,
            self.rate_cap(),
            commands,
            *wheels,
            *times,
            out.gained,
            out.held,
        )
        return out


def _parameters(inertia: np.ndarray, count: int) -> np.ndarray:
    parts = [inertia[:, i, i] for i in range(3)] + [inertia[:, i, j] for i, j in ((0, 1), (0, 2), (1, 2))]
    return np.stack(parts[:count], axis=1)


@inline
def _mix(mixer, v, out):
    """out (n,) = mixer (n, 3) v."""
    for k in range(out.shape[0]):
        out[k] = mixer[k, 0] * v[0] + mixer[k, 1] * v[1] + mixer[k, 2] * v[2]


@inline
def _turn(belief, work, mixer, inertia, end, step, speed, rate):
    """Covariance one step on, at the end of which the body turns at `end`; the reading there is left in `rate`."""
    momentum, omega, p = load(belief.mean), momentum_filter.rate(belief), belief.prior_theta.shape[0]
    after = axpy(step, add(cross(momentum, omega), load(belief.mean[3 + p :])), momentum)
    _mix(mixer, subtract(after, multiply(inertia, end)), speed)
    for k in range(speed.shape[0]):
        speed[k] /= belief.wheel_inertia[k]
    momentum_filter.predict(belief, work, speed, step)
    store(rate, momentum_filter.rate(belief))  # the reading that is expected: it moves the covariance alone


@inline
def _reach(belief, inertia, omega, wanted, mixer, carried, max_torque, max_spin, period, wheel):
    """Body rate a decision after `omega` when `RateLoop` is told `wanted`, rad/s."""
    momentum, tau = load(belief.mean), load(belief.mean[3 + belief.prior_theta.shape[0] :])
    stored = subtract(momentum, multiply(inertia, wanted))
    _mix(mixer, stored, wheel)
    for k in range(wheel.shape[0]):
        wheel[k] = min(max(wheel[k], -max_spin[k]), max_spin[k])
    wanted = add(wanted, multiply(inverse(inertia), subtract(stored, sum_wheels(belief.axes, wheel))))
    change = subtract(wanted, omega)
    loose = axpy_symmetric(-1.0, load_symmetric(carried), inertia)
    drift = add(cross(momentum, axpy(0.5, change, omega)), tau)
    _mix(mixer, axpy(-1.0 / period, multiply(loose, change), drift), wheel)
    for k in range(wheel.shape[0]):
        wheel[k] = min(max(wheel[k], -max_torque[k]), max_torque[k])
    return axpy(period, multiply(inverse(loose), subtract(drift, sum_wheels(belief.axes, wheel))), omega)


def _build_follow(fingerprint):
    def follow(first, beliefs, work, before, after, speed, mixer, step, steps, mean, spin):
        """Bring the covariances to the present observation: (N, 3) rates before and after, (N, n) wheel speeds."""
        fingerprint  # noqa: B018
        wheel, rate = np.empty(speed.shape[1]), np.empty(3)
        for i in range(beliefs.shape[0]):
            belief = beliefs[i]
            if first:
                momentum_filter.start(belief, work[0], after[i], speed[i])
            else:
                inertia, change = estimated_inertia(belief), subtract(load(after[i]), load(before[i]))
                for s in range(steps):
                    end = axpy((s + 1.0) / steps, change, load(before[i]))
                    _turn(belief, work[0], mixer, inertia, end, step, wheel, rate)
                    momentum_filter.condition(belief, work[0], rate)
            belief.mean[:] = mean[i]
            belief.wheel_input[:3] = spin[i]

    return follow


def _build_forecast_many(fingerprint):
    def forecast_many(
        beliefs, scratch, work, omegas, caps, commands, mixer, carried, max_torque, max_spin, step, steps, gained, held
    ):  # fmt: skip
        """See `Planner.forecast`; omegas, caps (N, 3), commands (N or 1, C, H, 3), gained and held (N, C)."""
        fingerprint  # noqa: B018
        wheel, rate = np.empty(mixer.shape[0]), np.empty(3)
        period, horizon = step * steps, commands.shape[2]
        for i in range(beliefs.shape[0]):
            row = min(i, commands.shape[0] - 1)
            inertia = estimated_inertia(beliefs[i])
            for c in range(commands.shape[1]):
                scratch[0] = beliefs[i]
                belief = scratch[0]
                omega = load(omegas[i])
                gained[i, c] = held[i, c] = 0.0
                for d in range(horizon):
                    x, y, z = load(commands[row, c, d])
                    wanted = (x * caps[i, 0], y * caps[i, 1], z * caps[i, 2])
                    end = _reach(
                        belief, inertia, omega, wanted, mixer, carried, max_torque, max_spin, period, wheel
                    )  # fmt: skip
                    change = subtract(end, omega)
                    for s in range(steps):
                        to = axpy((s + 1.0) / steps, change, omega)
                        _turn(belief, work[0], mixer, inertia, to, step, wheel, rate)
                        before = spread(belief, work[0], LOGDET)
                        momentum_filter.condition(belief, work[0], rate)
                        after = spread(belief, work[0], LOGDET)
                        gained[i, c] += before - after
                        held[i, c] -= after / (horizon * steps)
                    omega = end

    return forecast_many


follow = kernel(_build_follow)
forecast_many = kernel(_build_forecast_many)
