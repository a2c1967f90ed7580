"""Square waves of rate that keep the wheels out of the speed band that operators avoid.

Where all axes turn together, along one diagonal (+-1, +-1, +-1) of the rate envelope, one of four wheels changes much
and three little. So of the four diagonals, and of the parts of each, the longest is flown along which no wheel comes
near the band or its limit, given the speeds that the wheels would have with the body at rest. A part that does not
contain rest turns the body on and on; it counts for less.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.decoded_observation import Belief, PlantConstants
from satid_gym.control.rate_loop import RateMargin
from satid_gym.policy import Kind, Mission, check_commands_rates

_DIAGONALS = np.array([[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [-1.0, -1.0, 1.0]])
_GRID = np.linspace(-1.0, 1.0, 21)  # of the ends of a part
_OFF_CENTRE = 1.0  # length that a part loses by the sum of its ends
_CROSSING = 1.0  # length that a wheel's way through the band costs
_BETTER = 1.0  # by which another part has to be longer to be worth a change
_ROOMS = (1.0, 0.5, 0.2)  # of the room, that is asked for in turn
_WORN = 0.1  # of the room, at which the present part will not do any longer


class ClearSquarePolicy:
    """Square waves of rate along a diagonal; for control "rate" and wheels whose band is to be avoided.

    Args:
        period: s, of the square wave.
        room: rad/s that a wheel keeps from the band, and from its limit, where a part is chosen.
        margin: see `RateMargin`.

    Raises:
        ValueError: a setting is out of range.
    """

    name = "clear_square"
    kind: Kind = "closed_loop"

    def __init__(self, period: float = 10.0, room: float = 0.0, margin: float = 3.5) -> None:
        self.period = check_number("period", period, strict=True)
        self.room = check_number("room", room)
        self.margin = check_number("margin", margin)

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare for the satellite.

        Raises:
            ValueError: the environment takes torques, or observations leave out the wheels' speeds.
        """
        check_commands_rates(mission, self.name)
        self._constants = PlantConstants.of([mission]).take(np.zeros(1, int))
        self._layout, self._allowed = mission.layout, RateMargin([mission], self.margin)
        self._wheels, self._duration = mission.satellite.wheels, mission.scenario.decision_period
        self._share = np.linalg.pinv(self._wheels.axes)
        self._parts: list[tuple[int, int, int] | None] = [None] * len(seeds)  # diagonal, and its ends on the grid
        self._decision = 0

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, 3)."""
        belief = Belief.read(observation, self._layout, self._constants)
        allowed = self._allowed(observation, np.ones(3))
        most = allowed * self._constants.rate_limit
        high = np.mod((self._decision + 0.5) * self._duration / self.period, 1.0) < 0.5
        self._decision += 1
        action = np.empty((len(observation), 3))
        for i in range(len(observation)):
            diagonal, low_end, high_end = self._parts[i] = self._part(i, belief, most[i])
            action[i] = _GRID[high_end if high else low_end] * _DIAGONALS[diagonal]
        return action * allowed

    def _part(self, i: int, belief: Belief, most: np.ndarray) -> tuple[int, int, int]:
        """Diagonal and ends to fly in episode i."""
        wheels, inertia = self._wheels, belief.inertia[i]
        speed = belief.wheel_momentum[i] / wheels.inertia
        at_rest = speed + self._share @ inertia @ belief.omega[i] / wheels.inertia
        change = (_DIAGONALS * most) @ inertia @ self._share.T / wheels.inertia  # (4, n), from rest to the end
        ends = at_rest - _GRID[None, :, None] * change[:, None, :]  # (4, grid, n)
        clear, side = self._clear(ends), np.sign(ends)
        same = (side[:, :, None] == side[:, None, :]).all(axis=-1)
        room = np.where(same, np.minimum(clear[:, :, None], clear[:, None, :]), -np.inf)
        length = np.broadcast_to(
            _GRID[None, :] - _GRID[:, None] - _OFF_CENTRE * np.abs(_GRID[None, :] + _GRID[:, None]), room.shape
        )
        crossed = (side != np.sign(speed)).sum(axis=-1)
        gain = length - _CROSSING * crossed[:, :, None]
        now = self._parts[i]
        for share in _ROOMS:
            worth = np.where((room >= share * self.room) & (length > 0.0), gain, -np.inf)
            best = tuple(int(k) for k in np.unravel_index(np.argmax(worth), worth.shape))
            if worth[best] > -np.inf:
                break
        else:  # nowhere is there room for a wave: the rate at which the wheels are furthest off
            diagonal, end = (int(k) for k in np.unravel_index(np.argmax(clear), clear.shape))
            return diagonal, end, end
        if now is not None and room[now] >= _WORN * self.room and worth[best] < length[now] + _BETTER:
            return now
        return best[0], best[1], best[2]

    def _clear(self, speed: np.ndarray) -> np.ndarray:
        """Least distance (...) of speeds (..., n) from band and limit, rad/s; negative within or beyond."""
        low, high = self._wheels.avoided_speed
        size = np.abs(speed)
        off = np.where((size < low) & (low > 0.0), low - size, size - high)
        return np.minimum(off, self._wheels.max_speed - size).min(axis=-1)
