"""Planning with the filter that flies: its rehearsals come true, and what the policy asks for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from agents.dataset.flights import record
from baselines.scenarios.flights import Cell, flown
from satid_gym import SATELLITES, Pilot, SatInertiaIDVectorEnv
from satid_gym.control.planning import mode_doubles
from satid_gym.control.planning.rehearsal import Trail
from satid_gym.core.jit import kernel
from satid_gym.evaluation import fly, seeds
from satid_gym.policies import make_baseline
from satid_gym.policies.filter_mpc import FilterMPCPolicy
from satid_gym.policies.lookahead import LookaheadPolicy
from satid_gym.policies.mpc import MPCPolicy
from satid_gym.policy import missions, show_filter
from satid_gym.problem import problem
from satid_gym.scenario_catalogue import SCENARIOS
from tests.cases import cases
from tests.rehearse import rehearse

SETTINGS = {"control": "rate", "observation": "body"}


def expected_error(beliefs):
    """(N,) as `rehearsal` has it, by numpy."""
    scale = beliefs["theta_scale"]
    p = scale.shape[1]
    covariance = beliefs["covariance"][:, 3 : 3 + p, 3 : 3 + p]
    return np.exp(0.5 * np.linalg.slogdet(covariance)[1] / p - np.log(scale).mean(axis=1))


def rehearsed(policy, env, plan):
    """Trails of a plan (H, 3) that is not changed, one an environment, from where each of them is."""
    policy.see(env.fleet.rows.beliefs, env.fleet.rows.tasks)
    return rehearse(policy, np.broadcast_to(plan, (env.num_envs, *plan.shape)))


@cases(
    ("scenario", "warm", "step", "tolerance"),
    [("default", 60, 0.1, 0.12), ("default", 60, 0.5, 0.15), ("flex", 60, 0.1, 0.15), ("calibration", 60, 0.1, 0.1)],
)
def test_what_is_rehearsed_comes_true(scenario, warm, step, tolerance):
    """The error that the filter expects after 30 decisions of a plan, by rehearsal and by flight with noise.

    The filter does not adapt: what it learns of its own process noise depends on noise that nobody can foresee. What
    is promised is a little too much error: motors' noise tells of the inertia too.
    """
    env = SatInertiaIDVectorEnv(8, "microsat", "static", scenario, {"name": "momentum", "adaptive": False}, **SETTINGS)
    policy = FilterMPCPolicy(horizon=30, step=step)
    policy.reset(missions(env.problem)[0], range(8))
    env.reset(seed=3)
    square = np.where(np.arange(warm)[:, None] % 24 < [8, 12, 14], 0.5, -0.5)
    for command in square:
        env.step(np.tile(command, (8, 1)))
    plan = np.zeros((30, 3))
    plan[:12], plan[12:18] = (0.4, -0.4, 0.4), (-0.4, 0.4, 0.2)  # then a stop, for the stars
    before = expected_error(env.fleet.rows.beliefs)
    promised = np.array([expected_error(trail.beliefs[-1:])[0] for trail in rehearsed(policy, env, plan)])
    for command in plan:
        env.step(np.tile(command, (8, 1)))
    after = expected_error(env.fleet.rows.beliefs)
    assert np.abs(np.log(after / before)).min() > 3.0 * tolerance, "there is something to foresee"
    np.testing.assert_allclose(promised, after, rtol=tolerance)


@kernel
def _bend(beliefs, doubles, turned, dt, out):
    mode_doubles.begin(beliefs[0], doubles, 0.0)
    for i in range(turned.shape[0]):
        mode_doubles.bend(beliefs[0], doubles, (turned[i, 0], turned[i, 1], turned[i, 2]), dt)
        out[i] = doubles[0, 0, 0]


def test_doubles_move_as_oscillators_do():
    """Against scipy's integrator, a rate that speeds up and holds."""
    env = SatInertiaIDVectorEnv(1, "microsat", "static", "flex", **SETTINGS)
    env.reset(seed=1)
    beliefs = env.fleet.rows.beliefs
    dt, turned = 0.02, np.zeros((400, 3))
    turned[:50] = np.array([1e-4, -2e-4, 1e-4])
    eta, doubles = np.empty(400), np.zeros((beliefs["modes"]["coupling"].shape[1], 2, mode_doubles.FIELDS))
    _bend(beliefs, doubles, turned, dt, eta)
    modes = beliefs["modes"][0]
    w, zeta, push = modes["w"][0], modes["zeta"][0], modes["d"][0] @ turned[0] / dt
    first = beliefs["mean"][0, modes["first"]]

    def slope(t, y):
        return y[1], -(w**2) * y[0] - 2.0 * zeta * w * y[1] - (push if t < 50 * dt else 0.0)

    speed = beliefs["mean"][0, modes["first"] + 1] - modes["d"][0] @ rate_of(beliefs[0])
    true = solve_ivp(slope, (0.0, 400 * dt), (first, speed), t_eval=dt * np.arange(1, 401), rtol=1e-9, max_step=dt)
    np.testing.assert_allclose(eta, true.y[0], atol=0.02 * np.abs(true.y[0]).max())


