"""Efficiency: recordings are the benchmark's flights, the filter reaches its bound, nothing beats the bound."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from baselines import build
from baselines.studies.efficiency import LAW_KNOWN, final, known_law_estimates, square_error
from baselines.studies.performance_bound import performance_bound
from baselines.studies.recording import record
from baselines.studies.timing import TimedPolicy
from satid_gym import SATELLITES
from satid_gym.bounds import episode_bounds, posterior_bound, reference_limit
from satid_gym.estimators import MomentumEKFSettings
from satid_gym.evaluation import benchmark_scenario, fly, seeds
from satid_gym.policy import Mission
from satid_gym.scenario import prior_of

SQUARE = {"period": 24.0, "margin": 2.5}


class Asking:
    """Does nothing, and keeps what it is shown: the filter's whole covariance."""

    name, kind, include_covariance = "asking", "scripted", True

    def reset(self, mission: Mission, seeds: Sequence[int]) -> None:
        self.mission, self.seen = mission, []

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        self.seen.append(observation)
        return np.zeros((len(observation), self.mission.satellite.wheels.count))


@pytest.mark.parametrize("inertia", ["static", "step"])
def test_a_recording_is_the_flight_that_the_benchmark_scores(inertia: str) -> None:
    cell = {"satellite": "cubesat", "inertia": inertia, "seeds": seeds("validation", 4)}
    recording = record(build("rate_square", SQUARE), scenario=benchmark_scenario(), **cell)
    flight = fly(build("rate_square", SQUARE), scenario=benchmark_scenario(), **cell)
    truth = recording.motion.inertia
    error = np.linalg.norm(recording.theta - np.diagonal(truth, axis1=2, axis2=3), axis=2)
    relative = (error / np.linalg.norm(truth, axis=(2, 3)))[:, 10::10].T
    np.testing.assert_allclose(relative, flight.error, rtol=1e-9)
    np.testing.assert_allclose(recording.outside, flight.outside.mean(axis=0), atol=1e-12)


def test_the_walk_of_the_truth_is_the_filters() -> None:
    cell = {"satellite": "microsat", "inertia": "static", "seeds": seeds("validation", 30)}
    recording = record(build("rate_square", SQUARE), as_modelled=True, estimator="momentum", **cell)
    theta = np.diagonal(recording.motion.inertia, axis1=2, axis2=3)
    steps = np.diff(theta, axis=1) / np.diag(SATELLITES["microsat"].inertia)
    assert steps.std() == pytest.approx(0.004 * np.sqrt(0.1), rel=0.01)
    size, torque = (np.linalg.norm(x, axis=2) for x in (recording.motion.momentum, recording.motion.torque))
    # a step of J leaves M as it is: only the external torque changes its size
    assert (np.ptp(size, axis=1) < 1.01 * 0.1 * torque.sum(axis=1)).all()


@pytest.mark.slow
@pytest.mark.parametrize("walk", [0.0, 0.004])
def test_the_filter_reaches_its_bound_where_truth_is_its_model(walk: float) -> None:
    chosen, settings = seeds("validation", 60), MomentumEKFSettings(inertia_walk=walk)
    cell = {"satellite": "microsat", "inertia": "static", "seeds": chosen, "estimator": settings}
    recording = record(build("rate_square", SQUARE), as_modelled=True, **cell)
    prior = prior_of(SATELLITES["microsat"], benchmark_scenario().replace(gravity_gradient=False, orbit_rate=0.0))
    covariance = posterior_bound(recording.motion, prior, settings, recording.dt)
    ratio = (
        square_error(recording.theta, recording).mean()
        / final(episode_bounds(covariance, recording.motion.inertia)).mean()
    )
    # static: 60 episodes of 3 parameters, std sqrt(2 / 180) = 0.11; walking: many independent windows each
    spread = 0.33 if walk == 0.0 else 0.12
    assert 1.0 - spread < ratio < 1.0 + spread


def test_knowing_the_law_makes_every_mode_as_good_as_static() -> None:
    found = {}
    for mode in ("static", "drift", "periodic", "step"):
        cell = {"satellite": "cubesat", "inertia": mode, "seeds": seeds("validation", 12)}
        recording = record(build("rate_square", SQUARE), scenario=benchmark_scenario(), estimator="momentum", **cell)
        told = known_law_estimates(recording, "cubesat", benchmark_scenario())
        found[mode] = np.sqrt(square_error(told, recording).mean())
        assert found[mode] < 0.1 * np.sqrt(square_error(recording.theta, recording).mean())
    for mode in found:
        assert found[mode] == pytest.approx(found["static"], rel=0.35)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["static", "step", "periodic"])
