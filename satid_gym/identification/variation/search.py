"""Search for steps of the inertia: the flights' knots, and the instants of the steps found so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from satid_gym.identification.estimate import common_stds, theta_sizes
from satid_gym.identification.flexible_body.modal_momentum import flexible_windows
from satid_gym.identification.rows import Window
from satid_gym.identification.variation.changes import Likelihood
from satid_gym.identification.variation.course import Course
from satid_gym.identification.variation.instants import Instant, Surroundings, step_instant
from satid_gym.identification.variation.knots import Balance, balance, knots_of
from satid_gym.satellite import Satellite
from satid_gym.telemetry import Log

_KNOTS = 100  # of all flights together, about
_SHARE = 0.1  # of a window, that knots are apart
_READINGS = 4  # between two knots


@dataclass(eq=False)
class Search:
    """Logs with what is known of their gyros and stamps, and the steps found so far."""

    logs: Sequence[Log]
    satellite: Satellite
    window: float
    theta: np.ndarray
    delays: np.ndarray
    biases: np.ndarray
    steps: dict[tuple[int, float], Instant]

    def windows(self, log: Log, flight: int, breaks: Sequence[float], window: float) -> list[Window]:
        """Windows of a part of a flight's log."""
        return flexible_windows(
            log,
            flight,
            self.satellite,
            self.theta,
            self.delays[flight],
            self.biases[flight],
            window,
            breaks=breaks,
        )

    def build(self, drifts: bool, walk: float) -> tuple[Course, Balance]:
        """Constant course between the steps, and balance with the noise, biases and delays of a drift of size q."""
        used = sum(float(log.time[-1] - log.time[0]) for log in self.logs)
        interval = max(log.interval for log in self.logs)
        length = max(_SHARE * self.window, _READINGS * interval, used / _KNOTS)
        for _ in range(2):
            windows = [
                window
                for flight, log in enumerate(self.logs)
                for window in self.windows(log, flight, self._breaks(flight), self.window)
            ]
            flights, times = knots_of(windows, length, list(self.steps))
            starts = []
            for flight, at in self.steps:
                mine = flights == flight
                places = np.flatnonzero(mine & (times == at))[-1:] if np.isfinite(at) else np.flatnonzero(mine)[:1]
                starts += [int(k) for k in places if k > 0]
            course = Course(flight=flights, time=times, starts=tuple(sorted(starts)))
            sizes, common_std = theta_sizes(self.satellite), common_stds(self.logs, self.satellite)
            found = balance(
                windows, replace(course, drifts=drifts, walk=walk), sizes, common_std, self.satellite.gyro_noise_std
            )
            for flight, common in found.common.items():
                lag = common[6:]
                self.biases[flight] += common[:3]
                self.delays[flight, : len(lag)] += np.clip(lag, -2.0 * interval, 2.0 * interval)
        return course, found

    def _breaks(self, flight: int) -> list[float]:
        return [at for (number, at), step in self.steps.items() if number == flight and step.jumped]

    def add(self, found: Balance, course: Course, k: int) -> tuple[int, float]:
        """Add a step before knot k, of which no start may be known yet; gives its flight and instant."""
        flight = int(course.flight[k])
        if course.flight[k - 1] != flight:
            self.steps[flight, -np.inf] = Instant(time=np.nan, std=np.nan, jumped=False)
            return flight, -np.inf
        known = k in course.starts
        starts, jumps = ((), ()) if known else ((k,), (k,))
        stepped = Likelihood(found, replace(course, starts=tuple(sorted({*course.starts, *starts}))), jumps)
        theta = stepped.estimate(0.0)[0].reshape(-1, 6) * theta_sizes(self.satellite)
        own = (course.flight == flight) & np.isin(course.segment, [course.segment[k - 1], course.segment[k]])
        common = np.where(np.arange(len(found.common[flight])) // 3 == 1, found.common[flight], 0.0)  # the torque
        around = Surroundings(
            log=self.logs[flight],
            build=lambda log, breaks: self.windows(log, flight, breaks, np.inf),
            before=theta[k - 1],
            after=theta[k],
            common=common,
            sigma=found.sigma,
            jitter=found.jitter,
            scale=stepped.scale(),
        )
        reach = 0.5 * self.window
        low = max(float(course.time[own].min()), float(course.time[k - 1]) - reach)
        step = step_instant(around, low, min(float(course.time[own].max()), float(course.time[k]) + reach), self.window)
        self.steps[flight, step.time] = step
        return flight, step.time

    def start(self, course: Course, step: tuple[int, float]) -> int | None:
        """Knot that a step begins; None of a step where no readings are."""
        flight, at = step
        found = (k for k in course.starts if course.flight[k] == flight and (course.time[k] == at or at == -np.inf))
        return next(found, None)
