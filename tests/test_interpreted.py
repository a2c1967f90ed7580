"""The compiled core against the same source as plain Python: the compiler and its flags change no result."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from satid_gym import SATELLITES, Disturbance, InertiaLaw, SatInertiaIDEnv, SatInertiaIDVectorEnv, simulate
from satid_gym.friction import WheelFriction

pytestmark = pytest.mark.compiled


def episode(decisions: int = 12, **arguments) -> dict[str, np.ndarray]:
    """Observations, rewards and scores of random actions."""
    env = SatInertiaIDEnv(**arguments)
    rng = np.random.default_rng(0)
    observation, _ = env.reset(seed=1)
    rows = [[*observation, 0.0, 0.0, 0.0]]
    for _ in range(decisions):
        action = rng.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32)
        observation, reward, *_, info = env.step(action)
        rows.append([*observation, reward, info["nees"], info["relative_error"]])
    return np.array(rows)


def rollouts() -> dict[str, np.ndarray]:
    """One of each kind: every filter, criterion, law and autoreset, wheels at their limit."""
    microsat = SATELLITES["microsat"]
    flight = simulate(
        microsat,
        np.tile([0.1, -0.1, 0.05], (20, 1)),
        0.5,
        omega0=(0.1, -0.2, 0.15),
        wheel_speed0=(890.0, -880.0, 0.0),
        law=InertiaLaw("step", size=0.1, time=3.3),
        disturbance=Disturbance(constant=(1e-3, -2e-3, 1e-3), gravity_gradient=True, orbit_rate=0.02),
    )
    vector = SatInertiaIDVectorEnv(4, "random", max_episode_steps=3)
    observations = [vector.reset(seed=0)[0]]
    observations += [vector.step(np.full((4, 3), 0.1 * k))[0] for k in range(6)]
    return {
        "simulate": np.hstack([flight.omega, flight.wheel_speed, flight.momentum, flight.attitude]),
        "vector": np.array(observations),
        "default": episode(satellite="cubesat", inertia="step"),
        "momentum": episode(satellite="cubesat", inertia="step", estimator="momentum"),
        "full": episode(
            inertia="periodic",
            scenario={"tilt_std": 0.1},
            estimator={"name": "momentum", "parameters": "full", "substeps": 2},
            reward="trace",
            include_covariance=True,
        ),
        "rate": episode(
            inertia="drift",
            scenario="paper",
            reward={"criterion": "maxeig", "net": True},
            include_covariance=True,
        ),
        "adaptive": episode(inertia="step", estimator={"name": "adaptive", "parameters": "full"}),
        "counted": episode(
            decisions=4,
            inertia="static",
            scenario={"sensors": {"encoder_pulses": 24, "tachometer_delay": 0.6}},
        ),
        "late": episode(
            decisions=4,
            inertia="static",
            scenario={
                "sensors": {"gyro_integrates": True, "tachometer_delay": 0.9},
                "tolerances": {"tachometer_delay": 0.3},
            },
        ),
        "tight": episode(satellite="smallsat", scenario="tight", inertia="static"),
        **{
            name: episode(decisions=4, inertia="periodic", scenario=name, control="rate")
            for name in ("faults", "flex", "slosh", "calibration", "operations", "wheels4")
        },
        "rubbing": episode(
            satellite=microsat.replace(
                wheels=microsat.wheels.replace(friction=WheelFriction(coulomb=1e-3, static=2e-3, viscous=1e-5))
            )
        ),
        "released": episode(decisions=5, inertia=InertiaLaw("release", mass=5.0, place=(0.0, 0.2, -0.3), time=3.3)),
    }


def test_compiled_and_interpreted_agree(tmp_path):
    """To rounding: multiply-and-add is fused in compiled code alone."""
    path = tmp_path / "interpreted.npz"
    code = "import sys, numpy, test_interpreted as t; numpy.savez(sys.argv[1], **t.rollouts())"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", code, str(path)]
    subprocess.run(command, env=environment, cwd=Path(__file__).parent, check=True, timeout=300)
    compiled, interpreted = rollouts(), np.load(path)
    assert sorted(compiled) == sorted(interpreted.files)
    for name, expected in compiled.items():
        size = np.abs(expected).max(axis=0) + 1e-3
        assert np.abs((interpreted[name] - expected) / size).max() < 1e-11, name
        assert np.abs(expected).max() > 0.1
