"""Random valid configurations, from the ordinary to the extreme; each a function of one `random.Random`.

The source of chance is an argument: seeded for the command line, hypothesis' own, which shrinks, for the tests.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from random import Random
from typing import Any

import numpy as np

from satid_gym import Satellite
from satid_gym.laws import MASS_MODES
from satid_gym.modes import check_sampling

Settings = dict[str, Any]

ACTIONS = ("random", "bang_bang", "zero", "extreme", "one_wheel")
SHEETS = ("nominal", "tolerances", "timed", "counted", "flexible")
TIMED = SHEETS[2:]  # whose sensors integrate, are late or count
TURN_MAX = 2.0  # rad, that body and momentum may turn against each other between two readings


@dataclass(frozen=True, kw_only=True)
class Group:
    """Configurations that share compiled kernels.

    Attributes:
        wheels: number of wheels.
        parameters: of the inertia, "principal" or "full".
        estimator: name of the filter.
        sheet: what the data sheet has beyond nominal values, one of `SHEETS`: nothing, tolerances of all kinds, sensors
            that integrate or are late, encoders, or panels and slosh masses with such sensors. Each has a filter of its
            own to compile.
    """

    wheels: int
    parameters: str
    estimator: str
    sheet: str = "nominal"

    def __str__(self) -> str:
        return f"{self.wheels} wheels, {self.parameters}, {self.estimator}, {self.sheet}"


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
    if group.sheet == "tolerances":
        scenario["tolerances"] = _tolerances(chance, satellite)
    if group.sheet in TIMED:
        scenario["sensors"] = _sensors(chance, satellite, scenario["sample_period"], group.sheet == "counted")
    if group.parameters == "principal":  # which is refused where there are products of inertia
        satellite["inertia"] = np.diag(np.linalg.eigvalsh(satellite["inertia"])).tolist()
        scenario["tilt_std"] = 0.0
    if group.sheet == "flexible":
        satellite |= _flexible(chance, satellite, scenario["sample_period"])
    settings = {
        "satellite": satellite,
        "inertia": _law(chance, scenario, satellite, group.parameters == "full"),
        "scenario": scenario,
        "estimator": _estimator(chance, group, satellite),
        "reward": _reward(chance),
        "observation": chance.choice(("wheels", "body")),
        # a rate has 3 numbers: with more wheels it would take kernels of its own
        "control": chance.choice(("torque", "rate")) if group.wheels == 3 else "torque",
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
            "friction": _or(chance, {"coulomb": 0.0}, _friction(chance, torque, float(np.min(stored / spin))), 0.7),
        },
        "rate_limit": rate_limit,
        "gyro_noise_std": _or(chance, 0.0, rate_limit * _log(chance, 1e-6, 0.1)),
        "tachometer_noise_std": _or(chance, 0.0, float(np.min(stored / spin)) * _log(chance, 1e-6, 1e-2)),
        "disturbance_std": _or(chance, 0.0, torque * _log(chance, 1e-6, 0.1)),
    }


def _friction(chance: Random, torque: float, speed: float) -> Settings:
    coulomb = torque * _log(chance, 1e-4, 0.3)
    return {
        "coulomb": coulomb,
        "static": _or(chance, None, coulomb * chance.uniform(1.0, 2.0), 0.5),
        "viscous": _or(chance, 0.0, torque / speed * _log(chance, 1e-4, 0.5)),
        "stribeck_speed": max(0.01, speed * _log(chance, 1e-3, 0.1)),
    }


def _flexible(chance: Random, satellite: Settings, sample_period: float) -> Settings:
    """Mass and oscillators: a pair of panels and a slosh mass, as heavy as the body's inertia leaves room for."""
    inertia = np.array(satellite["inertia"])
    share, mass, turns = _log(chance, 1e-3, 0.3), _log(chance, 1.0, 1e4), [_rotation(chance) for _ in range(3)]
    size = float(np.sqrt(np.trace(inertia) / mass))
    frequencies = [_log(chance, 1e-4, 0.2) / sample_period for _ in range(2)]
    stds = {name: _or(chance, 0.0, chance.uniform(0.0, 0.3)) for name in ("mass_std", "frequency_std", "damping_std")}
    damping = _or(chance, 0.0, _log(chance, 1e-4, 0.3))
    while True:
        panel = {
            "mass": share * mass,
            "hinge": (0.3 * size * turns[0][0]).tolist(),
            "axis": turns[1][0].tolist(),
            "arm": (0.3 * size * turns[1][1]).tolist(),  # across the axis
            "mirrored": True,
        }
        tank = {
            "mass": share * mass,
            "position": (0.3 * size * turns[2][0]).tolist(),
            "direction": turns[2][1].tolist(),
            "deflection_std": _or(chance, 0.0, 0.01 * size),
        }
        limits = [_or(chance, None, scale * _log(chance, 1e-4, 1.0)) for scale in (1.0, size)]
        parts = [
            {**part, "frequency": frequency, "damping": damping, "deflection_limit": limit, **stds}
            for part, frequency, limit in zip((panel, tank), frequencies, limits, strict=True)
        ]
        flexible = {"mass": mass, "oscillators": parts}
        try:
            check_sampling("fuzzed", Satellite.from_dict({**satellite, **flexible}).modes, inertia, sample_period)
            return flexible
        except ValueError:  # little is left of a body that is nearly a rod or a plate
            share *= 0.25


