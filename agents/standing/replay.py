"""Replay of a scenario's first cell: the best hand-built policy and the best other, in full, for the page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from agents.benchmark.report.curves import rounded
from agents.standing.summary import Row
from agents.standing.tasks import ORACLE, Task
from baselines.scenarios.flights import Cell
from satid_gym.policy import Policy, observation_settings, only_mission, show_filter
from satid_gym.rendering.scene import box
from satid_gym.scenario_catalogue import SCENARIOS
from satid_gym.star_tracker import earth_angle
from satid_gym.vector import SatInertiaIDVectorEnv

_BY_HAND, _BESIDE = ("law", "scripted"), ("learned", "planner")  # rungs, in the order in which they are asked


def pair(steps: Sequence[Row]) -> list[str]:
    """Names of two policies to show, of a ladder: the better of those built by hand, and of what learns or plans."""
    chosen = []
    for rungs in (_BY_HAND, _BESIDE):
        able = [s for s in steps if s["rung"] in rungs and s["expected"] is not None]
        if able:
            chosen.append(min(able, key=lambda s: (s["cells"] - s["inside"], s["expected"]))["policy"])
    return chosen or [step["policy"] for step in steps if step["rung"] != ORACLE][:1]


def replay(cell: Cell, tasks: Sequence[Task], steps: Sequence[Row], seed: int) -> dict[str, Any]:
    """One episode flown by two policies of a scenario, as the page draws it; SI units, body frame unless said.

    Args:
        cell, seed: which episode.
        tasks: of the table, which have the policies.
        steps: ladder of the scenario.

    Returns:
        As of `agents.benchmark.report.episode.fly_episode`, and `sky`: what the star tracker and the payload see. Each
        flight has `tracks` (T,) and `missed` (T,) too, and `deflection` (c, T) of modes over their limits. A flight
        that ends early is shorter than `time`, which is that of the longest.
    """
    known = {task.name: task for task in tasks if task.cell == cell}
    flights: list[dict[str, Any]] = []
    common: dict[str, Any] = {"time": []}
    for name in pair(steps):
        task = known[name]
        assert task.policy is not None
        series, own = _fly(cell, task.policy, seed)
        flights.append({"policy": name, "kind": task.kind, **series})
        if len(own["time"]) > len(common["time"]):  # the longest flight has seen most of the truth
            common = own
    return {
        **common,
        "satellite": cell.satellite,
        "inertia_mode": cell.inertia,
        "seed": seed,
        "shown": [flight["policy"] for flight in flights],
        "flights": flights,
    }


def _fly(cell: Cell, policy: Policy, seed: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Series of a flight, and what is the same for all."""
    env = SatInertiaIDVectorEnv(
        1, cell.satellite, cell.inertia, cell.scenario, control="rate", num_threads=1, **observation_settings(policy)
    )
    mission = only_mission(env.problem)
    policy.reset(mission, [seed])
    observation, _ = env.reset(seed=[seed])
    rows, world = env.fleet.rows, env.problem.scenario
    kept = [_state(rows)]
    for _ in range(world.decisions):
        show_filter(policy, rows.beliefs, rows.tasks)
        observation, _, ended, _, info = env.step(policy(observation))
        kept.append({**_state(rows), "missed": float(info["costs"]["window"][0])})
        if ended[0]:
            break
    env.close()
    series = {name: np.array([state[name] for state in kept]) for name in kept[0]}
    moving = ("estimate", "sigma", "rate", "wheel_speed", "momentum", "attitude", "deflection")
    flight: dict[str, Any] = {name: [rounded(column, 4) for column in series[name].T] for name in moving}
    flight |= {name: rounded(series[name], 4) for name in ("error", "tracks", "missed")}
    satellite = mission.satellite
    size = box(satellite)[0] if satellite.size is None else satellite.size
    common = {
        "horizon": world.horizon,
        "size": size.tolist(),
        "rate_limit": satellite.rate_limit,
        "wheel_axes": satellite.wheels.axes.T.tolist(),
        "wheel_speed_limit": satellite.wheels.max_speed.tolist(),
        "time": (world.decision_period * np.arange(len(kept))).tolist(),
        "inertia": [rounded(column, 6) for column in series["truth"].T],
        "sky": _sky(cell.scenario, series),
    }
    return flight, common


def _state(rows: Any) -> dict[str, Any]:
    """Truth and belief at present."""
    plant, belief, report, task = (getattr(rows, part)[0] for part in ("plants", "beliefs", "reports", "tasks"))
    moments = belief["mean"][3:6]
    variance = np.diag(belief["covariance"])[3:6] + belief["scale_variance"] * np.square(moments)
    limit = np.atleast_1d(task["deflection_limit"])
    deflection = np.atleast_1d(plant["oscillators"]["deflection"])
    over_limit = deflection / limit if len(limit) == len(deflection) else np.zeros(0)
    tracker, own = plant["tracker"], plant["operations"]
    return {
        **{name: plant[name].copy() for name in ("attitude", "momentum", "rate", "wheel_speed")},
        "truth": np.diag(report["inertia_true"]).copy(),
        "estimate": moments.copy(),
        "sigma": np.sqrt(variance),
        "error": float(report["relative_error"]),
        "deflection": over_limit,
        "tracks": float(tracker["tracks"]),
        "sun": tracker["sun"].copy(),
        "target": own["target"].copy(),
        "window": np.array([own["opens"], own["closes"]]),
        "missed": 0.0,
    }


def _sky(scenario: str, series: dict[str, np.ndarray]) -> dict[str, Any] | None:
    """What star tracker and payload look at, directions in the inertial frame; None where there is neither."""
    world = SCENARIOS[scenario]
    tracker = None if world.sensors is None else world.sensors.star_tracker
    if tracker is None and world.operations is None:
        return None
    sky: dict[str, Any] = {"sun": rounded(series["sun"][-1], 5), "orbit_rate": world.orbit_rate}
    if tracker is not None:
        limb = earth_angle(world.orbit_rate)
        sky["tracker"] = {
            "boresight": tracker.boresight.tolist(),
            "sun": tracker.sun_exclusion,
            "earth": None if tracker.earth_exclusion is None else limb + tracker.earth_exclusion,
            "limb": limb,
        }
    if world.operations is not None:
        sky["payload"] = {
            "boresight": world.operations.boresight.tolist(),
            "keep_out": world.operations.keep_out,
            "target": [rounded(row, 4) for row in series["target"]],
            "window": [rounded(row, 5) for row in series["window"]],
        }
    return sky
