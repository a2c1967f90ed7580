"""Torque profiles of the paper: eight signals of unit amplitude, and the amplitudes used there.

A profile is a pure function of time (N,) in s that gives the torque on the body about its three axes, (N, 3),
as a multiple of an amplitude; the largest value it can reach is 1. The horizon T, in s, sets the duration of
the steps and of the chirp; the sines keep their frequencies.
Source: "Towards Active Excitation-Based Dynamic Inertia Identification in Satellites", arXiv 2510.16738,
Table I; numbers that it does not give are those of its authors' public code.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from satid_gym.config import unknown_name
from satid_gym.reaction_wheels import ReactionWheels
from satid_gym.satellite import Satellite

Profile = Callable[..., np.ndarray]

HORIZON = 300.0  # s, the paper's
SINE_FREQUENCY = 0.01  # Hz
CHIRP_FREQUENCIES = (0.005, 0.05)  # Hz, first and last
PRBS_HOLD = 20.0  # s
MULTI_SINE_FREQUENCIES = np.array([[0.002, 0.005], [0.003, 0.007], [0.004, 0.008]])  # Hz, axis by tone
MULTI_SINE_AMPLITUDES = np.array([[0.010, 0.007], [0.009, 0.006], [0.008, 0.005]])  # N m
MULTI_SINE_PHASES = np.array([0.0, np.pi / 4.0, -np.pi / 3.0])  # rad, of the first tone
SINE_3AXIS_AMPLITUDES = np.array([0.030, 0.015, 0.025])  # N m

PAPER_AMPLITUDES: dict[str, float] = {  # N m, of the paper's cubesat
    "one_step": 0.015,
    "multi_step": 0.012,
    "sawtooth": 0.02,
    "sine": 0.01,
    "multi_sine": float(MULTI_SINE_AMPLITUDES.sum(axis=1).max()),
    "prbs": 0.01,
    "chirp": 0.01,
    "sine_3axis": float(SINE_3AXIS_AMPLITUDES.max()),
}
PAPER_SCALES: dict[str, float] = {"cubesat": 1.0, "microsat": 5.0, "smallsat": 9.85}


def _on_all_axes(signal: np.ndarray) -> np.ndarray:
    return np.repeat(signal[:, None], 3, axis=1)


def one_step(time: np.ndarray, *, horizon: float = HORIZON) -> np.ndarray:
    """Full torque in the first third of the horizon, then zero."""
    return _on_all_axes(np.where(time < horizon / 3.0, 1.0, 0.0))


def multi_step(time: np.ndarray, *, horizon: float = HORIZON) -> np.ndarray:
    """Six equal segments: + - 0 + - 0; zero after the horizon."""
    segment = np.floor(6.0 * time / horizon).astype(int)
    return _on_all_axes(np.where(segment < 6, np.array([1.0, -1.0, 0.0])[segment % 3], 0.0))


def sawtooth(time: np.ndarray, *, horizon: float = HORIZON) -> np.ndarray:
    """Ramps from -1 to 1 at 0.01 Hz, from 0 on."""
    cycle = SINE_FREQUENCY * time
    return _on_all_axes(2.0 * (cycle - np.floor(cycle + 0.5)))


def sine(time: np.ndarray, *, horizon: float = HORIZON) -> np.ndarray:
    """One tone of 0.01 Hz, the same on every axis."""
    return _on_all_axes(np.sin(2.0 * np.pi * SINE_FREQUENCY * time))


def multi_sine(time: np.ndarray, *, horizon: float = HORIZON) -> np.ndarray:
    """Two tones per axis, different for each axis; amplitude 1 is the largest sum of an axis's tones."""
    first, second = MULTI_SINE_FREQUENCIES.T
    phases = 2.0 * np.pi * time[:, None]
    tones = MULTI_SINE_AMPLITUDES / PAPER_AMPLITUDES["multi_sine"]
    return tones[:, 0] * np.sin(phases * first + MULTI_SINE_PHASES) + tones[:, 1] * np.sin(phases * second)


def prbs(time: np.ndarray, *, horizon: float = HORIZON, seed: int = 1) -> np.ndarray:
    """Pseudo-random binary sequence: each axis draws a new sign every 20 s, from `seed`."""
    segment = np.floor(time / PRBS_HOLD).astype(int)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], size=(segment.max(initial=0) + 1, 3))
    return signs[segment]


def chirp(time: np.ndarray, *, horizon: float = HORIZON) -> np.ndarray:
    """Cosine whose frequency rises linearly from 0.005 to 0.05 Hz over the horizon."""
    low, high = CHIRP_FREQUENCIES
    return _on_all_axes(np.cos(2.0 * np.pi * (low * time + 0.5 * (high - low) / horizon * time**2)))


def sine_3axis(time: np.ndarray, *, horizon: float = HORIZON) -> np.ndarray:
    """One tone of 0.01 Hz, with a different amplitude on each axis; amplitude 1 is the largest."""
    return np.sin(2.0 * np.pi * SINE_FREQUENCY * time)[:, None] * SINE_3AXIS_AMPLITUDES / SINE_3AXIS_AMPLITUDES.max()


_PAPER = (one_step, multi_step, sawtooth, sine, multi_sine, prbs, chirp, sine_3axis)
PROFILES: Mapping[str, Profile] = MappingProxyType({profile.__name__: profile for profile in _PAPER})
"""The paper's eight, a closed set: claims and figures of "the eight" are about these, so nothing can be added.

A scripted signal of your own is a baseline: an entry of `satid_gym.policies.registry.BASELINES`.
"""


def wheel_torque(body_torque: np.ndarray, wheels: ReactionWheels) -> np.ndarray:
    """Motor torque u (..., n), N m, of least norm for a torque -A u = `body_torque` (..., 3) on the body."""
    return -body_torque @ np.linalg.pinv(wheels.axes).T


def paper_torque(profile: str, satellite: Satellite, time: np.ndarray, *, horizon: float = HORIZON) -> np.ndarray:
    """Motor torque (N, n), N m, of a profile at the paper's amplitude, clipped to the wheels' limits as in the paper.

    Args:
        profile: name among `PROFILES`.
        satellite: one of the paper's three; its name chooses the amplitude.
        time: (N,) s, start of the interval over which each torque is held.
        horizon: s.

    Raises:
        ValueError: the paper has no such profile or satellite.
    """
    if profile not in PROFILES:
        raise unknown_name("profile", profile, PROFILES)
    if satellite.name not in PAPER_SCALES:
        raise unknown_name("satellite of the paper", satellite.name, PAPER_SCALES)
    amplitude = PAPER_AMPLITUDES[profile] * PAPER_SCALES[satellite.name]
    torque = wheel_torque(amplitude * PROFILES[profile](time, horizon=horizon), satellite.wheels)
    return np.clip(torque, -satellite.wheels.max_torque, satellite.wheels.max_torque)
