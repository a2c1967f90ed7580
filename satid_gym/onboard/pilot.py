"""Pilot: filter, observation, policy and rate loop as one object, for a control loop outside the environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from satid_gym.config import check_integer, check_number
from satid_gym.estimators.records import new_work
from satid_gym.estimators.settings import EstimatorSettings
from satid_gym.gym_api import real_action
from satid_gym.onboard import kernels
from satid_gym.onboard.choice import policy_by_name
from satid_gym.onboard.clock import SAME, Clock
from satid_gym.onboard.readings import Reading, attitude_reading, gyro_reading, instant, sun_direction, wheel_reading
from satid_gym.onboard.reports import Estimate, Status, estimate_of
from satid_gym.policy import Policy, missions, observation_settings, show_filter
from satid_gym.problem import problem
from satid_gym.resolution import SatelliteLike, ScenarioLike
from satid_gym.templates import build_templates


class Pilot:
    """Flies a policy on readings from any source: another simulator, a test bench, a satellite.

    Give it every reading of gyro, wheel speeds and star tracker; it returns the motor torque to command, updated once
    per decision period, under control "rate" with every reading. On the same readings its commands and estimates equal
    those of the environment.

    A reading of None or NaN is missing. Without the gyro the filter continues with the wheel speeds; without wheel
    speeds it waits for the next ones and bridges the gap by interpolation, and meanwhile the rate loop commands zero
    torque. The torque is also zero for a decision without wheel speeds or more than `patience` seconds after the gyro's
    last reading, after a failure of the filter, and while the clock stands still or jumps; `status` says so. The first
    readings after a gap longer than `patience` are left out until the next confirm their time. Commands are always
    finite and within the motors' limits.

    Args:
        satellite: name, file, mapping or `Satellite`; the filter knows its data sheet.
        policy: a shipped policy's name, a baseline's that is tuned for the satellite, the path of a policy, or any
            object that follows `Policy`.
        scenario: periods, horizon, limits and the filter's prior, as for the environment.
        estimator: a compiled filter, by name or settings; None takes the scenario's.
        control: what the policy's actions are, "torque" of each wheel or body "rate", as for the environment.
        patience: s without a gyro reading after which it commands zero torque; None: three decision periods.
        seed: seed of random policies.

    Raises:
        ValueError: a name is unknown, a value is not valid, or the policy cannot fly this satellite.
    """

    def __init__(
        self,
        satellite: SatelliteLike,
        policy: str | Policy = "generalist",
        *,
        scenario: ScenarioLike = "default",
        estimator: str | Mapping[str, Any] | EstimatorSettings | None = None,
        control: str = "torque",
        patience: float | None = None,
        seed: int = 0,
    ) -> None:
        given = problem(satellite, "static", scenario, estimator, control=control)
        world, own = given.scenario, given.satellites[0]
        if world.operations is not None:
            raise ValueError(
                f"a pilot is not told of imaging windows, which scenario {world.name!r} has: give one without "
                "operations"
            )
        if len(given.satellites) != 1:
            raise ValueError(
                f"a pilot flies one data sheet, and {satellite!r} in scenario {world.name!r} stands for "
                f"{len(given.satellites)}: give one of the environment's, env.unwrapped.problem.satellites"
            )
        self.policy: Policy = policy_by_name(policy, own, world) if isinstance(policy, str) else policy
        self.problem = given.replace(**observation_settings(self.policy))
        (self.mission,) = missions(self.problem)
        self.patience = 3.0 * world.decision_period if patience is None else check_number("patience", patience)
        self.seed = check_integer("seed", seed, low=0)
        self.status = Status()
        self._first = build_templates(self.problem).records
        n, size = self.problem.wheels, max(place.stop for place in self.problem.layout.values())
        self._readings = np.zeros(1, kernels.readings_dtype(n))
        self._observation = np.zeros((1, size), np.float32)
        self._torque = np.zeros(n)
        self.policy.reset(self.mission, [self.seed])  # a policy that cannot fly this satellite says so now

    @property
    def estimate(self) -> Estimate:
        """Present estimate of the filter.

        Raises:
            RuntimeError: `start` was not called.
        """
        if self.status.state == "waiting":
            raise RuntimeError("there is no estimate yet: call start(time, gyro, wheel_speed) first")
        return estimate_of(self._beliefs, self._time, self._nis)

    def start(
        self, time: float, gyro: object, wheel_speed: object, attitude: object = None, sun: object = None
    ) -> np.ndarray:
        """Start a flight, or restart.

        Args:
            time: s, of any clock.
            gyro: (3,) rad/s, body frame.
            wheel_speed: (n,) relative to the body, rad/s.
            attitude: (4,) of the star tracker, a quaternion from body to inertial, scalar last; None: no new reading.
            sun: (3,) direction of the Sun, inertial frame, which is observed where the Sun blinds the star tracker;
                None: it is observed as 0. The Earth is taken as the environment has it, at the inertial
                (cos nt, sin nt, 0) with t from the start.

        Returns:
            (n,) motor torque on the wheels to command, N m; the body feels the opposite.

        Raises:
            ValueError: a reading is not finite, of another shape, or beyond any limit (a wrong unit), an attitude is
                given and the satellite has no star tracker, or the Sun's direction is (0, 0, 0).
        """
        time = instant(time)
        towards = np.zeros(3) if sun is None else sun_direction(sun)
        readings = self._judge(gyro, wheel_speed, attitude)
        if any(reading.value is None for reading in readings[:2]) or readings[2].absence == "refused":
            raise ValueError("; ".join(reading.message for reading in readings if reading.absence))
        (rate, *_), (speed, *_), (turned, *_) = readings
        self._beliefs, self._tasks = self._first.beliefs.copy(), self._first.tasks.copy()
        self._tasks["sun"] = towards
        self._work, self._substeps = new_work(self._beliefs), int(self._beliefs["substeps"][0])
        self._begun = self._time = self._heard = self._steered = time
        self._clock = Clock(time, self.problem.scenario.sample_period, self.patience)
        self._decided, self._nis, self.status = 0, np.nan, Status(state="flying")
        self.policy.reset(self.mission, [self.seed])
        reading = self._readings[0]
        reading["gyro"], reading["tachometer"], reading["gyro_flagged"] = rate, speed, 0
        reading["tracker"] = turned is not None, np.nan if turned is None else turned
        kernels.begin(self._readings, self._beliefs, self._tasks, self._work, self._observation)
        self._decide(1)
        self._steer(True)
        return self._torque.copy()

    def step(self, time: float, gyro: object = None, wheel_speed: object = None, attitude: object = None) -> np.ndarray:
        """Process the readings of one instant; arguments and result are those of `start`, None is a missing reading.

        An attitude without wheel speeds is ignored.

        Raises:
            RuntimeError: `start` was not called.
            ValueError: the time is not finite, a reading has another shape, or an attitude is given and the satellite
                has no star tracker.
        """
        if self.status.state == "waiting":
            raise RuntimeError("the pilot has not started: call start(time, gyro, wheel_speed) first")
        time = instant(time)
        self.status.message = ""
        readings = self._judge(gyro, wheel_speed, attitude)
        for reading in readings:
            if reading.absence:
                self._count(reading.absence, reading.message)
        (rate, *_), (speed, *_), (turned, *_) = readings
        world = self.problem.scenario
        period = world.sample_period
        if wrong := self._clock.wrong(time):
            self._count(wrong.kind, wrong.message)
            if self._clock.stands and self.status.state != "over":
                self._coast("the clock stands still, was set back, or jumps: start again")
                self._steer(False)
            return self._torque.copy()
        due = self._due(time)
        if speed is not None and (time - self._time) / period < world.decisions * world.samples + 1:
            self._tasks["decision"] = min(self._decided + max(due, 1) - 1, world.decisions)
            self._update(time, rate, speed, turned)
        self._look_after(time)
        if due and self.status.state != "over":
            if speed is None:
                self._coast("no torque: a decision is due and there are no wheel speeds")
            elif time - self._heard <= self.patience and not self._lost():
                self._decide(due)
        self._steer(speed is not None)
        return self._torque.copy()

    def _judge(self, *given: object) -> list[Reading]:
        """Readings of gyro, wheel speeds and star tracker; of the last a missing one is no fault."""
        judges = gyro_reading, wheel_reading, attitude_reading
        return [judge(value, self.mission.satellite) for judge, value in zip(judges, given, strict=True)]

    def _count(self, kind: str, message: str) -> None:
        self.status.counts[kind] += 1
        self._say(message)

    def _say(self, message: str) -> None:
        self.status.message = f"{self.status.message}; {message}" if self.status.message else message

    def _due(self, time: float) -> int:
        """Decisions that should have been taken by now and were not; half a sample early counts."""
        world = self.problem.scenario
        elapsed = (time - self._begun + 0.5 * world.sample_period) / world.decision_period
        return int(min(elapsed, world.decisions)) + 1 - self._decided

    def _update(self, time: float, rate: np.ndarray | None, speed: np.ndarray, attitude: np.ndarray | None) -> None:
        """Give the filter what is there; across a gap it takes as many steps as samples are missing."""
        reading, period = self._readings[0], self.problem.scenario.sample_period
        reading["tachometer"], reading["gyro_flagged"] = speed, rate is None
        reading["tracker"] = attitude is not None, np.nan if attitude is None else attitude
        if rate is not None:
            reading["gyro"], self._heard = rate, time
        dt = time - self._time
        steps = max(1, round(dt / period))
        if abs(dt - steps * period) < SAME * period:
            dt = steps * period
        if steps > 1:
            kernels.cross_gap(self._beliefs, self._tasks, dt)
        self._beliefs["substeps"] = self._substeps * steps
        rejected = int(self._beliefs["rejected"][0])
        self._nis = float(kernels.take(self._readings, self._beliefs, self._tasks, self._work, dt, self._observation))
        self._beliefs["substeps"] = self._substeps
        self._time = time
        for _ in range(int(self._beliefs["rejected"][0]) - rejected):
            self._count("rejected", "a reading that the filter's gate rejects")

    def _look_after(self, time: float) -> None:
        """End the flight at the horizon, and coast where the filter is blind or lost."""
        if self._decided + self._due(time) > self.problem.scenario.decisions:
            self._hold(np.zeros(self.problem.actions))
            self.status.state = "over"
        elif self._lost():
            self._coast("the filter broke down: start again")
        elif time - self._heard > self.patience:
            self._coast(f"no gyro reading for {time - self._heard:.3g} s")

    def _lost(self) -> bool:
        """Whether the filter broke down, after which only `start` helps."""
        return bool(self._beliefs["broken"][0]) or not np.isfinite(self._observation).all()

    def _decide(self, due: int) -> None:
        """Ask the policy, once for each decision that is due, so that one that counts them keeps up."""
        for _ in range(due):
            show_filter(self.policy, self._beliefs, self._tasks)
            action = real_action("action", self.policy(self._observation.copy()))
        self._decided, self.status.counts["missed"] = self._decided + due, self.status.counts["missed"] + due - 1
        self._tasks["nis_sum"], self._tasks["nis_count"] = 0.0, 0
        if action.shape != (1, self.problem.actions) or not np.isfinite(action).all():
            self._coast(f"policy {self.policy.name} gave no action: {action.tolist()}")
        else:
            self._hold(np.clip(action[0].astype(float), -1.0, 1.0))
            self.status.state = "flying"

    def _steer(self, told: bool) -> None:
        """Follow the rate that the policy commands, where it commands one and was `told` the wheels' speed."""
        if self.problem.control != "rate":
            return
        if told and self.status.state == "flying":
            dt, self._steered = self._time - self._steered, self._time
            kernels.steer(self._readings, self._beliefs, self._tasks, self._work, dt)
        else:
            self._work["torque"][0] = 0.0
            kernels.let_go(self._tasks)
        self._torque = self._work["torque"][0].copy()

    def _coast(self, message: str) -> None:
        self._hold(np.zeros(self.problem.actions))
        self.status.state = "coasting"
        self._say(message)

    def _hold(self, fraction: np.ndarray) -> None:
        """Command a fraction of the motors' limits (n,) or of the rate limit (3,) until the next decision."""
        task, rates = self._tasks[0], self.problem.control == "rate"
        task["command"][: len(fraction)] = fraction
        task["tracking"]["reference"] = fraction * task["rate_limit"] if rates else 0.0
        self._torque = np.zeros_like(self._torque) if rates else fraction * task["torque_max"]
        self._work["torque"][0] = self._torque
