"""Flights that the golden data record: worlds, estimators, satellites and laws under fixed actions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from satid_gym import SATELLITES, Tolerances
from tests.flexible import PANELS, TANK
from tests.tolerances import ALL

DATA = Path(__file__).with_name("flights.json")
DECISIONS = 60
MARKS = (1, 5, 20, 45, 60)
SEED = 20_000

CASES: dict[str, dict[str, Any]] = {
    **{
        f"default, {satellite}, {law}": {
            "satellite": satellite,
            "inertia": law,
            "scenario": {"horizon": float(DECISIONS)},
        }
        for satellite in ("cubesat", "microsat", "smallsat")
        for law in ("static", "step", "drift", "periodic")
    },
    "default, any satellite, any law": {"satellite": "random", "inertia": "random"},
    "tight, microsat": {"satellite": "microsat", "scenario": "tight"},
    "tight, smallsat, rate": {"satellite": "smallsat", "scenario": "tight", "estimator": "rate"},
    "paper, cubesat": {"satellite": "cubesat", "inertia": "step", "scenario": "paper"},
    "paper, smallsat, momentum": {"satellite": "smallsat", "scenario": "paper", "estimator": "momentum"},
    "default, microsat, rate": {"satellite": "microsat", "inertia": "periodic", "estimator": "rate"},
    "reward trace, net": {
        "satellite": "cubesat",
        "reward": {"criterion": "trace", "net": True, "gain_scale": 0.1, "effort_weight": 0.1},
    },
    "reward maxeig, held": {
        "satellite": "microsat",
        "reward": {"criterion": "maxeig", "held_scale": 0.01, "gain_scale": 0.1},
    },
    "one walk, microsat": {"satellite": "microsat", "inertia": "step", "estimator": "momentum"},
    **{
        f"{name}, microsat": {
            "satellite": SATELLITES["microsat"].replace(**sheet).to_dict(),
            "inertia": law,
            "scenario": {"horizon": 20.0, **scenario},
        }
        for name, sheet, law, scenario in (
            ("panels", {"oscillators": (PANELS,)}, "static", {}),
            (
                "panels, slosh, integrating gyro",
                {"oscillators": (PANELS, TANK)},
                "step",
                {"sensors": {"gyro_integrates": True}},
            ),
            ("tolerances", {"tolerances": Tolerances(**ALL)}, "step", {}),
            (
                "integrating gyro, late wheels",
                {},
                "step",
                {"sensors": {"gyro_integrates": True, "tachometer_delay": 1.3}},
            ),
            ("encoders", {}, "static", {"sensors": {"gyro_integrates": True, "encoder_pulses": 24}}),
            ("friction", {}, "static", {"friction": {"coulomb": 5e-3, "static": 8e-3, "viscous": 1e-5}}),
            ("deployment", {}, "deployment", {}),
        )
    },
    "rates, friction": {"control": "rate", "scenario": {"friction": {"coulomb": 5e-3, "static": 8e-3}}},
    "rates, flex, body": {"scenario": "flex", "control": "rate", "observation": "body", "inertia": "static"},
    "slosh, smallsat": {"satellite": "smallsat", "scenario": "slosh", "inertia": "step"},
    "rates, calibration, body": {"scenario": "calibration", "control": "rate", "observation": "body"},
    "calibration, smallsat": {"satellite": "smallsat", "scenario": "calibration", "inertia": "static"},
    "rates, operations, body": {"scenario": "operations", "control": "rate", "observation": "body"},
    "operations, cubesat": {"satellite": "cubesat", "scenario": "operations", "inertia": "step"},
    "rates, wheels4": {"scenario": "wheels4", "control": "rate", "inertia": "periodic"},
    "rates, wheels4, cubesat": {"satellite": "cubesat", "scenario": "wheels4", "control": "rate", "inertia": "static"},
}


def actions() -> np.ndarray:
    """(DECISIONS, 3) square waves, each axis a third of a period after the other, and a few that are out of range."""
    time = np.arange(DECISIONS)[:, None] + np.array([0, 4, 8])
    waves = np.where(time // 6 % 2 == 0, 1.0, -1.0) * np.array([0.3, 0.2, 0.25])
    waves[40:43] *= 10.0
    return waves


def fly(case: str) -> dict[str, Any]:
    """One case, as far as it gets: what the environment returned at the marks, and sums over all decisions."""
    env = gymnasium.make("SatInertiaID-v0", disable_env_checker=True, **CASES[case])
    observation, info = env.reset(seed=SEED + list(CASES).index(case))
    marks = [_mark(0, observation, 0.0, info)]
    total = error = 0.0
    decision = 0
    for decision, action in enumerate(actions(), 1):
        observation, reward, terminated, truncated, info = env.step(action)
        total, error = total + float(reward), error + info["relative_error"]
        if decision in MARKS or terminated:
            marks.append(_mark(decision, observation, float(reward), info))
        if terminated or truncated:
            break
    env.close()
    return {"decisions": decision, "terminated": bool(terminated), "reward": total, "error": error, "marks": marks}


def _mark(decision: int, observation: np.ndarray, reward: float, info: dict[str, Any]) -> dict[str, Any]:
    kept = ("relative_error", "nees", "nis", "information_held", "cost", "constrained_updates")
    plain = {key: info[key] for key in kept}
    arrays = {key: info[key].tolist() for key in ("inertia_true", "inertia_estimate", "torque_applied")}
    seen = [float(str(x)) for x in observation]  # as short as float32 allows
    return {"decision": decision, "observation": seen, "reward": reward, **plain, **arrays}
