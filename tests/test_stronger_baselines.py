"""Planning baselines: their forecast against what flights give, and what they reach."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from baselines import build
from baselines.tuning.open_loop_design import Design, information, search
from satid_gym import SATELLITES, SatInertiaIDVectorEnv
from satid_gym.control.planning.planner import Planner
from satid_gym.control.rate_loop import RateLoop
from satid_gym.evaluation import benchmark_scenario, fly, seeds
from satid_gym.policies.greedy import GreedyPolicy
from satid_gym.policies.mpc import MPCPolicy
from satid_gym.policies.open_loop_optimal import design_of, planned_rates
from satid_gym.policy import missions
from satid_gym.satellite import BENCHMARK_SATELLITES
from satid_gym.scenario import Scenario

QUIET = Scenario(torque_noise=0.0, inertia_std=1e-4, disturbance_scale=0.1)


def expected_error(planner: Planner) -> np.ndarray:
    """Relative error, root mean square, that the planner's filter expects: Frobenius norms of symmetric tensors."""
    theta = planner.beliefs["mean"][:, 3:-3]
    variance = np.diagonal(planner.beliefs["covariance"], axis1=1, axis2=2)[:, 3:-3]
    weight = np.array([1.0] * 3 + [2.0] * (theta.shape[1] - 3))
    return np.sqrt((variance * weight).sum(axis=1) / (theta**2 * weight).sum(axis=1))


@pytest.mark.interpreted
@pytest.mark.parametrize("parameters", ["principal", "full"])
@pytest.mark.parametrize("scenario", [QUIET, QUIET.replace(name="tight", wheel_speed_scale=0.1)])
def test_forecast_comes_true_where_nothing_disturbs(scenario: Scenario, parameters: str) -> None:
    estimator = {"name": "momentum", "parameters": parameters}
    env = SatInertiaIDVectorEnv(4, "microsat", "static", scenario, estimator)
    (mission,) = missions(env.problem)
    planner, loop = Planner(mission, 4, 1, 3.0), RateLoop([mission], 3.0)
    observation, _ = env.reset(seed=0)
    rng = np.random.default_rng(0)
    predicted, actual = [], []
    for t in range(40):
        command = rng.uniform(-1.0, 1.0, (4, 3))
        planner.observe(observation)
        before = expected_error(planner)
        forecast = planner.forecast(command[:, None, None])
        observation, *_ = env.step(loop(observation, command))
        if t > 4:
            after = expected_error(planner)
            planner.observe(observation)
            assert (after == before).all()  # a forecast leaves no trace
            assert np.abs(forecast.gained).min() > 0.0
            predicted.append(np.log(forecast.error[:, 0] / before))
            actual.append(np.log(expected_error(planner) / before))
    error = np.subtract(predicted, actual)  # gyro noise, of which the forecast knows nothing, is left
    assert np.std(error) < 0.08 * np.std(actual)


