"""Log of a flight: every reading of gyro, tachometers and star tracker, as a CSV file that `satid identify` reads."""

from __future__ import annotations

import numpy as np

from satid_gym.env import SatInertiaIDEnv
from satid_gym.fleet import Fleet
from satid_gym.policy import only_mission

_CHANNELS = ("time", "gyro", "tachometer", "star_tracker")


class FlightLog:
    """Readings of the episodes of an environment; made before its first reset.

    Args:
        env: the environment, whose fleet keeps every sample from now on.
    """

    def __init__(self, env: SatInertiaIDEnv) -> None:
        env.fleet = Fleet(env.problem, 1, log=True)
        self._env, self._rows = env, list[np.ndarray]()
        self._tracked = only_mission(env.problem).prior.sensors.star_tracker is not None

    def begin(self) -> None:
        """Keep the first readings of an episode, and forget those before."""
        plant = self._env.fleet.rows.plants[0]
        tracker = plant["tracker"]
        seen = tracker["reading"] if tracker["fresh"] else np.full(4, np.nan)
        self._rows = [np.concatenate([[0.0], plant["gyro"], plant["tachometer"], seen])[None]]

    def note(self) -> None:
        """Keep the readings of the last decision."""
        samples = self._env.fleet.rows.logs[0]
        self._rows.append(np.column_stack([samples[name] for name in _CHANNELS]))

    def csv(self) -> str:
        """One row a sample: time, gyro, wheel speeds, with their units in the header, and the star tracker's attitude.

        A cell is empty where there is no reading.
        """
        table = np.concatenate(self._rows)
        head = ["time [s]", *(f"gyro_{axis} [rad/s]" for axis in "xyz")]
        head += [f"wheel_{k} [rad/s]" for k in range(1, table.shape[1] - 7)]
        head += [f"q{part}" for part in "xyzw"]
        columns = len(head) if self._tracked else len(head) - 4
        lines = (",".join("" if np.isnan(cell) else f"{cell:.10g}" for cell in row[:columns]) for row in table)
        return "\n".join([",".join(head[:columns]), *lines]) + "\n"
