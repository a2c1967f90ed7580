"""Family of manoeuvres: waves of body rate from rest to rest.

The rate about an axis is a times a square wave s(t) between 1 and -1, 0 at both ends, averaged over a window W,

    omega(t) = a (S(t + W/2) - S(t - W/2)) / W,    S(t) = integral of s from 0 to t,

so that it reverses in the time W at a constant acceleration, and a mode whose period divides W is left at rest (the
window is the boxcar of Singer and Seering's input shaping, ASME J. Dynamic Systems 112, 1990). W is at least what the
wheels' torque takes.

One that returns is the time reverse of itself, s(T - t) = -s(t): a body that turns back at each instant as it
came is in the end where it began, whatever the order of its turns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from satid_gym.satellite import Satellite

_USED = 0.95  # of what the wheels' torque and momentum give
SIZE = 8  # numbers that a wave is coded by


@dataclass(frozen=True, eq=False, kw_only=True)
class Authority:
    """Control authority of the nominal satellite's wheels about all three axes at once, (3,).

    Attributes:
        acceleration: rad/s^2.
        rate: rad/s, the least of the rate limit, of the rate that the wheels' momentum allows, and of the rate that
            torque reaches.
        reversal: s, longest duration of a reversal.
    """

    acceleration: np.ndarray
    rate: np.ndarray
    reversal: float = np.inf

    @classmethod
    def of(cls, satellite: Satellite, reversal: float = np.inf) -> Authority:
        """Authority of a satellite with its operating limits, for reversals of a given duration, s."""
        wheels, inertia = satellite.wheels, np.abs(satellite.inertia).sum(axis=0)
        strength = _USED / np.abs(np.linalg.pinv(wheels.axes)).sum(axis=1).max()  # torque on all axes per wheel torque
        stored = strength * wheels.max_momentum.min() / inertia
        acceleration = strength * wheels.max_torque.min() / inertia
        reached = np.minimum(stored, 0.5 * acceleration * reversal)
        return cls(acceleration=acceleration, rate=np.minimum(satellite.rate_limit, reached), reversal=reversal)


@dataclass(frozen=True, eq=False, kw_only=True)
class Waves:
    """K waves.

    Attributes:
        period: (K, 1) of the square waves, s.
        window: (K, 3) W about each axis, s.
        amplitude: (K, 3) a about each axis, rad/s.
        phase: (K, 3) of the square waves, in periods.
    """

    period: np.ndarray
    window: np.ndarray
    amplitude: np.ndarray
    phase: np.ndarray

    @classmethod
    def decoded(cls, code: np.ndarray, authority: Authority) -> Waves:
        """Waves of a code (K, SIZE): logarithms of period, of window and of amplitudes over their limits, phases."""
        amplitude = np.exp(np.minimum(code[:, 2:5], 0.0)) * authority.rate
        wanted = np.minimum(np.exp(code[:, [1]]), authority.reversal)
        window = np.maximum(wanted, 2.0 * amplitude / authority.acceleration)
        return cls(period=np.exp(code[:, [0]]), window=window, amplitude=amplitude, phase=code[:, 5:8])

    def rates(self, time: np.ndarray, duration: float, returns: bool) -> np.ndarray:
        """Body rates (K, T, 3) at times (T,), rad/s, of manoeuvres of a duration, s."""
        time, window = np.clip(time, 0.0, duration), self.window[:, None]
        before, after = time[None, :, None] - 0.5 * window, time[None, :, None] + 0.5 * window
        change = self._integral(after, duration, returns) - self._integral(before, duration, returns)
        return self.amplitude[:, None] * change / window

    def _integral(self, time: np.ndarray, duration: float, returns: bool) -> np.ndarray:
        """S at times (K, T, 3), s, but for a constant."""
        edge = np.minimum(0.5 * self.window[:, None], 0.5 * duration)
        if returns:
            time = np.minimum(time, duration - time)
        turns = np.mod(np.clip(time, edge, duration - edge) / self.period[:, None] + self.phase[:, None], 1.0)
        return self.period[:, None] * np.minimum(turns, 1.0 - turns)


@dataclass(frozen=True, eq=False, kw_only=True)
class Manoeuvre:
    """One manoeuvre, decision by decision, body frame.

    Attributes:
        time: (D,) when each decision begins, s.
        rate: (D, 3) body rate to command until the next, rad/s.
        torque: (D, n) motor torque on the wheels that gives it to the nominal satellite at rest, with its wheels at
            rest, N m.
        attitude: (D, 4) of that satellite when the decision begins, from the body frame to its first one, scalar last.
    """

    time: np.ndarray
    rate: np.ndarray
    torque: np.ndarray
    attitude: np.ndarray