@pytest.mark.parametrize("walk", [0.004, 0.001])
@pytest.mark.parametrize("steps", [2, 10])
def test_the_planners_covariance_follows_the_filters(steps: int, walk: float) -> None:
    scenario = Scenario(estimator={"name": "momentum", "inertia_walk": walk})
    env = SatInertiaIDVectorEnv(8, "cubesat", "static", scenario)
    (mission,) = missions(env.problem)
    planner, loop = Planner(mission, 8, steps, 2.5), RateLoop([mission], 2.5)
    observation, _ = env.reset(seed=5)
    ratios = []
    for t in range(60):
        planner.observe(observation)
        block = planner.beliefs["covariance"][:, 3:6, 3:6]
        own = np.sqrt(np.diagonal(block, axis1=1, axis2=2)) / planner.beliefs["theta_scale"]
        told = 10.0 ** (observation[:, mission.layout["uncertainty"]] - 2.0)
        if t > 5:
            ratios.append(own / told)
        side = np.where((t // 10 + np.arange(3)) % 2 == 0, 1.0, -1.0)
        observation, *_ = env.step(loop(observation, np.broadcast_to(side, (8, 3))))
    spread = np.abs(np.log(ratios))
    assert np.median(spread) < (0.02 if steps == 10 else 0.3)  # longer steps forget in longer steps
    assert np.quantile(spread, 0.95) < (0.1 if steps == 10 else 0.4)


def test_a_planner_forecasts_with_a_walk_between_those_that_the_adaptive_filter_finds() -> None:
    """Under each inertia law the filter's own uncertainty is now above, now below what the planner keeps."""
    ratios = {}
    for mode in ("static", "periodic"):
        env = SatInertiaIDVectorEnv(8, "microsat", mode, benchmark_scenario())
        (mission,) = missions(env.problem)
        planner, loop = Planner(mission, 8, 2, 2.5), RateLoop([mission], 2.5)
        observation, _ = env.reset(seed=5)
        for t in range(120):
            planner.observe(observation)
            side = np.where((t // 10 + np.arange(3)) % 2 == 0, 1.0, -1.0)
            observation, *_ = env.step(loop(observation, np.broadcast_to(side, (8, 3))))
        planner.observe(observation)
        std = np.sqrt(np.diagonal(planner.beliefs["covariance"][:, 3:6, 3:6], axis1=1, axis2=2))
        told = 10.0 ** (observation[:, mission.layout["uncertainty"]] - 2.0)
        ratios[mode] = np.median(std / planner.beliefs["theta_scale"] / told)
    assert ratios["periodic"] < 0.9
    assert ratios["static"] > 1.5


def in_flight(satellite: str, inertia: str, side: Callable[[int], np.ndarray], seed: int) -> Planner:
    """A planner after 20 decisions of three episodes, in which the rates were those of `side` (3,)."""
    env = SatInertiaIDVectorEnv(3, satellite, inertia)
    (mission,) = missions(env.problem)
    planner, loop = Planner(mission, 3, 2, 2.5), RateLoop([mission], 2.5)
    observation, _ = env.reset(seed=seed)
    for t in range(20):
        planner.observe(observation)
        observation, *_ = env.step(loop(observation, np.tile(side(t), (3, 1))))
    planner.observe(observation)
    return planner


def test_a_reversal_pays_after_a_long_hold_if_one_looks_far_enough() -> None:
    """Why the one-step greedy policy needs a longer horizon: it sees what a reversal costs, not what it brings."""
    planner = in_flight("smallsat", "static", lambda t: np.ones(3), seed=1)
    hold, back = (side * np.ones((1, 1, 12, 3)) for side in (1.0, -1.0))
    assert (planner.forecast(back).gained > planner.forecast(hold).gained).all()
    assert (planner.forecast(back).error < planner.forecast(hold).error).all()


@pytest.mark.parametrize("ahead", [1, 7, 30])
def test_local_search_never_makes_a_plan_worse_and_soon_makes_it_better(ahead: int) -> None:
    """Judged by forecasts from the start, of which the search flies only what an edit changed."""
    planner = in_flight("cubesat", "drift", lambda t: np.where((t // 6 + np.arange(3)) % 2 == 0, 1.0, -1.0), seed=3)
    plans = np.ones((3, 30, 3))
    streams = np.random.default_rng(0).integers(1, 2**63, (3, 4), dtype=np.uint64)
    errors = []
    for _ in range(20):
        errors.append(planner.forecast(plans[:, None, :ahead]).error[:, 0])
        planner.improve(plans, streams, 5, ahead)
        assert (np.abs(plans) == 1.0).all()
    assert (np.diff(errors, axis=0) <= 0.0).all()
    assert (plans[:, ahead:] == 1.0).all()  # what lies beyond is left alone
    if ahead == 30:
        assert (errors[-1] < 0.95 * errors[0]).all()
        assert (np.diff(errors, axis=0) < 0.0).mean() > 0.3


@pytest.mark.parametrize("ahead", [1, 12, 30])
def test_an_advantage_is_what_the_other_side_would_cost(ahead: int) -> None:
    """Against forecasts of the two plans that turn to the other side, one by one."""
    planner = in_flight("cubesat", "static", lambda t: np.ones(3), seed=0)
    rng = np.random.default_rng(1)
    plans = np.where(rng.random((3, 30, 3)) < 0.2, 1.0, -1.0)
    plans[0, :, 0] = 1.0  # no reversal at all
    side_value = planner.side_value(plans, ahead)
    for i in range(3):
        for k in range(3):
            now, held = plans[:, :ahead].copy(), plans[:, :ahead].copy()
            now[i, 0, k] *= -1.0
            axis = plans[i, :ahead, k]
            until = next((t for t in range(ahead) if axis[t] != axis[0]), ahead)
            held[i, :until, k] *= -1.0
            own, *others = planner.forecast(np.stack([plans[:, :ahead], now, held], axis=1)).error[i]
            worth = ahead * (min(others) / own - 1.0)
            assert side_value[i, k] == pytest.approx(worth * plans[i, 0, k], rel=1e-9, abs=1e-12)
    assert (side_value * plans[:, 0] < 0.0).any() or ahead == 1  # a plan at random leaves something to gain


@pytest.mark.parametrize("policy", [GreedyPolicy("greedy", 1), GreedyPolicy("greedy_horizon", 4), MPCPolicy(edits=4)])
def test_episodes_do_not_depend_on_their_neighbours(policy: GreedyPolicy | MPCPolicy) -> None:
    cell = {"satellite": "cubesat", "inertia": "random", "scenario": Scenario(horizon=25.0)}
    three = fly(policy, seeds=[4, 5, 6], **cell)
    one = fly(policy, seeds=[5], **cell)
    np.testing.assert_array_equal(three.error[:, 1], one.error[:, 0])


@pytest.mark.parametrize("name", ["mpc", "greedy_horizon"])
@pytest.mark.parametrize("satellite", BENCHMARK_SATELLITES)
def test_planning_stays_inside_and_keeps_up_with_the_square_wave(name: str, satellite: str) -> None:
    cell = {"satellite": satellite, "inertia": "random", "seeds": seeds("validation", 10)}
    scores = fly(build(name, {}), scenario=benchmark_scenario(), **cell).scores()
    square = fly(build("rate_square", {"period": 24.0, "margin": 2.5}), scenario=benchmark_scenario(), **cell).scores()
    assert scores["outside_fraction"].mean() <= 0.01
    assert not scores["terminated"].any()
    assert scores["final_error"].mean() < 1.15 * square["final_error"].mean()
    assert scores["mean_error"].mean() < 1.1 * square["mean_error"].mean()


def test_bad_settings_are_refused() -> None:
    with pytest.raises(ValueError, match="horizon and steps must be integers of at least 1, got 0 and 2"):
        GreedyPolicy("greedy", 0)
    with pytest.raises(ValueError, match=r"at least 1, got 40, 1\.5 and 24"):
        MPCPolicy(steps=1.5)
    with pytest.raises(ValueError, match="at least 1, got 40, 2 and 0"):
        MPCPolicy(edits=0)
    with pytest.raises(ValueError, match="margin must be finite and at least 0"):
        MPCPolicy(margin=-1.0)
    with pytest.raises(ValueError, match="walk must be finite and at least 0"):
        MPCPolicy(walk=-0.001)


# open loop


def test_a_plan_is_flown_as_planned_by_the_nominal_satellite() -> None:
    """The exact truth, noise and disturbance off, follows the planned rates: no gyroscopic torque at zero momentum."""
    still = {"gravity_gradient": False, "solar_pressure": 0.0, "disturbance_scale": 0.0, "wheel_speed_range": 0.0}
    world = Scenario(
        inertia_std=0.0, torque_noise=0.0, initial_rate_std=0.0, gyro_noise_std=0.0, gyro_bias_walk=0.0, **still
    )
    env = SatInertiaIDVectorEnv(1, "smallsat", "static", world)
    (mission,) = missions(env.problem)
    design = design_of("smallsat", "default")
    policy = build("open_loop_optimal", {})
    policy.reset(mission, [0])
    longest = max(map(len, design["dwell"]))
    dwell = np.array([[*row, *[999] * (longest - len(row))] for row in design["dwell"]])
    planned = planned_rates(dwell, mission.satellite, design["fraction"], 300, 1.0)
    observation, _ = env.reset(seed=0)
    limit = mission.satellite.rate_limit
    for d in range(300):
        np.testing.assert_allclose(observation[0, :3] * limit, planned[d], atol=1e-6 * limit)
        observation, *_ = env.step(policy(observation))


def test_planned_rates_by_hand() -> None:
    satellite = SATELLITES["microsat"]
    rates = planned_rates(np.array([[2, 3], [3, 9], [9, 9]]), satellite, 0.5, 6, 1.0)
    slew = 0.95 * 0.1 / 6.53  # 0.0145 rad/s in a second about x: 0.015, the cap, in two
    np.testing.assert_allclose(rates[:, 0], [0.0, slew, 0.015, 0.015 - slew, 0.015 - 2 * slew, -0.015, -0.015 + slew])


def test_design_finds_more_than_a_regular_swing() -> None:
    satellite, world = SATELLITES["cubesat"], Scenario(horizon=60.0)
    plan, value = search(satellite, world, Design(rounds=6, population=32, elite=6))
    regular = np.full((3, 20), 12.0) + np.array([[0.0], [4.0], [8.0]]) * (np.arange(20) == 0)
    assert value > information(regular[None], satellite, world, 0.5)[0]
    assert value == pytest.approx(information(plan[None], satellite, world, 0.5)[0])


def test_what_was_not_designed_is_refused() -> None:
    with pytest.raises(
        ValueError, match=r"no open-loop design for satellite 'hubble'.*baselines.tuning.open_loop_design"
    ):
        design_of("hubble", "default")
    with pytest.raises(ValueError, match="fraction must be finite and more than 0 and at most 1"):
        build("open_loop_optimal", {"fraction": 1.5})
