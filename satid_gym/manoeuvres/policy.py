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
        control: what it was designed for, and no other control then flies it; None: any.
    """

    name = "manoeuvre"
    kind: Kind = "scripted"

    def __init__(self, manoeuvre: Manoeuvre, control: str | None = None) -> None:
        self.manoeuvre, self.control = manoeuvre, control

    @classmethod
    def read(cls, path: Path) -> Self:
        """Player of the manoeuvre of a design.json.

        Raises:
            DamagedFileError: there is no such file, or it holds no manoeuvre.
        """
        whole = read_json(path, _REMEDY, keys=["manoeuvre", "control"])
        kept = whole["manoeuvre"]
        try:
            time = real_array("time_s", kept["time_s"])
            wheels = len(kept["torque_Nm"][0])
            plan = Manoeuvre(
                time=real_array("time_s", kept["decision_period_s"] * np.arange(len(time)), time.shape),
                rate=real_array("rate_rad_per_s", kept["rate_rad_per_s"], (len(time), 3)),
                torque=real_array("torque_Nm", kept["torque_Nm"], (len(time), wheels)),
                attitude=real_array("attitude", kept["attitude"], (len(time), 4)),
            )
            if np.abs(plan.time - time).max() > _SAME:
                raise ValueError("time_s does not go by decision_period_s")
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise DamagedFileError(f"{path} holds no manoeuvre ({error}): {_REMEDY}") from error
        return cls(plan, whole["control"])

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare the commands.

        Raises:
            ValueError: the manoeuvre is for another number of wheels, decision period or control, goes beyond the
                satellite's limits, or is longer than the flight.
        """
        plan, satellite, world = self.manoeuvre, mission.satellite, mission.scenario
        if plan.torque.shape[1] != satellite.wheels.count:
            raise ValueError(
                f"the manoeuvre is for {plan.torque.shape[1]} wheels, and {satellite.name} has "
                f"{satellite.wheels.count}: design one for it"
            )
        if len(plan.time) > 1 and abs(plan.time[1] - plan.time[0] - world.decision_period) > _SAME:
            raise ValueError(
                f"the manoeuvre commands every {plan.time[1] - plan.time[0]:g} s, and the scenario decides every "
                f"{world.decision_period:g} s: design one for it"
            )
        if self.control not in (None, mission.control):
            raise ValueError(
                f"the manoeuvre was designed for control {self.control!r}, and this is {mission.control!r}: give "
                f"control {self.control!r}, or design one for the other"
            )
        if len(plan.time) > world.decisions:
            raise ValueError(
                f"the manoeuvre takes {len(plan.time) * world.decision_period:g} s, and the flight ends at "
                f"{world.horizon:g} s, before it is at rest: give a scenario with a longer horizon"
            )
        rates = mission.control == "rate"
        script = plan.rate / satellite.rate_limit if rates else plan.torque / satellite.wheels.max_torque
        if (most := float(np.abs(script).max())) > 1.0 + _SAME:
            raise ValueError(
                f"the manoeuvre commands {most:.3g} times the {'rate' if rates else 'torque'} limit of "
                f"{satellite.name}: design one for it"
            )
        self._script = np.clip(script, -1.0, 1.0)
        self._decision = 0

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, actions) of the present decision, the same for all episodes."""
        over = self._decision >= len(self._script)
        action = np.zeros_like(self._script[0]) if over else self._script[self._decision]
        self._decision += 1
        return np.broadcast_to(action, (len(observation), len(action)))