def _sensors(chance: Random, satellite: Settings, period: float, counts: bool) -> Settings:
    """Sensors that integrate, are late or count; with encoders as many noise states whatever is drawn."""
    rate = satellite["rate_limit"]
    common = {"gyro_range": _or(chance, None, rate * chance.uniform(2.1, 20.0), 0.7)}  # above twice the rate limit
    integrates = chance.random() < 0.5
    quantum = {"gyro_quantum": rate * period * _log(chance, 1e-6, 0.1)} if integrates and chance.random() < 0.5 else {}
    late = _or(chance, 0.0, chance.choice((1.0, 4.0, chance.uniform(0.0, 4.0))))
    if counts:
        pulses = chance.choice((1, 24, 64, chance.randrange(1, 10_000)))
        delay = 0.0 if integrates else late
        return {**common, **quantum, "gyro_integrates": integrates, "encoder_pulses": pulses, "tachometer_delay": delay}
    gyro_late = chance.uniform(0.01, 4.0) if not integrates and late == 0.0 else _or(chance, 0.0, late)
    return {**common, **quantum, "gyro_integrates": integrates, "gyro_delay": gyro_late, "tachometer_delay": late}


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
        "tolerances": {"gyro_bias": 0.0},
        "sensors": {"gyro_delay": 0.0},
    }
    return scenario


def _tolerances(chance: Random, satellite: Settings) -> Settings:
    """All kinds of errors of gyro and wheels at once: each set of kinds has a filter of its own to compile."""
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
        "deployment_size": pair(0.0, 1.0),
        "deployment_time": pair(0.0, 1.0),
        "deployment_duration": pair(0.1, 1e3),
        "fuel_size": pair(0.0, 0.2),
        "release_size": pair(0.0, 0.2),
        "release_time": pair(0.0, 1.0),
    }


def _law(chance: Random, scenario: Settings, satellite: Settings, products: bool) -> str | Settings:
    """A law by name or in full; those of a mass, which make products of inertia, where the filter has them."""
    masses = (*MASS_MODES, *MASS_MODES, "mass") if products else ()
    kind = chance.choice(("static", "step", "drift", "periodic", "random", "law", *masses))
    if kind == "mass":
        return _mass(chance, scenario, satellite)
    if kind != "law":
        return kind
    return {
        "mode": chance.choice(("static", "step", "drift", "periodic")),
        "size": chance.uniform(-0.4, 0.8),
        "time": chance.uniform(0.1, 1.0) * scenario["horizon"],
        "frequency": chance.uniform(1e-6, 0.1),
        "phase": chance.uniform(-10.0, 10.0),
    }


def _mass(chance: Random, scenario: Settings, satellite: Settings) -> Settings:
    mode, inertia = chance.choice(sorted(MASS_MODES)), np.array(satellite["inertia"])
    mass, time = _log(chance, 1e-2, 1e3), chance.uniform(0.1, 1.0) * scenario["horizon"]
    left = np.linalg.eigvalsh(0.5 * np.trace(inertia) * np.eye(3) - inertia)[0]  # of a body: its least second moment
    room = 0.3 * float(np.trace(inertia)) if mode == "deployment" else 0.1 * max(float(left), 0.0)
    place = np.sqrt(chance.uniform(0.01, 1.0) * room / mass) * _rotation(chance)[0]
    duration = {"duration": chance.uniform(0.1, 1.0) * scenario["horizon"]} if mode == "deployment" else {}
    return {"mode": mode, "mass": mass, "place": place.tolist(), "time": time, **duration}


def _estimator(chance: Random, group: Group, satellite: Settings) -> Settings:
    common = {"name": group.estimator, "parameters": group.parameters}
    if group.estimator == "momentum":
        return {
            **common,
            "inertia_walk": _or(chance, 0.0, _log(chance, 1e-4, 0.1)),
            "disturbance_walk": chance.choice((None, 0.0, 1e-3, 0.1)),
            "substeps": chance.choice((1, 1, 2, 5)),
            "gate": 0.0 if group.sheet in TIMED else chance.choice((0.0, 0.0, 1e-6, 1e-2)),
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
