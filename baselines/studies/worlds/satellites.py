"""Satellites of the studies' worlds: of other sizes, with panels, with a tank, with four skewed wheels."""

from __future__ import annotations

from typing import Any, TypedDict

import numpy as np

from satid_gym.appendages import panel_pair
from satid_gym.oscillators import SloshMass
from satid_gym.reaction_wheels import ReactionWheels
from satid_gym.satellite import BENCHMARK_SATELLITES, SATELLITES, Satellite

PYRAMID = np.array([[1.0, -1.0, 1.0, -1.0], [1.0, 1.0, -1.0, -1.0], [1.0, 1.0, 1.0, 1.0]]) / np.sqrt(3.0)
"""Axes (3, 4) of four wheels along the diagonals of a cube."""


class _ModeStd(TypedDict):
    mass_std: float
    frequency_std: float
    damping_std: float


_MODE_STD: _ModeStd = {"mass_std": 0.2, "frequency_std": 0.3, "damping_std": 0.3}  # of panels and slosh masses


def _satellite(name: str, moments: float, wheels: tuple[float, float, float], **sheet: float) -> Satellite:
    """Satellite of moments 1.1, 1 and 0.8 times a number; wheels: torque limit, speed limit, spin inertia."""
    torque, speed, inertia = map(np.array, wheels)
    return Satellite(
        name,
        moments * np.array([1.1, 1.0, 0.8]),
        ReactionWheels(inertia=inertia, max_torque=torque, max_speed=speed),
    ).replace(**sheet)


# wheels as of CubeSpace CW0017, Blue Canyon RWP100 and Honeywell HR16-100; gyros from MEMS to navigation grade
POCKETQUBE = _satellite(
    "pocketqube",
    1e-3,
    (2.3e-4, 1047.0, 1.7e-6),
    rate_limit=0.1,
    gyro_noise_std=3e-4,
    tachometer_noise_std=0.1,
    disturbance_std=2e-7,
)
MINISAT = _satellite("minisat", 1.0, (7e-3, 680.0, 1.5e-4), rate_limit=0.03, gyro_noise_std=5e-5, disturbance_std=1e-5)
OBSERVATORY = _satellite(
    "observatory",
    1e4,
    (0.2, 628.0, 0.159),
    rate_limit=3e-3,
    gyro_noise_std=1e-6,
    tachometer_noise_std=0.01,
    disturbance_std=1e-3,
)


def with_panels(satellite: Satellite, share: float, frequency: float) -> Satellite:
    """The satellite with two thin panels along y that turn about z and have a share of that axis's inertia."""
    panel = panel_pair(satellite, share, 1, 2, frequency=frequency, damping=0.005, **_MODE_STD)
    return satellite.replace(oscillators=(*satellite.oscillators, panel))


def with_slosh(satellite: Satellite, share: float, frequency: float) -> Satellite:
    """The satellite with a tank half-way to its side, of whose mass a share sloshes."""
    assert satellite.size is not None
    assert satellite.mass is not None
    tank = SloshMass(
        mass=share * satellite.mass,
        position=np.array([0.5 * satellite.size[0], 0.0, 0.1 * satellite.size[2]]),
        direction=np.array([0.0, 1.0, 0.0]),
        frequency=frequency,
        damping=0.05,
        **_MODE_STD,
    )
    return satellite.replace(oscillators=(*satellite.oscillators, tank))


def on_pyramid(satellite: Satellite, avoided_speed: tuple[float, float] = (0.0, 0.0)) -> Satellite:
    """The satellite with four wheels like its first along the diagonals of a cube."""
    sheet: dict[str, Any] = {
        name: getattr(satellite.wheels, name)[0] for name in ("inertia", "max_torque", "max_speed")
    }
    return satellite.replace(wheels=ReactionWheels(axes=PYRAMID, avoided_speed=avoided_speed, **sheet))


PYRAMIDS = tuple(on_pyramid(SATELLITES[name]) for name in BENCHMARK_SATELLITES)
"""The paper's satellites with such wheels."""
