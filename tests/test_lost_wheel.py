"""A wheel that fails under `control="rate"`: it is noticed at once, and the body stays inside its limit without it."""

from __future__ import annotations

import numpy as np
import pytest

from satid_gym import SatInertiaIDVectorEnv
from satid_gym.core.control.lost_axis import constrain
from satid_gym.evaluation import seeds
from tests.cases import cases
from tests.test_rate_tracking import flown

LIMIT = 0.03
INERTIA = (6.5, 6.0, 4.5, 0.0, 0.0, 0.0)
FAILS = {"faults": {"wheel_loss": 1.0, "wheel_loss_size": (1.0, 1.0), "time": (0.1, 0.1)}}
SOFTENS = {"faults": {"wheel_loss": 1.0, "wheel_loss_size": (0.5, 0.5), "time": (0.1, 0.1)}}


def motors_after(seconds, scenario, count=12):
    """Plants and motors' estimates of episodes in which the axes reverse by turns every 5 s."""
    env = SatInertiaIDVectorEnv(count, "microsat", "static", scenario, control="rate", num_threads=1)
    env.reset(seed=seeds("tuning", count))
    for decision in range(seconds):
        sides = np.where((decision / 15.0 + np.arange(3) / 3.0) % 1.0 < 0.5, 0.7, -0.7)
        env.step(np.tile(sides, (count, 1)).astype(np.float32))
    return env.fleet.rows.plants, env.fleet.rows.tasks["tracking"]["motors"]


@cases(("scenario", "left"), [(FAILS, 0.05), (SOFTENS, 0.5)])
def test_what_a_motor_has_lost_is_known_after_one_reversal_of_each_axis(scenario, left):
    """Ten seconds after the loss; by forgetting alone, with 30 s, a third of it would be known."""
    plants, motors = motors_after(40, scenario)
    rows, weak = np.arange(len(plants)), plants["wheel_loss_wheel"]
    np.testing.assert_allclose(motors["gain"][rows, weak], left, atol=0.08)
    others = np.ones(motors["gain"].shape, bool)
    others[rows, weak] = False
    np.testing.assert_allclose(motors["gain"][others], 1.0, atol=0.15)


@cases(
    "scenario",
    [
        {},
        {"friction": {"coulomb": 0.01, "static": 0.015}},
        {"inertia_std": 0.3},
        {"sample_period": 1.0},
        {"torque_noise": 0.15, "tachometer_noise_std": 1.0},
    ],
)
def test_noise_and_friction_are_not_taken_for_a_loss(scenario):
    _, motors = motors_after(200, scenario)
    np.testing.assert_array_equal(motors["expected"], 1.0)


def test_of_four_wheels_the_others_take_over(pyramid):
    """2.5 % of the time was outside when the loss was learned with 30 s."""
    assert flown("rate", {"faults": {"wheel_loss": 1.0}}, pyramid) <= 0.01


def test_of_three_wheels_the_others_keep_the_axis_that_is_lost():
    """A quarter of the time was outside while the loop did not turn about the others for its sake."""
    assert flown("rate", {"faults": {"wheel_loss": 1.0, "wheel_loss_size": (1.0, 1.0)}}) <= 0.015


@pytest.mark.parametrize("satellite", ["microsat", "smallsat"])
def test_one_sample_a_second_is_enough(satellite):
    """What a sample leaves unexplained is noise, of which the loop took the half for a torque that stays."""
    assert flown("rate", {"sample_period": 1.0}, satellite) <= 0.01


def pushed(rates, momentum):
    """Rate of change of the x component of momentum that body rates bring about with it."""
    return np.cross([1.0, 0.0, 0.0], momentum) @ np.array(rates)


def test_a_reference_that_keeps_the_lost_axis_inside_stays_but_for_that_axis():
    state = (0.2 * LIMIT, 0.0, 0.0), (0.0, 0.01, 0.0), INERTIA
    wanted = constrain((0.9 * LIMIT, 0.9 * LIMIT, -0.9 * LIMIT), (1.0, 0.0, 0.0), state, LIMIT)
    np.testing.assert_allclose(wanted, [0.2 * LIMIT, 0.9 * LIMIT, -0.9 * LIMIT])


def test_a_lost_axis_is_brought_back_as_far_as_references_reach():
    """It is turning at its limit, 0.15 of it beyond what is kept: dp/dt is to be -0.4 / s of that, or what there is."""
    momentum = np.array([0.1, 0.3, -0.2])
    state = (LIMIT, 0.0, 0.0), tuple(momentum), INERTIA
    least = -0.4 * 0.15 * 6.5 * LIMIT
    for reference in ((0.0, 0.9, 0.9), (0.0, -0.9, 0.9), (0.0, 0.9, -0.9), (0.0, 0.1, 0.0)):
        asked = LIMIT * np.array(reference)
        wanted = np.array(constrain(tuple(asked), (1.0, 0.0, 0.0), state, LIMIT))
        cap = np.maximum(np.abs(asked), 0.5 * LIMIT)
        most = -np.abs(np.cross([1.0, 0.0, 0.0], momentum)) @ cap
        assert pushed(wanted, momentum) <= max(least, most) + 1e-12
        assert (np.abs(wanted[1:]) <= cap[1:] + 1e-12).all()


def test_without_momentum_no_rate_can_help_and_none_is_changed():
    state = (LIMIT, 0.0, 0.0), (0.0, 0.0, 0.0), INERTIA
    wanted = constrain((0.0, 0.02, -0.01), (1.0, 0.0, 0.0), state, LIMIT)
    np.testing.assert_allclose(wanted, [LIMIT, 0.02, -0.01])
