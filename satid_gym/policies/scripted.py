"""Open-loop excitation by a signal that is fixed before the flight."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from satid_gym.config import check_number
from satid_gym.policy import Kind, Mission
from satid_gym.profiles import wheel_torque

Signal = Callable[..., np.ndarray]


def staggered_square(time: np.ndarray, *, period: float, horizon: float | None = None) -> np.ndarray:
    """Square waves a third of a period apart, for body rates symmetric about zero.

    Each axis begins with a quarter of its wave, so that its rate, the integral, is a triangle wave centred on zero.
    Before that it has no torque: y for a third of a period; z for a sixth, and then with the sign reversed, which
    equals the wave delayed by two thirds.

    Args:
        time: (N,) s.
        period: s.
        horizon: unused; the wave has no end.

    Returns:
        (N, 3) torque on the body axes, in multiples of the amplitude.
    """
    since = time[:, None] - period * np.array([0.0, 1.0 / 3.0, 1.0 / 6.0])
    rising = np.mod(since / period + 0.25, 1.0) < 0.5
    return np.where(since < 0.0, 0.0, np.where(rising, 1.0, -1.0)) * np.array([1.0, 1.0, -1.0])


class ScriptedPolicy:
    """Open-loop player of a signal: of body torque, or of body rate where actions are rates.

    Args:
        name: its name in tables.
        signal: (time (N,), horizon=T) -> (N, 3) on the body axes.
        amplitude: body torque for a signal of 1, as a fraction of the weakest wheel's torque limit, or body rate as a
            fraction of its limit; actions are cut to their limits.

    Raises:
        ValueError: the amplitude is not positive.
    """

    kind: Kind = "scripted"

    def __init__(self, name: str, signal: Signal, amplitude: float) -> None:
        self.name = name
        self.signal = signal
        self.amplitude = check_number("amplitude", amplitude, strict=True)

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Compute the script: its value at the start of each decision is held until the end."""
        scenario, wheels = mission.scenario, mission.satellite.wheels
        time = scenario.decision_period * np.arange(scenario.decisions)
        script = self.amplitude * self.signal(time, horizon=scenario.horizon)
        if mission.control == "torque":
            script = wheel_torque(wheels.max_torque.min() * script, wheels) / wheels.max_torque
        self._script = np.clip(script, -1.0, 1.0)
        self._decision = 0

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, n) of the present decision, the same for all episodes."""
        action = self._script[self._decision]
        self._decision += 1
        return np.broadcast_to(action, (len(observation), len(action)))
