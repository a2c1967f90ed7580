"""Faults: what they do to the truth, and what the gated filter makes of the readings they leave."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from satid_gym import SCENARIOS, SatInertiaIDEnv, SatInertiaIDVectorEnv, Scenario
from satid_gym.core.records import FAULTS
from satid_gym.estimators import FilterpyMomentumEKF, FilterpyMomentumUKF
from satid_gym.faults import SWITCHES, Faults

GATE = {"name": "momentum", "gate": 1e-6}
RECORDED = json.loads(Path(__file__).with_name("faultless.json").read_text(encoding="utf-8"))


def world(horizon: float = 60.0, **faults) -> Scenario:
    """Scenario "faults" with these faults alone, that begin at a third of the horizon."""
    return SCENARIOS["faults"].replace(
        horizon=horizon, gyro_bias_walk=0.0, faults={"time": (1.0 / 3.0, 1.0 / 3.0), **faults}
    )


def square(t: int, n: int = 3) -> np.ndarray:
    """Open-loop excitation inside the envelope, (n,)."""
    return np.where((t / 30.0 + np.arange(n) / n) % 1.0 < 0.5, 0.1, -0.1)


def fly_truth(env: SatInertiaIDEnv, seed: int = 0):
    """Truth, readings and infos of an open-loop episode at the end of each decision."""
    env.reset(seed=seed)
    rows, infos = [], []
    for t in range(env.problem.scenario.decisions):
        *_, info = env.step(square(t))
        rows.append(env._plants[0].copy())
        infos.append(info)
    return np.array(rows), infos


# off


@pytest.mark.parametrize("scenario", RECORDED)
def test_without_faults_the_truth_is_what_it_was_before_there_were_any(scenario):
    """The recording was made before faults were written: not one random number more, not one bit of readings."""
    env = SatInertiaIDVectorEnv(6, "random", scenario=scenario)
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(30):
        env.step(rng.uniform(-0.2, 0.2, (6, 3)))
    plants = env.state()["plants"]
    recorded = RECORDED[scenario]
    np.testing.assert_array_equal(plants["stream"], np.array(recorded["stream"], np.uint64))
    # other processors round sines and logarithms otherwise
    np.testing.assert_allclose(plants["gyro"], recorded["gyro"], rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(plants["tachometer"], recorded["tachometer"], rtol=1e-9)


# filters


@pytest.mark.parametrize("seed", [64, 72, 3])
def test_gated_filter_equals_filterpy_over_an_episode(seed):
    """Everything that the scenario has, in the environment: means by their size, covariances by standard deviations."""
    faults = SCENARIOS["faults"].replace(
        faults=SCENARIOS["faults"].faults.replace(gyro_dropout=1.0, tachometer_stuck=1.0, gyro_dropout_silent=0.5)
    )
    fast = SatInertiaIDEnv(scenario=faults, inertia="step")
    slow = SatInertiaIDEnv(scenario=faults, inertia="step", estimator=FilterpyMomentumEKF(gate=1e-6))
    fast.reset(seed=seed)
    slow.reset(seed=seed)
    means, covariances = [], []
    for t in range(300):
        one, other = fast.step(square(t)), slow.step(square(t))
        assert one[4]["nis"] == pytest.approx(other[4]["nis"], rel=1e-6, abs=1e-9)
        means.append((fast._beliefs["mean"][0].copy(), slow._beliefs["mean"][0].copy()))
        covariances.append((fast._beliefs["covariance"][0].copy(), slow._beliefs["covariance"][0].copy()))
    mean, covariance = np.array(means), np.array(covariances)
    print(seed, (np.abs(mean[:, 0] - mean[:, 1]) / np.abs(mean).max(axis=(0, 1))).max())
    std = np.sqrt(np.einsum("tii->ti", covariance[:, 0]))
    print((np.abs(covariance[:, 0] - covariance[:, 1]) / (std[:, :, None] * std[:, None, :])).max(axis=(1, 2)))
    assert (np.abs(mean[:, 0] - mean[:, 1]) / np.abs(mean).max(axis=(0, 1))).max() < 1e-9
    assert (np.abs(covariance[:, 0] - covariance[:, 1]) / (std[:, :, None] * std[:, None, :])).max() < 1e-9
    assert fast._reports["rejected"][0] > 0
