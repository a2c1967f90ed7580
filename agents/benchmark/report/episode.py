"""One episode of the comparison in full, flown by every policy: any two of them can be seen side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from agents.benchmark.report.curves import rounded
from agents.benchmark.summary.ranking import inside
from baselines.studies.recording import Recording, record
from satid_gym.estimators.inertia import inertia_tensors
from satid_gym.laws import InertiaLaw
from satid_gym.metrics import relative_error
from satid_gym.policy import Policy
from satid_gym.profiles import PROFILES
from satid_gym.rendering.scene import box
from satid_gym.resolution import resolve_satellites
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario
from satid_gym.selection import label
from satid_gym.vector import SatInertiaIDVectorEnv

Record = Mapping[str, Any]

_CELL = ("microsat", "step")  # flown where the comparison has it: middle of the three, and the law with an event
_INTERVAL = 0.5  # s between two instants that are kept


def episode_cell(satellites: Sequence[str], modes: Sequence[str]) -> tuple[str, str]:
    """Names of the satellite and of the inertia mode whose first seed is shown."""
    satellite, mode = _CELL
    return satellite if satellite in satellites else satellites[0], mode if mode in modes else modes[0]


def shown_policies(records: Sequence[Record]) -> list[str]:
    """Names of the policies to show first, of the records of one cell: the best scripted, and the best learned.

    Who does not keep to the envelope is best only where no other of its kind does. Where no learned policy flew, the
    best closed loop stands in for it. Where only one of the two sides flew, it is shown alone; where neither did, the
    best of all is.
    """
    kinds = {kind: [r for r in records if r["kind"] == kind] for kind in ("learned", "closed_loop")}
    scripted = [r for r in records if r["policy"] in PROFILES]
    groups = [group for group in (scripted, kinds["learned"] or kinds["closed_loop"]) if group] or [[*records]]
    return [min(inside(group), key=lambda r: r["final_error_mean"])["policy"] for group in groups]


def fly_episode(
    policies: Sequence[Policy],
    *,
    satellite: str | Satellite,
    mode: str | InertiaLaw,
    seed: int,
    scenario: Scenario,
    control: str = "torque",
    shown: Sequence[str] = (),
) -> dict[str, Any]:
    """Fly the episode of a seed with each policy; plain values, SI units, body frame unless said otherwise.

    Args:
        policies: who flies it.
        satellite, mode, seed, scenario: which episode.
        control: what actions are.
        shown: names of the one or two policies that are seen first; the first of `policies` where none is named.

    Returns:
        Limits, size and wheels of the satellite; `shown`; `time` (T,) and the moments of `inertia` (3, T), the same
        for all; and `flights`: of each policy, series of `error` (T,), `estimate` and `sigma` (3, T) of the moments,
        `rate` (3, T), `wheel_speed` (n, T), `momentum` (3, T) and `attitude` (4, T), body to inertial, scalar last.
        A flight that is terminated ends there: its series are shorter than `time`.
    """
    flown, world = _data_sheet(satellite, mode, seed, scenario)
    operated = scenario.operate(flown)
    size = box(operated)[0] if operated.size is None else operated.size
    ends = scenario.termination_factor * operated.rate_limit
    flights: list[dict[str, Any]] = []
    common: dict[str, Any] = {"time": [], "inertia": []}
    for policy in policies:
        recording = record(policy, satellite=flown, inertia=mode, seeds=[seed], scenario=world, control=control)
        kept = _kept(recording, ends)
        flights.append({"policy": policy.name, "kind": policy.kind, **_series(recording, kept)})
        if len(flights[-1]["error"]) > len(common["time"]):  # the longest flight has seen most of the truth
            moments = np.diagonal(recording.motion.inertia[0], axis1=1, axis2=2)
            common = {"time": rounded(recording.dt * kept, 6), "inertia": _rows(moments[kept], 6)}
    return {
        "satellite": operated.name,
        "inertia_mode": label(mode),
        "seed": seed,
        "horizon": scenario.horizon,
        "size": size.tolist(),
        "rate_limit": operated.rate_limit,
        "wheel_axes": operated.wheels.axes.T.tolist(),
        "wheel_speed_limit": operated.wheels.max_speed.tolist(),
        "shown": list(shown) or [policies[0].name],
        **common,
        "flights": flights,
    }


def _data_sheet(
    satellite: str | Satellite, mode: str | InertiaLaw, seed: int, scenario: Scenario
) -> tuple[Satellite, Scenario]:
    """The satellite with the panels or the tank that the seed draws, and the scenario that adds no others."""
    (nominal,) = resolve_satellites(satellite)
    if scenario.appendages is None:
        return nominal, scenario
    env = SatInertiaIDVectorEnv(1, satellite=nominal, inertia=mode, scenario=scenario, num_threads=1)
    env.reset(seed=seed)
    (drawn,) = env.satellite_index
    env.close()
    return env.problem.satellites[drawn], scenario.replace(appendages=None)


def _kept(recording: Recording, termination_rate: float) -> np.ndarray:
    """Places of the instants that are kept, up to the termination."""
    rate = recording.motion.rate[0]
    over = np.flatnonzero(np.abs(rate).max(axis=1) > termination_rate)
    end = int(over[0]) + 1 if len(over) else len(rate)
    return np.arange(0, end, max(1, round(_INTERVAL / recording.dt)))


def _series(recording: Recording, kept: np.ndarray) -> dict[str, Any]:
    motion = recording.motion
    estimate, truth = inertia_tensors(recording.theta[0, kept]), motion.inertia[0, kept]
    moments = np.arange(3)  # the page draws these; of products of inertia only the error tells
    error = relative_error(estimate, truth)
    sigma = np.sqrt(np.diagonal(recording.covariance[0, kept, :3, :3], axis1=1, axis2=2))
    return {
        "error": rounded(error, 4),
        "estimate": _rows(estimate[:, moments, moments], 6),
        "sigma": _rows(sigma),
        "rate": _rows(motion.rate[0, kept], 4),
        "wheel_speed": _rows(motion.wheel_speed[0, kept]),
        "momentum": _rows(motion.momentum[0, kept]),
        "attitude": _rows(recording.attitude[0, kept], 4),
    }


def _rows(series: np.ndarray, digits: int = 3) -> list[list[float]]:
    """A series (T, k) as k lists of T numbers."""
    return [rounded(column, digits) for column in series.T]
