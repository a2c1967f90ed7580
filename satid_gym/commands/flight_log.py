"""Log of a flight: every reading of gyro, tachometers and star tracker, as a CSV file that `satid identify` reads."""

from __future__ import annotations

import numpy as np

from satid_gym.env import SatInertiaIDEnv
from satid_gym.fleet import Fleet
from satid_gym.policy import only_mission


class FlightLog:
    """Readings of the episodes of an environment; made before its first reset.

    Args:
        env: the environment, whose fleet keeps every sample from now on.
    """

    def __init__(self, env: SatInertiaIDEnv) -> None:
        env.fleet = Fleet(env.problem, 1, log=True)
        self._env, self._rows = env, list[np.ndarray]()
        tracked = only_mission(env.problem).prior.sensors.star_tracker is not None
        self._channels = ("gyro", "tachometer", *(("star_tracker",) if tracked else ()))

    def begin(self) -> None:
        """Keep the first readings of an episode, and forget those before."""
        plant = self._env.fleet.rows.plants[0]
        first = {"gyro": plant["gyro"], "tachometer": plant["tachometer"], "star_tracker": plant["tracker"]["reading"]}
        self._rows = [np.concatenate([[0.0], *(first[name] for name in self._channels)])[None]]

    def note(self) -> None:
        """Keep the readings of the last decision."""
        samples = self._env.fleet.rows.logs[0]
        self._rows.append(np.column_stack([samples[name] for name in ("time", *self._channels)]))

    def csv(self) -> str:
        """One row a sample: time, gyro, wheel speeds, with their units in the header, and the star tracker's attitude.

        Quaternions rotate from body to inertial. A cell is empty where there is no reading.
        """
        wheels = range(1, self._env.problem.wheels + 1)
        head = ["time [s]", *(f"gyro_{axis} [rad/s]" for axis in "xyz"), *(f"wheel_{k} [rad/s]" for k in wheels)]
        if "star_tracker" in self._channels:
            head += [f"q{part}" for part in "xyzw"]
        table = np.concatenate(self._rows)
        lines = [",".join("" if np.isnan(cell) else f"{cell:.10g}" for cell in row) for row in table]
        return "\n".join([",".join(head), *lines]) + "\n"