def test_no_policy_beats_its_ceiling(mode: str) -> None:
    chosen, world = seeds("validation", 12), benchmark_scenario()
    top = performance_bound("smallsat", mode, chosen, world)
    assert (top.bound[10:] < top.reference_limit[10:]).all()
    for name, settings in (("mpc", {}), ("rate_square", SQUARE)):
        flight = fly(build(name, settings), satellite="smallsat", inertia=mode, seeds=chosen, scenario=world)
        reached = top.efficiency(flight.error)
        assert 0.0 < reached["efficiency"] < reached["excitation_efficiency"] < 1.0
    perfect = np.repeat(top.bound[:, None], 3, axis=1)
    assert top.efficiency(perfect)["efficiency"] == pytest.approx(1.0)


def test_ceiling_is_for_the_momentum_filter() -> None:
    with pytest.raises(ValueError, match=r"no account of the estimator 'rate', .* in scenario 'paper'"):
        performance_bound("cubesat", "static", [0, 1], benchmark_scenario("paper"))


def test_the_reference_limit_of_a_filter_that_finds_steps_starts_again_at_one() -> None:
    """Before the step the same; a filter without walk then keeps its lag, one that finds the step loses it."""
    recording = record(build("zero", {}), satellite="microsat", inertia="step", seeds=[0], scenario="default")
    satellite, prior = SATELLITES["microsat"], prior_of(SATELLITES["microsat"], benchmark_scenario())
    blind, finding = (
        reference_limit(recording.motion, satellite, prior, LAW_KNOWN, recording.dt, finds_steps=told)[0]
        for told in (False, True)
    )
    theta = recording.motion.inertia[0].diagonal(axis1=1, axis2=2)
    at = int(np.abs(np.diff(theta[:, 0])).argmax()) + 1
    np.testing.assert_array_equal(blind[:at], finding[:at])
    change = (theta[at] - theta[at - 1]) ** 2
    assert (blind[-1] > 0.01 * change).all()
    assert (finding[at + 1 :][-1] < 1e-4 * change).all()


def test_reference_limit_of_a_static_inertia_by_hand() -> None:
    """Without a walk the filter weighs all readings alike: variance 1 / (sum of information), prior's pull aside."""
    recording = record(build("zero", {}), satellite="cubesat", inertia="static", seeds=[0], scenario="default")
    satellite, prior = SATELLITES["cubesat"], prior_of(SATELLITES["cubesat"], benchmark_scenario())
    limit = reference_limit(recording.motion, satellite, prior, LAW_KNOWN, recording.dt)[0, -1]
    moments = np.diagonal(recording.motion.inertia[0, 0])
    least = ((1e-4 * moments) ** 2 + (1e-4 * 0.05) ** 2) / 0.05**2 / 3000.0
    np.testing.assert_allclose(limit, least, rtol=0.02)


def test_a_timed_policy_decides_as_the_policy_does() -> None:
    cell = {"satellite": "cubesat", "inertia": "static", "seeds": [1, 2]}
    timed = TimedPolicy(build("rate_square", SQUARE))
    assert (timed.name, timed.kind, timed.decision_ms) == ("rate_square", "closed_loop", 0.0)
    np.testing.assert_array_equal(fly(timed, **cell).error, fly(build("rate_square", SQUARE), **cell).error)
    assert len(timed.times) == 300
    assert min(timed.times) <= timed.decision_ms / 1e3 <= max(timed.times)


def test_timed_or_recorded_a_policy_sees_what_it_asks_for() -> None:
    cell = {"satellite": "cubesat", "inertia": "static", "seeds": [1, 2], "scenario": {"horizon": 5.0}}
    alone, timed, recorded = Asking(), Asking(), Asking()
    fly(alone, **cell), fly(TimedPolicy(timed), **cell), record(recorded, **cell)
    assert np.shape(alone.seen) == (5, 2, 70)
    np.testing.assert_array_equal(timed.seen, alone.seen)
    np.testing.assert_allclose(recorded.seen, alone.seen, rtol=1e-5, atol=1e-6)
    assert TimedPolicy(build("zero", {})).include_covariance is False
