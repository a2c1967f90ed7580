"""Random environments, valid and spoiled; `python -m tests.qa.fuzz` flies thousands, with any number of wheels."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from satid_gym import SATELLITES, InertiaLaw, SatInertiaIDEnv, Scenario
from satid_gym.estimators.alignment import noise_covariance
from satid_gym.scenario import prior_of
from tests.cases import cases
from tests.qa.fuzz.__main__ import Fuzz
from tests.qa.fuzz.configuration import Group, draw_configuration
from tests.qa.fuzz.flight import Breakdown, Undrawable, Violation, fly
from tests.qa.fuzz.spoil import refused, refuses_actions, spoil

CHANCE = st.randoms(use_true_random=False)
FLOWN = [
    *(("nominal", name) for name in ("adaptive", "momentum", "rate")),
    *((sheet, "adaptive") for sheet in ("tolerances", "timed", "counted", "flexible")),
]
GROUPS = [Group(wheels=3, parameters="principal", estimator=name, sheet=sheet) for sheet, name in FLOWN]


@pytest.mark.slow
@cases("group", GROUPS)
@settings(max_examples=15)
@given(chance=CHANCE)
def test_a_valid_configuration_keeps_every_promise(group, chance):
    configuration = draw_configuration(chance, group)
    try:
        fly(configuration, decisions=40)
    except (Undrawable, Breakdown):
        return  # it said so


@pytest.mark.slow
@settings(max_examples=150)
@given(chance=CHANCE)
def test_a_spoiled_configuration_is_refused_with_a_reason(chance):
    wrong, what = spoil(chance, draw_configuration(chance, chance.choice(GROUPS)))
    try:
        refused(wrong)
    except Violation as violation:
        raise AssertionError(f"{what}: {violation}") from violation


@settings(max_examples=5)
@given(seed=st.integers(0, 100))
@example(seed=0)
def test_a_refused_action_changes_nothing(seed):
    env = SatInertiaIDEnv()
    env.reset(seed=seed)
    env.step(np.full(3, 0.1))
    refuses_actions(env, Random(seed))


@pytest.mark.slow
def test_most_configurations_are_flown_and_a_seed_draws_the_same_again():
    """What cannot be drawn, or breaks the filter down and says so, is the exception."""
    fuzz = Fuzz(configurations=40, wheels=(3,), sheets=("nominal", "tolerances"))
    flown = 0
    for index in range(20):  # of the first four groups, which are compiled anyway
        try:
            fly(fuzz.draw(index)[0], decisions=5)
            flown += 1
        except (Undrawable, Breakdown):
            continue
    assert flown >= 18
    fuzz = Fuzz(configurations=100)
    one, other = (fuzz.draw(17)[0] for _ in range(2))
    assert str(one) == str(other)
    assert str(one) != str(fuzz.draw(18)[0])


# What fuzzing found


def test_coarse_sampling_does_not_cost_the_truth_its_momentum():
    """The body turns far between two readings 10 s apart; without torque from outside |M| must stay all the same."""
    quiet = {
        "sample_period": 10.0, "decision_period": 10.0, "horizon": 1000.0, "disturbance_scale": 0.0,
        "gravity_gradient": False, "solar_pressure": 0.0, "wheel_speed_range": 1.0, "termination_factor": 1e6,
    }  # fmt: skip
    env = SatInertiaIDEnv("smallsat", "static", quiet)
    env.reset(seed=0)
    start = np.linalg.norm(env.fleet.rows.plants["momentum"][0])
    assert start > 0.1 * np.sum(SATELLITES["smallsat"].wheels.inertia * SATELLITES["smallsat"].wheels.max_speed)
    for decision in range(100):
        env.step(np.where((decision + np.arange(3)) % 2 == 0, 0.02, -0.02))
    assert np.linalg.norm(env.fleet.rows.plants["momentum"][0]) == pytest.approx(start, rel=1e-6)


def test_read_only_and_strided_actions_do_not_compile_the_core_again():
    from satid_gym.core import episode

    env = SatInertiaIDEnv()
    env.reset(seed=0)
    compiled = len(episode.step_many.signatures)
    fixed = np.zeros(3, np.float32)
    fixed.flags.writeable = False
    env.step(fixed)
    env.step(np.zeros(6, np.float32)[::2])
    assert len(episode.step_many.signatures) == compiled


def test_a_drift_stops_at_its_full_size():
    """It went on beyond, to an inertia that no body has."""
    law = InertiaLaw("drift", size=-0.4, time=25.0)
    env = SatInertiaIDEnv("microsat", law, {"inertia_std": 0.0, "horizon": 100.0})
    env.reset(seed=0)
    shares = [env.step(np.zeros(3))[4]["inertia_true"][0, 0] / 6.53 for _ in range(100)]
    np.testing.assert_allclose(shares, 1.0 - 0.4 * np.minimum(np.arange(1, 101) / 25.0, 1.0), rtol=1e-12)


def test_the_covariance_of_six_parameters_is_symmetric_to_the_last_bit():
    """Process noise in the direction of theta was rounded otherwise above the diagonal than below."""
    env = SatInertiaIDEnv("microsat", "drift", estimator={"name": "adaptive", "parameters": "full"})
    env.reset(seed=0)
    for i in range(60):
        env.step(np.full(3, 0.2 if i // 6 % 2 else -0.2, np.float32))
    belief = env.fleet.rows.beliefs[0]
    np.testing.assert_array_equal(belief["covariance"], belief["covariance"].T)
    slope = belief["adaptation"]["covariance_slope"]
    np.testing.assert_array_equal(slope, slope.T)


def test_the_noise_of_encoders_on_skewed_axes_is_symmetric_to_the_last_bit():
    """A matrix product need not be."""
    for seed in range(20):
        axes = np.random.default_rng(seed).normal(size=(3, 4))
        wheels = SATELLITES["microsat"].wheels.replace(
            axes=axes / np.linalg.norm(axes, axis=0), inertia=2e-3, max_torque=0.1, max_speed=900.0
        )
        satellite = SATELLITES["microsat"].replace(wheels=wheels)
        noise = noise_covariance(prior_of(satellite, Scenario(sensors={"encoder_pulses": 24})))
        np.testing.assert_array_equal(noise, noise.T)
