"""The rate loop where wheels or principal axes are not the body axes: against scipy, by hand, and in flight."""

import itertools

import numpy as np
import pytest
import scipy.optimize
from scipy.spatial.transform import Rotation

from satid_gym import ReactionWheels, Satellite, draw_satellites
from satid_gym.control.deadbeat import reach
from satid_gym.core.control.allocation import within_reach
from satid_gym.evaluation import benchmark_scenario, fly, seeds
from satid_gym.policies import build, find
from tests.cases import cases

UNIT = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
TILT = Rotation.from_rotvec(np.radians(35.0) * np.ones(3) / np.sqrt(3.0)).as_matrix()
PYRAMID = np.array([[1, 1, -1, -1], [1, -1, 1, -1], [1, -1, -1, 1]]) / np.sqrt(3.0)


def tensor(rng) -> np.ndarray:
    rotation = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    return rotation @ np.diag(rng.uniform(1.0, 1.8, 3)) @ rotation.T


def packed(matrix: np.ndarray) -> tuple[float, ...]:
    return tuple(float(matrix[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))


@cases("wheels", [3, 4, 6])
def test_shares_are_the_nearest_to_one_that_the_wheels_allow(wheels):
    """scipy's general solver for the same programme; distance is counted in shares."""
    rng = np.random.default_rng(wheels)
    bound, further = 0, []
    for _ in range(40):
        axes = rng.standard_normal((3, wheels))
        axes /= np.linalg.norm(axes, axis=0)
        allocation, inertia = np.linalg.pinv(axes), tensor(rng)
        target, bias = rng.uniform(-1.0, 1.0, 3), rng.uniform(-0.3, 0.3, wheels)
        limit = rng.uniform(0.35, 0.9, wheels)
        found = np.array(within_reach(tuple(target), packed(inertia), allocation, bias, limit))
        rows = allocation @ inertia @ np.diag(target)
        constraint = scipy.optimize.LinearConstraint(rows, -limit - bias, limit - bias)
        best = scipy.optimize.minimize(
            lambda s: ((1.0 - s) ** 2).sum(), np.zeros(3), bounds=[(0.0, 1.0)] * 3, constraints=[constraint],
            method="SLSQP", options={"ftol": 1e-12, "maxiter": 500},
        ).x  # fmt: skip
        share = found / target
        spent = np.abs(bias + allocation @ inertia @ found)
        assert (spent <= limit * (1.0 + 2e-9)).all()  # the allocation allows 1e-9 of rounding
        assert ((share >= 0.0) & (share <= 1.0 + 1e-12)).all()
        further.append(np.linalg.norm(1.0 - share) - np.linalg.norm(1.0 - best))
        bound += (best < 1.0 - 1e-6).any()
    assert bound > 20
    assert max(further) < 1e-6


def test_aligned_wheels_are_cut_one_by_one():
    """Nothing couples the axes: each goes as far as its own wheel can, whatever the others do."""
    found = within_reach((0.5, -2.0, 1.0), UNIT, np.eye(3), np.array([0.0, 0.5, 0.0]), np.full(3, 0.8))
    np.testing.assert_allclose(found, [0.5, -1.3, 0.8], atol=1e-9)


def test_a_small_correction_is_not_given_up_for_a_large_slew():
    """y and z ask for more than tilted wheels have; x, a hundredth of that, still gets nearly all of its way."""
    found = np.array(within_reach((0.02, 2.0, 2.0), UNIT, np.linalg.inv(TILT), np.zeros(3), np.full(3, 1.0)))
    assert found[0] > 0.98 * 0.02
    assert 0.1 < found[1] / 2.0 < 0.9
    assert 0.1 < found[2] / 2.0 < 0.9


def test_a_wheel_that_the_drift_alone_takes_beyond_its_limit_leaves_the_rest_of_the_way_at_nothing():
    found = within_reach((1.0, 1.0, 1.0), UNIT, np.eye(3), np.array([1.2, 0.0, 0.0]), np.ones(3))
    np.testing.assert_allclose(found, [0.0, 1.0, 1.0], atol=1e-9)


def test_the_reference_is_met_exactly_where_torque_suffices():
    """Free of limits the deadbeat law's end is the reference but for the second-order term of its mean rate."""
    rng = np.random.default_rng(0)
    inertia = tensor(rng)
    omega, wanted = (0.01, -0.02, 0.005), (-0.01, 0.0, 0.02)
    state = ((0.02, -0.01, 0.03), (1e-4, 0.0, -1e-4))
    free = (packed(inertia), packed(np.linalg.inv(inertia)))
    wheels = (np.eye(3), np.eye(3), np.full(3, 10.0))
    torque = np.empty(3)
    end = np.array(reach(omega, wanted, state, free, wheels, 1.0, torque))
    np.testing.assert_allclose(end, wanted, atol=1e-15)
    drift = np.cross(state[0], (np.array(omega) + wanted) / 2.0) + state[1]
    np.testing.assert_allclose(inertia @ (np.array(wanted) - omega), drift - torque, atol=1e-12)


def constants(kind: str, microsat: Satellite) -> Satellite:
    full = np.array([[6.5, 0.4, -0.3], [0.4, 6.0, 0.5], [-0.3, 0.5, 4.5]])
    pyramid = ReactionWheels(axes=PYRAMID, inertia=2e-3, max_torque=0.1, max_speed=900.0)
    return {
        "tilted wheels": microsat.replace(name="tilted", wheels=microsat.wheels.replace(axes=TILT)),
        "full tensor": microsat.replace(name="full", inertia=full),
        "pyramid": microsat.replace(name="pyramid", wheels=pyramid),
        "pyramid, full tensor": microsat.replace(name="pyramid_full", inertia=full, wheels=pyramid),
    }[kind]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "policy"),
    [
        ("tilted wheels", "generalist"),  # which was trained on three wheels and three moments
        *itertools.product(("tilted wheels", "full tensor", "pyramid", "pyramid, full tensor"), ("rate_square", "mpc")),
    ],
)
def test_no_policy_that_commands_rates_leaves_the_envelope(kind, policy, microsat):
    """Each wheel's torque cut by itself left it for 12 to 65 % of the time."""
    settings = {"rate_square": {"period": 24.0, "margin": 2.75}, "mpc": {}}
    pilot = find(policy) if policy == "generalist" else build(policy, settings[policy])
    count = 6 if policy == "mpc" else 24
    parameters = "full" if "full" in kind else "principal"
    scores = fly(
        pilot,
        satellite=constants(kind, microsat),
        inertia="static",
        seeds=seeds("validation", count),
        scenario=benchmark_scenario(),
        estimator={"name": "adaptive", "parameters": parameters},
    ).scores()
    assert scores["outside_fraction"].mean() <= 0.01
    assert 0.3 < scores["nees"].mean() < 2.0


