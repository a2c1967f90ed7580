"""Open-loop D-optimal excitation by a torque script, designed before the flight for the nominal satellite.

A plan gives the time for which each axis keeps its rate between reversals. The nominal satellite and its wheels start
at rest, so the total momentum is zero, there is no gyroscopic torque, and rates follow from torque axis by axis.
`python -m baselines.tuning.open_loop_design` finds the plans and writes them to open_loop_optimal.json.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from satid_gym.config import check_number
from satid_gym.files import DamagedFileError, read_json
from satid_gym.policy import Kind, Mission
from satid_gym.profiles import wheel_torque
from satid_gym.satellite import Satellite

DESIGNS = Path(__file__).with_name("open_loop_optimal.json")
PREPARED_AS = {"faults": "default"}  # scenarios flown with the settings of another: faults are not known in advance
_USABLE = 0.95  # share of torque and of wheel momentum that a plan uses


def planned_rates(
    dwell: np.ndarray, satellite: Satellite, fraction: float, decisions: int, period: float
) -> np.ndarray:
    """Body rates (..., decisions + 1, 3) of plans, rad/s, at the decisions' edges and linear between.

    Args:
        dwell: (..., 3, K) decisions between the reversals of an axis's rate; after the last it keeps its sign.
        satellite: nominal, with its limits.
        fraction: share of the rate limit aimed at; less if the wheels cannot store the momentum.
        decisions: number of decisions.
        period: duration of a decision, s.
    """
    wheels, inertia = satellite.wheels, np.abs(satellite.inertia)
    strength = 1.0 / np.abs(np.linalg.pinv(wheels.axes)).sum(axis=1).max()  # torque on all axes per wheel torque
    stored = _USABLE * strength * wheels.max_momentum.min() / inertia.sum(axis=0)
    slew = _USABLE * strength * wheels.max_torque.min() * period / inertia.sum(axis=0)
    cap = np.minimum(fraction * satellite.rate_limit, stored)
    edges = np.cumsum(dwell, axis=-1)
    rates = np.zeros((*dwell.shape[:-2], decisions + 1, 3))
    for d in range(decisions):
        side = 1.0 - 2.0 * np.mod((edges <= d).sum(axis=-1), 2)
        rates[..., d + 1, :] = rates[..., d, :] + np.clip(side * cap - rates[..., d, :], -slew, slew)
    return rates


class OpenLoopOptimalPolicy:
    """Open-loop player of the script designed for the satellite and scenario.

    Args:
        dwell: plan, see `planned_rates`, rows of any length; None for the stored one.
        fraction: share of the rate limit aimed at; None for the stored one.

    Raises:
        ValueError: the fraction is not within (0, 1].
    """

    name = "open_loop_optimal"
    kind: Kind = "scripted"

    def __init__(self, dwell: Sequence[Sequence[int]] | None = None, fraction: float | None = None) -> None:
        self.dwell = dwell
        self.fraction = None if fraction is None else check_number("fraction", fraction, strict=True, high=1.0)

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        """Compute the script.

        Raises:
            ValueError: there is no design for the satellite in the scenario.
        """
        satellite, period = mission.satellite, mission.scenario.decision_period
        dwell, fraction = self.dwell, self.fraction
        if dwell is None or fraction is None:
            design = design_of(satellite.name, mission.scenario.name)
            dwell, fraction = dwell or design["dwell"], fraction or design["fraction"]
        rates = planned_rates(_pad(dwell), satellite, fraction, mission.scenario.decisions, period)
        self._decision = 0
        if mission.control == "rate":
            self._script = rates[1:] / satellite.rate_limit
            return
        J_free = satellite.inertia - satellite.wheels.rotor_inertia
        torque = wheel_torque(np.diff(rates, axis=0) @ J_free / period, satellite.wheels)
        self._script = np.clip(torque / satellite.wheels.max_torque, -1.0, 1.0)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Action (N, actions) of the present decision, the same for all episodes."""
        action = self._script[self._decision]
        self._decision += 1
        return np.broadcast_to(action, (len(observation), len(action)))


class NotPreparedError(ValueError):
    """A baseline has no settings for a satellite in a scenario."""


def design_of(satellite: str, scenario: str, designs: Path = DESIGNS) -> dict[str, Any]:
    """Stored design of a satellite in a scenario; designs missing in the file are taken from the shipped one.

    Raises:
        NotPreparedError: no design is stored.
    """
    scenario = PREPARED_AS.get(scenario, scenario)
    for file in (designs, DESIGNS):
        found = entries_of(file, "baselines.tuning.open_loop_design").get(
            (OpenLoopOptimalPolicy.name, satellite, scenario)
        )
        if found is not None:
            return found
    known = sorted(
        key[1:] for file in (designs, DESIGNS) for key in entries_of(file, "baselines.tuning.open_loop_design")
    )
    raise NotPreparedError(
        f"no open-loop design for satellite {satellite!r} in scenario {scenario!r}, only for {known}; "
        "python -m baselines.tuning.open_loop_design finds them"
    )


def entries_of(file: Path, command: str) -> dict[tuple[str, str, str], dict[str, Any]]:
    """Entries of a file of settings by policy, satellite and scenario.

    Args:
        file: the file.
        command: command that writes such files.

    Raises:
        DamagedFileError: it is missing or has another content.
    """
    # the time of change is part of the key, because the file may be written while the process runs
    return _entries(file, command, file.stat().st_mtime_ns if file.is_file() else 0)


@functools.cache
def _entries(file: Path, command: str, _: int) -> dict[tuple[str, str, str], dict[str, Any]]:
    remedy = f"python -m {command} writes it"
    entries = read_json(file, remedy, keys=["entries"])["entries"]
    default = OpenLoopOptimalPolicy.name if command == "baselines.tuning.open_loop_design" else None
    try:
        return {(entry.get("policy", default), entry["satellite"], entry["scenario"]): entry for entry in entries}
    except (TypeError, KeyError, AttributeError) as error:
        raise DamagedFileError(f"{file} holds no settings of baselines ({error!r}): {remedy}") from error


def _pad(dwell: Sequence[Sequence[int]]) -> np.ndarray:
    """Array (3, K) of rows of different lengths, padded with infinity: no further reversal."""
    longest = max(map(len, dwell))
    return np.array([[*row, *[np.inf] * (longest - len(row))] for row in dwell])
