"""Log of a flight: every reading of gyro and tachometers, as a CSV file that `satid identify` reads."""

from __future__ import annotations

import io

import numpy as np

from satid_gym.env import SatInertiaIDEnv
from satid_gym.fleet import Fleet


class FlightLog:
    """Readings of the episodes of an environment; made before its first reset.

    Args:
        env: the environment, whose fleet keeps every sample from now on.
    """

    def __init__(self, env: SatInertiaIDEnv) -> None:
        env.fleet = Fleet(env.problem, 1, log=True)
        self._env, self._rows = env, list[np.ndarray]()

    def begin(self) -> None:
        """Keep the first readings of an episode, and forget those before."""
        plant = self._env.fleet.rows.plants[0]
        self._rows = [np.concatenate([[0.0], plant["gyro"], plant["tachometer"]])[None]]

    def note(self) -> None:
        """Keep the readings of the last decision."""
        samples = self._env.fleet.rows.logs[0]
        self._rows.append(np.column_stack([samples["time"], samples["gyro"], samples["tachometer"]]))

    def csv(self) -> str:
        """One row a sample: time, gyro and wheel speeds, with their units in the header."""
        table = np.concatenate(self._rows)
        head = ["time [s]", *(f"gyro_{axis} [rad/s]" for axis in "xyz")]
        head += [f"wheel_{k} [rad/s]" for k in range(1, table.shape[1] - 3)]
        out = io.StringIO()
        np.savetxt(out, table, fmt="%.10g", delimiter=",", header=",".join(head), comments="")
        return out.getvalue()
