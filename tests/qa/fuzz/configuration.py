"""Random valid configurations, from the ordinary to the extreme; each a function of one `random.Random`.

The source of chance is an argument: seeded for the command line, hypothesis' own, which shrinks, for the tests.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from random import Random
from typing import Any

import numpy as np

Settings = dict[str, Any]

ACTIONS = ("random", "bang_bang", "zero", "extreme", "one_wheel")
TURN_MAX = 2.0  # rad, that body and momentum may turn against each other between two readings


@dataclass(frozen=True, kw_only=True)
class Group:
    """Configurations that share compiled kernels."""

    wheels: int
    parameters: str
    estimator: str

    def __str__(self) -> str:
        return f"{self.wheels} wheels, {self.parameters}, {self.estimator}"


@dataclass(frozen=True, kw_only=True)
class Configuration:
    """What to fly.

    Attributes:
        settings: keyword arguments of `SatInertiaIDEnv`, plain values.
        actions: how actions are chosen; one of `ACTIONS`.
        seed: of the environment and of the actions.
        options: of every reset.
    """

    settings: Settings
    actions: str
    seed: int
    options: Settings


def draw_configuration(chance: Random, group: Group) -> Configuration:
    """A valid configuration of a group."""
    satellite = _satellite(chance, group.wheels)
    scenario = _scenario(chance, satellite)
    if group.parameters == "principal":  # which is refused where there are products of inertia
        satellite["inertia"] = np.diag(np.linalg.eigvalsh(satellite["inertia"])).tolist()
        scenario["tilt_std"] = 0.0
    settings = {
        "satellite": satellite,
        "inertia": _law(chance, scenario),
        "scenario": scenario,
        "estimator": _estimator(chance, group, satellite),
        "reward": _reward(chance),
    }
    options: Settings = {}
    if chance.random() < 0.2:
        options = {"true_inertia": (0.7 + 0.6 * chance.random()) * np.array(satellite["inertia"])}
    return Configuration(
        settings=settings, actions=chance.choice(ACTIONS), seed=chance.randrange(2**32), options=options
    )


def _log(chance: Random, low: float, high: float) -> float:
    return 10.0 ** chance.uniform(math.log10(low), math.log10(high))


def _or(chance: Random, special: Any, value: Any, share: float = 0.3) -> Any:
    return special if chance.random() < share else value


def _rotation(chance: Random) -> np.ndarray:
    q = np.clip([chance.gauss(0.0, 1.0) for _ in range(4)], -5.0, 5.0)  # hypothesis knows no bounds
    x, y, z, w = q / max(np.linalg.norm(q), 1e-9)
    turn = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2.0 * w * turn + 2.0 * turn @ turn


def _moments(chance: Random) -> np.ndarray:
    """Principal moments from second moments, so that a rigid body has them; the mean is 1."""
    kind = chance.choice(("any", "any", "near_ball", "near_axisymmetric", "rod", "plate"))
    spread = [chance.uniform(0.2, 1.0) for _ in range(3)]
    if kind == "near_ball":
        spread = [1.0 + 1e-9 * s for s in spread]
    elif kind == "near_axisymmetric":
        spread[1] = spread[0] * (1.0 + 1e-9)
    elif kind == "rod":
        spread[0] = spread[1] = 1e-3
    elif kind == "plate":
        spread[2] = 1e-3
    moments = np.sum(spread) - np.array(spread)
    return moments / moments.mean()


def _axes(chance: Random, wheels: int) -> np.ndarray:
    """(3, n) unit columns that span; orthogonal first three, or all of them anyhow."""
    if chance.random() < 0.3:
        axes = _rotation(chance) if chance.random() < 0.5 else np.eye(3)
    else:
        axes = np.empty((3, 0))
    while axes.shape[1] < wheels:
        axes = np.column_stack([axes, _rotation(chance)[:, 0]])
        if axes.shape[1] >= 3 and np.linalg.svd(axes[:, :3], compute_uv=False)[-1] < 0.2:
            axes = axes[:, 1:] if axes.shape[1] == 3 else axes
    return axes


def _satellite(chance: Random, wheels: int) -> Settings:
    moments = _log(chance, 1e-3, 1e5) * _moments(chance)
    rotation = _rotation(chance) if chance.random() < 0.5 else np.eye(3)
    inertia = (rotation * moments) @ rotation.T
    axes = _axes(chance, wheels)
    uneven = np.array([chance.uniform(0.5, 1.0) for _ in range(wheels)])
    share = uneven / np.linalg.eigvalsh((axes * uneven) @ axes.T)[-1]
    spin = _log(chance, 1e-6, 0.3) * moments.min() * share
    rate_limit = _log(chance, 1e-3, 0.3)
    torque = rate_limit * moments.mean() / _log(chance, 1.0, 1e3)  # a time to reach the rate limit
    stored = rate_limit * moments.mean() * _log(chance, 0.1, 100.0)
    return {
        "name": "fuzzed",
        "inertia": (0.5 * (inertia + inertia.T)).tolist(),
        "wheels": {
            "axes": axes.tolist(),
            "inertia": spin.tolist(),
            "max_torque": (torque * uneven).tolist(),
            "max_speed": (stored / spin).tolist(),
        },
        "rate_limit": rate_limit,
        "gyro_noise_std": _or(chance, 0.0, rate_limit * _log(chance, 1e-6, 0.1)),
        "tachometer_noise_std": _or(chance, 0.0, float(np.min(stored / spin)) * _log(chance, 1e-6, 1e-2)),
        "disturbance_std": _or(chance, 0.0, torque * _log(chance, 1e-6, 0.1)),
    }


def fastest_turn(satellite: Settings) -> float:
    """Upper bound of nutation and body rate within the wheels' limits, rad/s, for a body of half the inertia."""
    wheels = satellite["wheels"]
    stored = np.abs(wheels["axes"]) @ (np.array(wheels["inertia"]) * np.array(wheels["max_speed"]))
    inertia = np.array(satellite["inertia"])
    return float(np.linalg.norm(stored) / np.linalg.eigvalsh(inertia)[0] * 2.0 + 10.0 * satellite["rate_limit"])


