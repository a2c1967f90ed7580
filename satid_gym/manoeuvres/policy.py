"""Player of a manoeuvre: a policy for the environment, `Pilot` and `satid fly`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Self

import numpy as np

from satid_gym.config import real_array
from satid_gym.files import DamagedFileError, read_json
from satid_gym.manoeuvres.waves import Manoeuvre
from satid_gym.policy import Kind, Mission

_REMEDY = "satid design writes it"
_SAME = 1e-6  # s, within which two periods are


class ManoeuvrePolicy:
    """Commands a manoeuvre's rates under control "rate", its torques as they stand under "torque", then nothing.

    Args:
        manoeuvre: what to fly.
    """

    name = "manoeuvre"
    kind: Kind = "scripted"

    def __init__(self, manoeuvre: Manoeuvre) -> None:
        self.manoeuvre = manoeuvre

    @classmethod
    def read(cls, path: Path) -> Self:
        """Player of the manoeuvre of a design.json.

        Raises:
            DamagedFileError: there is no such file, or it holds no manoeuvre.
        """
        kept = read_json(path, _REMEDY, keys=["manoeuvre"])["manoeuvre"]
        try:
            time = real_array("time_s", kept["time_s"])
            return cls(
                Manoeuvre(
                    time=time,
                    rate=real_array("rate_rad_per_s", kept["rate_rad_per_s"], (len(time), 3)),
                    torque=real_array("torque_Nm", kept["torque_Nm"]),
                    attitude=real_array("attitude", kept["attitude"], (len(time), 4)),
                )
            )
        except (KeyError, TypeError, ValueError) as error:
            raise DamagedFileError(f"{path} holds no manoeuvre ({error}): {_REMEDY}") from error

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare the commands.

        Raises:
            ValueError: the manoeuvre is for another number of wheels or another decision period.
        """
        plan, satellite, period = self.manoeuvre, mission.satellite, mission.scenario.decision_period
        if plan.torque.shape != (len(plan.time), satellite.wheels.count):
            raise ValueError(
                f"the manoeuvre is for {plan.torque.shape[1]} wheels, and {satellite.name} has "
                f"{satellite.wheels.count}: design one for it"
            )
        if np.abs(np.diff(plan.time) - period).max(initial=0.0) > _SAME:
            raise ValueError(
                f"the manoeuvre commands every {plan.time[1] - plan.time[0]:g} s, and the scenario decides every "
                f"{period:g} s: design one for it"
            )
        rates = mission.control == "rate"
        script = plan.rate / satellite.rate_limit if rates else plan.torque / satellite.wheels.max_torque
        self._script = np.clip(script, -1.0, 1.0)
        self._decision = 0

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, actions) of the present decision, the same for all episodes."""
        over = self._decision >= len(self._script)
        action = np.zeros_like(self._script[0]) if over else self._script[self._decision]
        self._decision += 1
        return np.broadcast_to(action, (len(observation), len(action)))
