"""Planning baselines: their forecast against what flights give, and what they reach."""

from __future__ import annotations

import numpy as np
import pytest

from baselines import build
from baselines.greedy import GreedyPolicy
from baselines.mpc import MPCPolicy
from baselines.planner import Planner
from baselines.rate_loop import RateLoop
from satid_gym import SATELLITES, SatInertiaIDVectorEnv
from satid_gym.evaluation import benchmark_scenario, fly, seeds
from satid_gym.policy import missions
from satid_gym.scenario import Scenario

QUIET = Scenario(torque_noise=0.0, inertia_std=1e-4, disturbance_scale=0.1)


def held(planner: Planner) -> np.ndarray:
    """Nats by which the planner's filter knows the inertia better than before launch."""
    block = planner.beliefs["covariance"][:, 3:-3, 3:-3]
    prior = planner.beliefs["prior_theta_std"]
    return -0.5 * (np.linalg.slogdet(block)[1] - 2.0 * np.log(prior).sum(axis=1))


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
        before = held(planner)
        forecast = planner.forecast(command[:, None, None])
        observation, *_ = env.step(loop(observation, command))
        if t > 4:
            after = held(planner)
            planner.observe(observation)
            assert (after == before).all()  # a forecast leaves no trace
            assert np.abs(forecast.gained).min() > 0.0
            predicted.append(forecast.held[:, 0] - before)
            actual.append(held(planner) - before)
    error = np.subtract(predicted, actual)  # gyro noise, of which the forecast knows nothing, is left
    assert np.std(error) < 0.05 * np.std(actual)


@pytest.mark.parametrize("steps", [2, 10])
def test_the_planners_covariance_follows_the_filters(steps: int) -> None:
    env = SatInertiaIDVectorEnv(8, "cubesat", "static")
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


def test_a_reversal_pays_after_a_long_hold_if_one_looks_far_enough() -> None:
    """Why the one-step greedy policy needs a longer horizon: it sees what a reversal costs, not what it brings."""
    env = SatInertiaIDVectorEnv(4, "smallsat", "static")
    (mission,) = missions(env.problem)
    planner, loop = Planner(mission, 4, 2, 2.5), RateLoop([mission], 2.5)
    observation, _ = env.reset(seed=1)
    for _ in range(20):
        planner.observe(observation)
        observation, *_ = env.step(loop(observation, np.ones((4, 3))))
    planner.observe(observation)
    hold, back = (side * np.ones((1, 1, 12, 3)) for side in (1.0, -1.0))
    assert (planner.forecast(back).gained > planner.forecast(hold).gained).all()
    assert (planner.forecast(back).held > planner.forecast(hold).held).all()


@pytest.mark.parametrize("policy", [GreedyPolicy("greedy", 1), GreedyPolicy("greedy_horizon", 4), MPCPolicy()])
def test_episodes_do_not_depend_on_their_neighbours(policy: GreedyPolicy | MPCPolicy) -> None:
    cell = {"satellite": "cubesat", "inertia": "random", "scenario": Scenario(horizon=25.0)}
    three = fly(policy, seeds=[4, 5, 6], **cell)
    one = fly(policy, seeds=[5], **cell)
    np.testing.assert_array_equal(three.error[:, 1], one.error[:, 0])


@pytest.mark.parametrize("name", ["mpc", "greedy_horizon"])
@pytest.mark.parametrize("satellite", SATELLITES)
def test_planning_stays_inside_and_keeps_up_with_the_square_wave(name: str, satellite: str) -> None:
    cell = {"satellite": satellite, "inertia": "random", "seeds": seeds("validation", 10)}
    scores = fly(build(name, {}), scenario=benchmark_scenario(), **cell).scores()
    square = fly(build("rate_square", {"period": 24.0, "margin": 2.5}), scenario=benchmark_scenario(), **cell).scores()
    assert scores["outside_fraction"].mean() <= 0.01
    assert not scores["terminated"].any()
    assert scores["final_error"].mean() < 1.15 * square["final_error"].mean()
    assert scores["mean_error"].mean() < 1.1 * square["mean_error"].mean()


def test_bad_settings_are_refused() -> None:
    with pytest.raises(ValueError, match="horizon and steps must be whole numbers of at least 1, got 0 and 2"):
        GreedyPolicy("greedy", 0)
    with pytest.raises(ValueError, match="horizon and steps must be whole numbers of at least 1, got 10 and 1.5"):
        MPCPolicy(steps=1.5)
    with pytest.raises(ValueError, match="margin must be finite and at least 0"):
        MPCPolicy(margin=-1.0)