@pytest.mark.compiled
@cases("policy", ["zero", "rate_square", "rigid_tour", "mpc"])
def test_no_policy_that_commands_rates_saturates_the_wheels(policy):
    """With a tenth of the momentum wheels were at their limit for 3 to 42 % of the time."""
    settings = {"period": 12.0, "margin": 3.5} if policy == "rate_square" else {}
    pilot = find(policy) if policy == "rigid_tour" else build(policy, settings)
    scores = fly(
        pilot, satellite="cubesat", inertia="static", scenario="tight", seeds=seeds("validation", 12), control="rate"
    ).scores()
    print(f"{policy}: saturated {scores['saturated_fraction'].mean():.3%}")
    assert scores["saturated_fraction"].mean() <= 0.002
    assert scores["outside_fraction"].mean() <= 0.005


@pytest.mark.compiled
@cases("policy", ["rigid_tour", "rate_square"])
def test_noise_drives_no_axis_out_of_the_envelope_while_others_turn(policy):
    """A slow satellite, whose wheels need all their torque for seconds: it was outside for 2 to 4 % of the time."""
    (slow,) = draw_satellites([2_000_000_014], wheels=4)
    pilot = build(policy, {"period": 9.0, "margin": 3.5}) if policy == "rate_square" else find(policy)
    those = seeds("validation", 8)
    scores = fly(pilot, satellite=slow, inertia="static", seeds=those, control="rate").scores()
    print(f"{policy}: outside {scores['outside_fraction'].mean():.3%}")
    assert scores["outside_fraction"].mean() <= 0.005