def rate_of(belief):
    """Body rate of a belief whose modes are at rest, rad/s."""
    J, d = np.zeros((3, 3)), belief["modes"]["d"]
    J[np.triu_indices(3)] = belief["mean"][3:9][[0, 3, 4, 1, 5, 2]] if belief["prior_theta"].size == 6 else 0.0
    if belief["prior_theta"].size == 3:
        J[np.diag_indices(3)] = belief["mean"][3:6]
    J = J + np.triu(J, 1).T
    at = belief["modes"]["first"] + 5 * np.arange(len(d)) + 1
    body = belief["mean"][:3] - belief["wheel_input"][:3] - belief["mean"][at] @ d
    return np.linalg.solve(J - d.T @ d, body)


@pytest.mark.slow
def test_it_finds_stops_for_the_stars_that_a_planner_without_them_does_not():
    cell, those = Cell(scenario="calibration", satellite="microsat", inertia="static"), seeds("validation", 4)
    ours, blind = (flown(cell, policy, those) for policy in (FilterMPCPolicy(), MPCPolicy(margin=3.5)))
    assert ours.inside(0.01)
    assert ours.expected.mean() < 0.6 * blind.expected.mean()


def test_a_pilot_and_an_evaluation_show_it_the_filter():
    policy = make_baseline("filter_mpc", "microsat")
    satellite = problem("microsat", "static", "tight").satellites[0]
    pilot = Pilot(satellite, policy, scenario="tight", control="rate")
    torque = pilot.start(0.0, np.zeros(3), np.zeros(3))
    assert np.abs(torque).max() > 0.0
    short = FilterMPCPolicy(horizon=8, edits=4)
    flight = fly(short, satellite="microsat", inertia="static", seeds=[1, 2], control="rate")
    assert (flight.error[-1] < 0.005).all()
    assert flight.outside.mean() < 0.01


@cases(
    ("settings", "message"),
    [
        ({"control": "torque"}, 'make the environment with control="rate"'),
        ({"estimator": "rate", "control": "rate"}, "the filter is RateEKFSettings: make .* swing_and_stop"),
    ],
)
def test_where_it_cannot_plan(settings, message):
    posed = problem("microsat", "static", **settings)
    with pytest.raises(ValueError, match=message):
        FilterMPCPolicy().reset(missions(posed)[0], [0])


def test_without_the_filter_it_says_what_to_do():
    posed = problem("microsat", "static", **SETTINGS)
    policy = FilterMPCPolicy()
    policy.reset(missions(posed)[0], [0])
    observation = np.zeros((1, max(place.stop for place in posed.layout.values())))
    with pytest.raises(RuntimeError, match=r"call satid_gym\.policy\.show_filter before each decision"):
        policy(observation)


def test_a_batch_flies_as_each_of_it_alone():
    actions = []
    for numbers in ([3, 4], [3], [4]):
        env = SatInertiaIDVectorEnv(len(numbers), "cubesat", "step", **SETTINGS)
        policy = FilterMPCPolicy(horizon=10, edits=6)
        policy.reset(missions(env.problem)[0], numbers)
        observation, _ = env.reset(seed=numbers)
        chosen = []
        for _ in range(5):
            show_filter(policy, env.fleet.rows.beliefs, env.fleet.rows.tasks)
            chosen.append(policy(observation))
            observation = env.step(chosen[-1])[0]
        actions.append(np.array(chosen))
    np.testing.assert_array_equal(actions[0], np.concatenate(actions[1:], axis=1))


@cases("settings", [{"horizon": 1}, {"edits": 0}, {"amplitude": 0.0}, {"caution": -1.0}, {"step": 0.0}, {"tail": -1.0}])
def test_settings_out_of_range(settings):
    with pytest.raises(ValueError, match=next(iter(settings))):
        FilterMPCPolicy(**settings)


@pytest.mark.interpreted
def test_a_trail_has_room_for_the_plan():
    env = SatInertiaIDVectorEnv(1, "microsat", "static", "flex", **SETTINGS)
    env.reset(seed=0)
    policy = FilterMPCPolicy(horizon=6)
    policy.reset(missions(env.problem)[0], [0])
    (trail,) = rehearsed(policy, env, np.zeros((6, 3)))
    assert isinstance(trail, Trail)
    assert len(trail.losses) == 7
    np.testing.assert_allclose(np.diff(trail.losses), expected_error(trail.beliefs[1:]), rtol=1e-9)
    assert trail.tasks["decision"].tolist() == list(range(7))


@pytest.mark.interpreted
@cases("policy", [FilterMPCPolicy(horizon=3, edits=2), LookaheadPolicy("rigid_tour", horizon=3)])
def test_data_sets_have_the_flights_of_policies_that_plan_with_the_filter(policy):
    """They are shown the filter, and not the covariance that is recorded in addition."""
    short = SCENARIOS["default"].replace(name="short", horizon=6.0)
    cell = {"satellite": SATELLITES["microsat"], "inertia": "static", "scenario": short, "control": "rate"}
    flight = fly(policy, seeds=seeds("training", 2), **cell)
    for i, episode in enumerate(record(policy, seeds=seeds("training", 2), include_covariance=True, **cell)):
        np.testing.assert_array_equal(episode.infos["relative_error"][1:], flight.error[:, i])
        np.testing.assert_array_equal(episode.rewards, flight.reward[:, i])
