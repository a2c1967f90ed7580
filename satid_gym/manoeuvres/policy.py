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
from satid_gym.satellite import Satellite

_REMEDY = "satid design writes it"
_SAME = 1e-6  # s, within which two periods are
_OTHER_INERTIA = 0.5  # of a moment: change of the data sheet beyond which it is another satellite's
_OTHER_AXIS = 0.02  # change of a wheel's unit vector, likewise


class ManoeuvrePolicy:
    """Commands a manoeuvre's rates under control "rate", its torques as they stand under "torque", then nothing.

    Args:
        manoeuvre: what to fly.
        control: what it was designed for, and no other control then flies it; None: any.
        sheet: data sheet that it was designed for, and no satellite of much other inertia then flies it; None: any.
    """

    name = "manoeuvre"
    kind: Kind = "scripted"

    def __init__(self, manoeuvre: Manoeuvre, control: str | None = None, sheet: Satellite | None = None) -> None:
        self.manoeuvre, self.control, self.sheet = manoeuvre, control, sheet

    @classmethod
    def read(cls, path: Path) -> Self:
        """Player of the manoeuvre of a design.json; old ones without a data sheet are for any satellite.

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
                raise ValueError("time_s does not increase in steps of decision_period_s")
            sheet = Satellite.from_dict(whole["satellite"]) if "satellite" in whole else None
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise DamagedFileError(f"{path} holds no manoeuvre ({error}): {_REMEDY}") from error
        return cls(plan, whole["control"], sheet)

    def doubt(self, satellite: Satellite) -> str:
        """What differs in a satellite's data sheet from the one that it was designed for, in a line; "" for nothing."""
        if self.sheet is None:
            return ""
        designed, flown = self.sheet.to_dict(), satellite.to_dict()
        changes = ", ".join(name for name, value in flown.items() if value != designed[name])
        return f"designed for another data sheet of {satellite.name}; here differ: {changes}" if changes else ""

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Prepare the commands.

        Raises:
            ValueError: the manoeuvre is for another number of wheels, satellite, decision period or control, goes
                beyond the satellite's limits, or is longer than the flight.
        """
        plan, satellite, world = self.manoeuvre, mission.satellite, mission.scenario
        if plan.torque.shape[1] != satellite.wheels.count:
            raise ValueError(
                f"the manoeuvre is for {plan.torque.shape[1]} wheels, and {satellite.name} has "
                f"{satellite.wheels.count}: design one for it"
            )
        if self.sheet is not None:
            _check_alike(self.sheet, satellite)
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


def _check_alike(designed: Satellite, flown: Satellite) -> None:
    """Check that a satellite is near the one of a manoeuvre's data sheet.

    Raises:
        ValueError: its inertia or wheel axes are of another satellite.
    """
    moments = np.diag(designed.inertia)
    change = np.abs(flown.inertia - designed.inertia) / np.sqrt(np.outer(moments, moments))
    if change.max() > _OTHER_INERTIA:
        sizes = [" ".join(f"{moment:.4g}" for moment in np.diag(one.inertia)) for one in (designed, flown)]
        raise ValueError(
            f"the manoeuvre was designed for {designed.name} with moments of inertia of {sizes[0]} kg m^2, and "
            f"{flown.name} has {sizes[1]}: design one for it"
        )
    if np.abs(flown.wheels.axes - designed.wheels.axes).max() > _OTHER_AXIS:
        raise ValueError(
            f"the manoeuvre was designed for the wheel axes of {designed.name}, and those of {flown.name} are others: "
            "design one for it"
        )