def _scenario(chance: Random, satellite: Settings) -> Settings:
    sample_period = min(_log(chance, 0.01, 12.0), TURN_MAX / fastest_turn(satellite))
    samples, decisions = chance.choice((1, 2, 5, 10)), chance.choice((1, 50, 300, 300, 300, 3000))
    scenario: Settings = {
        "name": "fuzzed",
        "sample_period": sample_period,
        "decision_period": samples * sample_period,
        "horizon": decisions * (samples * sample_period),
        "inertia_std": _or(chance, 0.0, _log(chance, 1e-3, 0.3)),
        "tilt_std": _or(chance, 0.0, _log(chance, 1e-3, 1.0)),
        "prior_std": _log(chance, 1e-3, 2.0),
        "product_std": _log(chance, 1e-3, 1.0),
        "prior_scale": _or(chance, {}, {"*": _log(chance, 0.1, 10.0)}),
        "laws": _ranges(chance),
        "wheel_speed_range": chance.choice((0.0, 0.2, 1.0)),
        "wheel_speed_scale": _or(chance, 1.0, _log(chance, 1e-4, 1.0)),
        "initial_rate_std": _or(chance, 0.0, _log(chance, 1e-3, 1.0)),
        "torque_noise": _or(chance, 0.0, _log(chance, 1e-3, 1.0)),
        "torque_lag": _or(chance, 0.0, _log(chance, 1e-2, 10.0)),
        "gyro_noise_std": _or(chance, None, _or(chance, 0.0, satellite["rate_limit"] * _log(chance, 1e-6, 0.1))),
        "gyro_bias_walk": _or(chance, 0.0, satellite["rate_limit"] * _log(chance, 1e-6, 1e-2)),
        "tachometer_noise_std": _or(chance, None, 0.0, 0.7),
        "disturbance_scale": chance.choice((0.0, 1.0, 10.0)),
        "gravity_gradient": chance.random() < 0.5,
        "solar_pressure": _or(chance, 0.0, _log(chance, 1e-7, 1e-4)),
        "orbit_rate": _or(chance, 0.0, _log(chance, 1e-4, 1e-2)),
        "random_attitude": chance.random() < 0.5,
        "rate_limit": _or(chance, None, satellite["rate_limit"] * chance.uniform(0.5, 2.0), 0.7),
        "termination_factor": _log(chance, 1.0, 10.0),
        "estimator": chance.choice(("momentum", "rate")),
        "faults": _or(chance, {"time": [0.2, 0.6]}, _faults(chance, satellite, samples)),
        "tolerances": _or(chance, {"gyro_bias": 0.0}, _tolerances(chance, satellite), 0.8),
    }
    return scenario


def _tolerances(chance: Random, satellite: Settings) -> Settings:
    """All kinds of errors at once: each set of kinds has a filter of its own to compile."""
    names = ("gyro_scale", "gyro_alignment", "wheel_inertia", "wheel_alignment")
    tolerances = {name: _log(chance, 1e-5, 0.1) for name in names}
    return {"gyro_bias": satellite["rate_limit"] * _log(chance, 1e-4, 1.0), **tolerances}


