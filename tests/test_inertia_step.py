"""A step of the inertia that no reading shows until the body turns: what the filter makes of momentum and inertia."""

from __future__ import annotations

import numpy as np
import pytest

from satid_gym import SatInertiaIDEnv, SatInertiaIDVectorEnv
from satid_gym.estimators import AdaptiveEKF, FilterpyAdaptiveEKF
from satid_gym.evaluation import seeds
from satid_gym.policies.scripted import ScriptedPolicy
from satid_gym.policy import missions
from satid_gym.profiles import PROFILES
from satid_gym.satellite import BENCHMARK_SATELLITES


def sawtooth(env, amplitude, seeds):
    policy = ScriptedPolicy("sawtooth", PROFILES["sawtooth"], amplitude)
    policy.reset(missions(env.problem)[0], seeds)
    return policy


def after_finding(satellite, scenario, amplitude, episodes=64):
    """NEES of all decisions of all episodes after the step was found."""
    chosen = seeds("validation", episodes)
    env = SatInertiaIDVectorEnv(episodes, satellite, "step", scenario, control="rate")
    policy = sawtooth(env, amplitude, chosen)
    observation, _ = env.reset(seed=chosen)
    infos = []
    for _ in range(env.problem.scenario.decisions):
        observation, *_, info = env.step(policy(observation))
        infos.append({name: info[name].copy() for name in ("nees", "steps_found", "inertia_true")})
    nees, found, truth = (np.array([info[name] for info in infos]) for name in ("nees", "steps_found", "inertia_true"))
    stepped = (truth != truth[0]).any(axis=(2, 3))
    before = np.where(stepped, 0, found).max(axis=0)  # found where a fault, not a step, was the cause
    return nees[stepped & (found > before)]


@pytest.mark.compiled
@pytest.mark.parametrize("scenario", ["default", "faults"])
def test_weak_excitation_that_shows_a_step_late_is_not_led_astray(scenario):
    """A filter that takes M as known at the reading that shows the step has a mean NEES of 7 to 22, 21 to 234 gated."""
    for amplitude in (0.14, 0.4):
        for satellite in BENCHMARK_SATELLITES:
            nees = after_finding(satellite, scenario, amplitude)
            high = np.percentile(nees, 95)
            print(f"{scenario}, {satellite}, {amplitude}: NEES {nees.mean():.2f}, 95 % below {high:.2f}")
            assert 0.3 < nees.mean() < 2.0
            assert high < 3.0


@pytest.mark.compiled
@pytest.mark.parametrize("scenario", ["default", pytest.param("faults", marks=pytest.mark.slow)])
def test_a_step_that_is_seen_late_is_taken_as_filterpys_filter_takes_it(scenario):
    gate = {"gate": 1e-6} if scenario == "faults" else {}
    law = {"mode": "step", "size": 0.1, "time": 190.0}
    episodes = []
    for estimator in (AdaptiveEKF(**gate), FilterpyAdaptiveEKF(**gate)):
        env = SatInertiaIDEnv("smallsat", law, control="rate", estimator=estimator)
        policy = sawtooth(env, 0.14, [1])
        observation, _ = env.reset(seed=1)
        infos = []
        for _ in range(260):
            observation, *_, info = env.step(policy(observation[None])[0])
            infos.append(
                (info["nees"], info["steps_found"], env.fleet.rows.beliefs["covariance"][0, 0, 3], info["time"])
            )
        episodes.append(np.array(infos))
    compiled, reference = episodes
    (found,) = np.flatnonzero(np.diff(compiled[:, 1]) > 0)
    assert compiled[found, -1] > 200.0
    assert compiled[found + 1 :, 0].mean() < 3.0
    kept = [0, 2, 3]  # a filter that is plugged in counts its steps by itself
    np.testing.assert_allclose(compiled[:, kept], reference[:, kept], rtol=1e-6, atol=1e-12)
