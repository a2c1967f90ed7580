"""Closed-loop excitation by body rates that follow square waves just inside the envelope.

The information on a moment of inertia grows with the square of its body rate, so each rate is kept near its limit
and reversed periodically; the axes reverse a third of a period apart.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.mode_limit import ModeLimit
from satid_gym.control.rate_loop import rate_loop
from satid_gym.core.observation import Form
from satid_gym.policy import Kind, Mission
from satid_gym.satellite import Satellite

_PERIOD_MIN, _REACH, _PERIODS_MIN = 12.0, 20.0, 4.0  # s; times what it takes to the rate limit; of a horizon
_MARGIN = 2.5
_STAGGER = np.array([0.0, 1.0, 2.0]) / 3.0  # of a period


class RateSquarePolicy:
    """Tracks staggered square waves of body rate.

    As `spared_square` each command goes only as far as panels and tanks stay inside their limit.

    Args:
        period: period of the square wave, s.
        margin: margin of the rate loop, see `RateLoop`.
        slews: least period over the time in which the slowest axis turns from rest to its limit, so that one setting
            does for satellites that are quick and slow.
        spares_modes: whether it is `spared_square`, see `satid_gym.control.mode_limit`; for control "rate" alone.

    Raises:
        ValueError: the period is not positive, or the margin or slews is negative.
    """

    name = "rate_square"
    kind: Kind = "closed_loop"
    observation: Form = "wheels"

    def __init__(self, period: float, margin: float, slews: float = 0.0, *, spares_modes: bool = False) -> None:
        self._make_loop = ModeLimit if spares_modes else rate_loop
        if spares_modes:
            self.name, self.observation = "spared_square", "body"  # which has the modes
        self.period = check_number("period", period, strict=True)
        self.margin = check_number("margin", margin)
        self.slews = check_number("slews", slews)

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare the rate loop for the satellite."""
        self._loop = self._make_loop([mission], self.margin)
        self._duration = mission.scenario.decision_period
        self._decision = 0
        satellite, wheels = mission.satellite, mission.satellite.wheels
        reach = wheels.torque_reach
        slowest = np.max(np.diag(mission.prior.inertia) * satellite.rate_limit / reach)  # s from rest to the limit
        self._period = max(self.period, self.slews * slowest)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, n)."""
        phase = (self._decision + 0.5) * self._duration / self._period + _STAGGER
        side = np.where(np.mod(phase, 1.0) < 0.5, 1.0, -1.0)
        self._decision += 1
        return self._loop(observation, np.broadcast_to(side, (len(observation), 3)))


def untuned_rate_square(satellite: Satellite, horizon: float) -> RateSquarePolicy:
    """`rate_square` with settings from the data sheet, for a satellite without tuned ones; `horizon` in s."""
    reached = satellite.rate_limit * np.mean(np.diag(satellite.inertia)) / np.min(satellite.wheels.max_torque)
    return RateSquarePolicy(max(_PERIOD_MIN, min(float(_REACH * reached), horizon / _PERIODS_MIN)), _MARGIN)