def _faults(chance: Random, satellite: Settings, samples: int) -> Settings:
    def share() -> float:
        return _or(chance, 0.0, chance.uniform(0.0, 1.0))

    return {
        "time": sorted((chance.uniform(0.0, 1.0), chance.uniform(0.0, 1.0))),
        "gyro_dropout": share(),
        "gyro_dropout_duration": [1.0, chance.uniform(1.0, 50.0)],
        "gyro_dropout_silent": share(),
        "gyro_outlier": 0.1 * share(),
        "gyro_outlier_size": [10.0, _log(chance, 10.0, 1e4)],
        "gyro_bias_std": satellite["rate_limit"] * _or(chance, 0.0, _log(chance, 1e-4, 0.1)),
        "tachometer_stuck": share(),
        "tachometer_stuck_duration": [1.0, chance.uniform(1.0, 50.0)],
        "wheel_loss": share(),
        "wheel_loss_size": [0.0, chance.uniform(0.0, 1.0)],
        "torque_delay": [0, chance.randrange(samples + 1)],
    }


def _ranges(chance: Random) -> Settings:
    def pair(low: float, high: float) -> list[float]:
        return sorted((chance.uniform(low, high), chance.uniform(low, high)))

    return {
        "step_size": pair(-0.5, 2.0),
        "step_time": pair(0.0, 1.0),
        "drift_size": pair(-0.5, 2.0),
        "periodic_size": pair(0.0, 0.5),
        "frequency": pair(0.0, 0.1),
        "phase": pair(-10.0, 10.0),
    }


def _law(chance: Random, scenario: Settings) -> str | Settings:
    kind = chance.choice(("static", "step", "drift", "periodic", "random", "law"))
    if kind != "law":
        return kind
    return {
        "mode": chance.choice(("static", "step", "drift", "periodic")),
        "size": chance.uniform(-0.4, 0.8),
        "time": chance.uniform(0.1, 1.0) * scenario["horizon"],
        "frequency": chance.uniform(0.0, 0.1),
        "phase": chance.uniform(-10.0, 10.0),
    }


def _estimator(chance: Random, group: Group, satellite: Settings) -> Settings:
    common = {"name": group.estimator, "parameters": group.parameters}
    if group.estimator == "momentum":
        return {
            **common,
            "inertia_walk": _or(chance, 0.0, _log(chance, 1e-4, 0.1)),
            "disturbance_walk": chance.choice((None, 0.0, 1e-3, 0.1)),
            "substeps": chance.choice((1, 1, 2, 5)),
            "gate": chance.choice((0.0, 0.0, 1e-6, 1e-2)),
        }
    if group.estimator == "adaptive":
        first, least = _or(chance, 0.0, _log(chance, 1e-5, 0.1)), _log(chance, 1e-6, 0.1)
        return {
            **common,
            "inertia_walk": first,
            "inertia_walk_min": least,
            "inertia_walk_max": max(first, least, 0.02),
            "log_q_drift": _or(chance, 0.0, _log(chance, 1e-4, 10.0)),
            "disturbance_walk": chance.choice((None, 0.0, 1e-3, 0.1)),
            "substeps": chance.choice((1, 1, 2, 5)),
        }
    scale, rate = float(np.trace(satellite["inertia"])), satellite["rate_limit"]
    speed = float(np.min(satellite["wheels"]["max_speed"]))
    return {
        **common,
        "gyro_std": rate * _log(chance, 1e-5, 0.1),
        "wheel_speed_std": speed * _log(chance, 1e-5, 0.1),
        "rate_walk": _or(chance, 0.0, rate * _log(chance, 1e-4, 0.1)),
        "inertia_walk": _or(chance, 0.0, scale * _log(chance, 1e-6, 1e-2)),
        "wheel_speed_walk": _or(chance, 0.0, speed * _log(chance, 1e-6, 1e-2)),
        "prior_rate_std": rate * _log(chance, 1e-3, 1.0),
        "prior_inertia_std": scale * _log(chance, 1e-3, 1.0),
        "prior_wheel_speed_std": speed * _log(chance, 1e-4, 0.1),
    }


def _reward(chance: Random) -> Settings:
    return {
        "criterion": chance.choice(("logdet", "trace", "maxeig")),
        "net": chance.random() < 0.5,
        "gain_scale": chance.choice((0.0, 0.1, 10.0)),
        "held_scale": chance.choice((0.0, 0.1)),
        "held_reference": chance.choice((0.0, 20.0)),
        "envelope_weight": chance.choice((0.0, 10.0)),
        "envelope_margin": chance.uniform(0.0, 1.5),
        "effort_weight": chance.choice((0.0, 0.5)),
    }
