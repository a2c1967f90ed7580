"""The single environment: conventions, determinism, refusals that change nothing, and plugged-in filters."""

from __future__ import annotations

import copy
import json
import pickle
import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_for_sb3

import satid_gym
from satid_gym import SATELLITES, InertiaLaw, Satellite, SatInertiaIDEnv, SatInertiaIDVectorEnv
from satid_gym.estimators import (
    AdaptiveEKF,
    FilterpyAdaptiveEKF,
    FilterpyMomentumEKF,
    FilterpyMomentumUKF,
    FilterpyRateEKF,
    MomentumEKF,
    RateEKF,
)
from satid_gym.gym_api import INFO_KEYS
from satid_gym.problem import problem
from tests.cases import cases


def actions(count: int, wheels: int = 3, seed: int = 0) -> np.ndarray:
    """Held for five decisions, so that the body swings."""
    drawn = np.random.default_rng(seed).uniform(-0.2, 0.2, (count // 5 + 1, wheels))
    return np.repeat(drawn, 5, axis=0)[:count].astype(np.float32)


def fly(env: gymnasium.Env, commands: np.ndarray) -> list:
    """What every step returned."""
    return [env.step(action) for action in commands]


def assert_same_steps(one: list, other: list, tolerance: float = 0.0) -> None:
    for (a, ra, ta, ua, ia), (b, rb, tb, ub, ib) in zip(one, other, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=tolerance)
        assert ra == pytest.approx(rb, rel=0, abs=tolerance)
        assert (ta, ua) == (tb, ub)
        assert list(ia) == list(ib)
        for key, value in ia.items():
            if key == "costs":
                assert value == pytest.approx(ib[key], rel=tolerance, abs=tolerance)
            else:
                np.testing.assert_allclose(value, ib[key], rtol=tolerance, atol=tolerance, err_msg=key)


def state_of(env: SatInertiaIDEnv) -> bytes:
    """Everything a step could change."""
    return b"".join(part.tobytes() for part in env.fleet.rows)


# Gymnasium


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"satellite": "random"},
        {"scenario": "paper"},
        {"scenario": "tight"},
        {"scenario": "faults"},
        {"estimator": "rate"},
        {"estimator": "adaptive"},
        {"include_covariance": True},
        {"estimator": "rate", "include_covariance": True},
        {"control": "rate"},
        {"scenario": "flex", "control": "rate", "observation": "body"},
        {"scenario": "slosh"},
        {"scenario": "calibration", "control": "rate", "observation": "body"},
        {"scenario": "operations", "control": "rate", "observation": "body"},
        {"scenario": "wheels4", "control": "rate"},
    ],
    ids=str,
)
def test_gymnasiums_and_sb3s_checkers_have_nothing_to_say(settings):
    env = gymnasium.make("SatInertiaID-v0", disable_env_checker=True, **settings).unwrapped
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env, skip_render_check=False)
        check_env_for_sb3(env)


def test_every_way_to_make_it():
    for env in (
        gymnasium.make("SatInertiaID-v0", satellite="cubesat", max_episode_steps=7),
        gymnasium.make("satid_gym:SatInertiaID-v0", satellite="cubesat", max_episode_steps=7),
    ):
        assert isinstance(env.unwrapped, SatInertiaIDEnv)
        env.reset(seed=0)
        ends = [env.step(np.zeros(3, np.float32))[2:4] for _ in range(7)]
        assert ends == [(False, False)] * 6 + [(False, True)]
    for mode in (None, "vector_entry_point", "sync"):
        envs = gymnasium.make_vec("satid_gym:SatInertiaID-v0", num_envs=3, vectorization_mode=mode, satellite="cubesat")
        assert isinstance(envs.unwrapped, SatInertiaIDVectorEnv) == (mode != "sync")
        observation, _ = envs.reset(seed=0)
        assert observation.shape == (3, 37)
        envs.close()


def test_make_and_make_vec_agree_on_the_horizon():
    """By the scenario: `gymnasium.make` keeps max_episode_steps for its TimeLimit."""
    one = gymnasium.make("SatInertiaID-v0", scenario={"horizon": 7.0})
    many = gymnasium.make_vec("SatInertiaID-v0", num_envs=1, max_episode_steps=7)
    one.reset(seed=0)
    many.reset(seed=0)
    action = np.zeros(3, np.float32)
    np.testing.assert_array_equal(one.step(action)[0], many.step(action[None])[0][0])


@pytest.mark.compiled
def test_a_new_process_finds_it_by_its_module_name():
    code = "import gymnasium; gymnasium.make('satid_gym:SatInertiaID-v0').reset(seed=0)"
    subprocess.run([sys.executable, "-W", "error::DeprecationWarning:satid_gym", "-c", code], check=True)


def test_spec_and_problem_go_to_json_and_back():
    made = gymnasium.make(
        "SatInertiaID-v0",
        satellite=SATELLITES["cubesat"].to_dict(),
        inertia="drift",
        reward="trace",
        include_covariance=True,
    )
    spec = EnvSpec.from_json(made.spec.to_json())
    again = gymnasium.make(spec)
    assert again.unwrapped.problem == made.unwrapped.problem
    values = json.loads(json.dumps(made.unwrapped.problem.to_dict(), allow_nan=False))
    settings = [values[name] for name in ("satellites", "inertia", "scenario", "estimator", "reward")]
    built = SatInertiaIDEnv(*settings, include_covariance=values["include_covariance"])
    assert built.problem == made.unwrapped.problem
    for env in (made, again, built):
        env.reset(seed=3)
    commands = actions(10)
    flights = [fly(env.unwrapped, commands) for env in (made, again, built)]
    assert_same_steps(flights[0], flights[1])
    assert_same_steps(flights[0], flights[2])


def test_returned_types_are_pythons():
    env = SatInertiaIDEnv()
    observation, info = env.reset(seed=0)
    assert observation.dtype == np.float32
    _, reward, terminated, truncated, info = env.step(np.zeros(3))
    assert (type(reward), type(terminated), type(truncated)) == (float, bool, bool)
    assert tuple(info) == INFO_KEYS
    for key, value in info.items():
        assert type(value) in (bool, float, int, np.ndarray, dict), key
    assert {type(cost) for cost in info["costs"].values()} == {float}
    assert info["saturated"].dtype == bool
    assert info["inertia_true"].shape == info["inertia_estimate"].shape == (3, 3)


def test_docstring_is_the_specification():
    for word in (*INFO_KEYS, *SatInertiaIDEnv(include_covariance=True).layout, "Terminated", "Truncated"):
        assert word in SatInertiaIDEnv.__doc__, word


def test_public_names():
    for name in satid_gym.__all__:
        assert getattr(satid_gym, name) is not None
    assert len(satid_gym.__version__.split(".")) == 3


# Episodes


def test_truncated_at_the_horizon_and_then_needs_a_reset():
    env = SatInertiaIDEnv(max_episode_steps=3)
    env.reset(seed=0)
    ends = [step[2:4] for step in fly(env, actions(3))]
    assert ends == [(False, False), (False, False), (False, True)]
    before = state_of(env)
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        env.step(np.zeros(3))
    assert state_of(env) == before
    env.reset()
    env.step(np.zeros(3))


def test_terminated_beyond_three_times_the_rate_limit():
    env = SatInertiaIDEnv("cubesat")
    _, info = env.reset(seed=0)
    terminated, peak = False, 0.0
    while not terminated:
        *_, terminated, truncated, info = env.step(np.array([1.0, 0.0, 0.0], np.float32))
        peak = np.abs(env.fleet.rows.plants["rate"][0]).max()
        assert terminated == (peak > 3.0 * 0.05)
        assert not truncated
    assert info["cost"] == 1.0
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(3))


def test_a_generator_that_was_looked_at_before_the_first_reset_starts_the_stream_all_the_same():
    """Its draws were all zero, so that the reset went on for ever."""
    env = SatInertiaIDEnv()
    assert env.np_random is not None
    _, info = env.reset()
    assert (np.linalg.eigvalsh(info["inertia_true"]) > 0.0).all()
    assert env.fleet.rows.plants["stream"].any()


def test_step_before_the_first_reset():
    env = SatInertiaIDEnv()
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"no episode was started: call reset\(\) before step"):
        env.step(np.zeros(3))


def test_time_and_torque_in_info():
    env = SatInertiaIDEnv(scenario={"torque_noise": 0.0, "termination_factor": 100.0})
    env.reset(seed=0)
    for i, (_, _, _, _, info) in enumerate(fly(env, np.full((5, 3), [0.1, -0.2, 3.0], np.float32))):
        assert info["time"] == pytest.approx(i + 1.0, rel=1e-12)
        np.testing.assert_allclose(info["torque_applied"], [0.01, -0.02, 0.1], rtol=1e-6)
        assert not info["saturated"].any()


def test_a_wheel_at_its_speed_limit_is_reported():
    env = SatInertiaIDEnv(scenario={"name": "tight", "termination_factor": 100.0})
    env.reset(seed=0)
    steps = fly(env, np.full((10, 3), [1.0, 0.0, 0.0], np.float32))
    assert steps[-1][4]["saturated"].tolist() == [True, False, False]
    assert abs(steps[-1][4]["torque_applied"][0]) < 1e-3


def test_relative_error_and_nees_by_their_definitions():
    estimator = MomentumEKF()
    env = SatInertiaIDEnv(estimator=estimator)
    env.reset(seed=0)
    for *_, info in fly(env, actions(20)):
        truth, estimate = info["inertia_true"], info["inertia_estimate"]
        error = np.linalg.norm(estimate - truth) / np.linalg.norm(truth)
        assert info["relative_error"] == pytest.approx(error, rel=1e-12)
        e = np.diag(estimate - truth)
        covariance = estimator.covariance[3:6, 3:6]
    assert info["nees"] == pytest.approx(e @ np.linalg.solve(covariance, e) / 3.0, rel=1e-9)


def test_starting_state_follows_the_scenario():
    """2000 starts of the default scenario: true inertia, wheels, rates, laws and disturbance as specified."""
    env = SatInertiaIDVectorEnv(2000)
    _, info = env.reset(seed=0)
    satellite, plants = env.problem.satellites[0], env.fleet.rows.plants
    ratio = np.log(np.einsum("nii->ni", info["inertia_true"]) / np.diag(satellite.inertia))
    # an inertia that varies periodically starts anywhere within its few percent
    static = plants["law"] != 3
    spread = ratio[static].std()
    assert spread == pytest.approx(0.15, rel=5.0 / np.sqrt(2 * static.sum() * 3))
    assert abs(ratio[static].mean()) < 5.0 * 0.15 / np.sqrt(static.sum() * 3)
    wheels = plants["wheel_speed"] / 900.0
    assert np.abs(wheels).max() <= 0.2
    assert wheels.std() == pytest.approx(0.2 / np.sqrt(3), rel=0.05)
    assert plants["rate"].std() == pytest.approx(0.02 * 0.03, rel=0.05)
    counts = np.bincount(plants["law"], minlength=4)
    assert np.abs(counts - 500).max() < 5.0 * np.sqrt(2000 * 0.25 * 0.75)
    torque = plants["torque_constant"] + plants["torque_cosine"]
    assert torque.std() == pytest.approx(5e-5, rel=0.05)
    np.testing.assert_allclose(np.linalg.norm(plants["attitude"], axis=1), 1.0, rtol=1e-12)
    physical = np.sort(np.linalg.eigvalsh(info["inertia_true"]), axis=1)
    assert (physical[:, 0] + physical[:, 1] >= physical[:, 2]).all()
    # randomised laws, in the ranges of the design
    change = np.einsum("nii->ni", plants["change"])[:, 0] / np.einsum("nii->ni", plants["inertia"])[:, 0]
    for law, low, high in ((1, 0.05, 0.15), (2, 0.02, 0.08), (3, 0.01, 0.05)):
        drawn = change[plants["law"] == law]
        assert low <= drawn.min() < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < drawn.max() <= high
    times = plants["law_time"][plants["law"] == 1]
    assert 90.0 <= times.min() < 100.0
    assert 200.0 < times.max() <= 210.0


def test_satellite_random_draws_all_three():
    env = SatInertiaIDVectorEnv(300, "random")
    env.reset(seed=0)
    counts = np.bincount(env.fleet.rows.tasks["template"], minlength=3)
    assert np.abs(counts - 100).max() < 5.0 * np.sqrt(300 * 2 / 9)


# Determinism


def test_same_seed_same_episodes():
    first, second = SatInertiaIDEnv("random"), SatInertiaIDEnv("random")
    commands = actions(40)
    for env in (first, second):
        env.reset(seed=11)
    assert_same_steps(fly(first, commands), fly(second, commands))
    a, b = first.reset(), second.reset()
    np.testing.assert_array_equal(a[0], b[0])
    assert_same_steps(fly(first, commands), fly(second, commands))


def test_other_seeds_and_later_episodes_differ():
    env = SatInertiaIDEnv()
    observations = [env.reset(seed=seed)[0] for seed in range(5)] + [env.reset()[0] for _ in range(5)]
    assert len({o.tobytes() for o in observations}) == 10


def test_an_action_does_not_change_the_noise_that_follows():
    """The stream moves on by the same numbers whatever is commanded."""
    one, other = SatInertiaIDEnv(), SatInertiaIDEnv()
    for env in (one, other):
        env.reset(seed=0)
    fly(one, actions(10, seed=1))
    fly(other, actions(10, seed=2))
    np.testing.assert_array_equal(one.fleet.rows.plants["stream"], other.fleet.rows.plants["stream"])


@pytest.mark.parametrize(
    "copy_of", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["copy", "pickle"]
)
def test_a_copy_in_mid_episode_goes_on_as_the_original(copy_of):
    env = SatInertiaIDEnv("random", estimator={"name": "momentum", "inertia_walk": 0.002})
    env.reset(seed=5)
    fly(env, actions(20))
    twin = copy_of(env)
    before = state_of(env)
    expected = fly(twin, actions(30, seed=1))
    assert state_of(env) == before, "the copy shares nothing"
    assert_same_steps(fly(env, actions(30, seed=1)), expected)
    np.testing.assert_array_equal(env.reset()[0], twin.reset()[0])


# Options


def test_options_hold_for_one_episode():
    full = {"name": "adaptive", "parameters": "full"}
    env = SatInertiaIDEnv(["microsat", "smallsat"], estimator=full)
    truth = np.array([[6.0, 0.2, 0.1], [0.2, 5.5, 0.0], [0.1, 0.0, 5.0]])
    _, info = env.reset(seed=0, options={"satellite": "microsat", "inertia": "drift", "true_inertia": truth})
    np.testing.assert_allclose(info["inertia_true"], truth, rtol=1e-12)
    *_, info = fly(env, actions(10))[-1]
    growth = info["inertia_true"][0, 0] / 6.0
    assert growth > 1.0
    np.testing.assert_allclose(info["inertia_true"], growth * truth, rtol=1e-12)
    _, later = env.reset(seed=0)
    _, plain = SatInertiaIDEnv(["microsat", "smallsat"], estimator=full).reset(seed=0)
    np.testing.assert_array_equal(later["inertia_true"], plain["inertia_true"])


def test_satellite_option_flies_that_satellite():
    env = SatInertiaIDEnv("microsat")
    _, info = env.reset(seed=0, options={"satellite": "cubesat"})
    assert info["inertia_estimate"][0, 0] == pytest.approx(0.26)
    env.step(np.full(3, 0.1))
    _, info = env.reset(seed=0)
    assert info["inertia_estimate"][0, 0] == pytest.approx(6.53)


def test_a_law_as_option():
    env = SatInertiaIDEnv()
    law = {"mode": "step", "time": 2.0, "change": [0.5, 0.3, 0.2]}
    for value in (law, InertiaLaw(**law)):
        env.reset(seed=0, options={"inertia": value, "true_inertia": (6.0, 5.5, 5.0)})
        steps = fly(env, actions(3))
        moments = [np.diag(step[4]["inertia_true"]) for step in steps]
        np.testing.assert_allclose(moments, [[6.0, 5.5, 5.0], [6.5, 5.8, 5.2], [6.5, 5.8, 5.2]])


# Refusals change nothing


@pytest.fixture
def flying() -> SatInertiaIDEnv:
    env = SatInertiaIDEnv()
    env.reset(seed=0)
    fly(env, actions(5))
    return env


@cases(
    ("action", "message"),
    [
        ([np.nan, 0.0, 0.0], r"action must be finite, got \[nan, 0.0, 0.0\]"),
        ([0.0, np.inf, 0.0], "action must be finite"),
        ([0.0, 0.0, -np.inf], "action must be finite"),
        ([0.0, 0.0], r"action must have shape \(3,\), got \(2,\)"),
        ([[0.0, 0.0, 0.0]], r"action must have shape \(3,\), got \(1, 3\)"),
        (0.0, r"action must have shape \(3,\), got \(\)"),
    ],
)
def test_a_bad_action_is_refused(action, message, flying):
    before = state_of(flying)
    with pytest.raises(ValueError, match=message):
        flying.step(action)
    assert state_of(flying) == before
    flying.step(np.zeros(3))


@cases(
    ("options", "message"),
    [
        ({"satelite": "cubesat"}, "unknown reset option 'satelite'.*Did you mean 'satellite'"),
        ({"satellite": "cubesatt"}, "unknown satellite 'cubesatt'.*Did you mean 'cubesat'"),
        ({"inertia": "stepp"}, "unknown inertia mode 'stepp'.*Did you mean 'step'"),
        ({"true_inertia": (1.0, 2.0, 9.0)}, "true inertia breaks the triangle inequality"),
        ({"true_inertia": (1.0, 2.0)}, r"true inertia must have shape \(3,\) or \(3, 3\), got \(2,\)"),
        ({"true_inertia": (1.0, np.nan, 1.0)}, "true inertia must be finite"),
        ({"true_inertia": (-1.0, 1.0, 1.0)}, "true inertia must be positive definite"),
        ({"true_inertia": [1e300] * 3}, r"true inertia .* within 1e-09 and 1e\+12 kg m\^2, got 1e\+300"),
        ({"true_inertia": np.diag([1e13] * 3)}, r"true inertia .* within 1e-09 and 1e\+12 kg m\^2, got 1e\+13"),
        ({"true_inertia": [1e-12] * 3}, r"true inertia .* within 1e-09 and 1e\+12 kg m\^2, got 1e-12"),
        ({"inertia": {"mode": "step", "change": [20.0, 0.0, 0.0]}}, "at the end of its step breaks the triangle"),
        ({"reset_mask": np.ones(1, bool)}, "unknown reset option 'reset_mask'"),
    ],
)
def test_a_bad_option_is_refused_and_the_episode_goes_on(options, message, flying):
    before, rng = state_of(flying), flying.np_random.bit_generator.state
    with pytest.raises(ValueError, match=message):
        flying.reset(seed=1, options=options)
    assert state_of(flying) == before
    assert flying.np_random.bit_generator.state == rng
    flying.step(np.zeros(3))


def test_an_option_with_another_number_of_wheels_is_refused(flying, pyramid):
    with pytest.raises(ValueError, match="must have 3 wheels, got 4"):
        flying.reset(options={"satellite": pyramid})


@cases("seed", [-1, 1.5, "0"])
def test_a_bad_seed_is_refused(seed, flying):
    before = state_of(flying)
    with pytest.raises(gymnasium.error.Error, match=r"[Ss]eed must be"):
        flying.reset(seed=seed)
    assert state_of(flying) == before
    flying.step(np.zeros(3))


def test_a_satellite_whose_draws_are_all_impossible_says_so():
    """No valid satellite comes to this: its template is spoiled by hand."""
    env = SatInertiaIDEnv(scenario={"inertia_std": 0.0})
    env.fleet.templates.records.plants["inertia"] = np.diag([6.0, 6.0, 13.0])
    with pytest.raises(ValueError, match=r"no physical inertia tensor in 1000 draws: .* lower them or change"):
        env.reset(seed=0)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(3))


def test_draws_next_to_impossible_ones_are_drawn_again():
    """Half the draws about a flat plate are impossible; none of those flies."""
    plate = Satellite("plate", (6.0, 6.0, 12.0), SATELLITES["microsat"].wheels)
    _, info = SatInertiaIDVectorEnv(500, plate).reset(seed=0)
    moments = np.linalg.eigvalsh(info["inertia_true"])
    assert (moments[:, 0] + moments[:, 1] > moments[:, 2]).all()


# Filters of one's own


@pytest.mark.parametrize(
    ("foreign", "own", "settings"),
    [
        (FilterpyMomentumEKF, "momentum", {}),
        (FilterpyRateEKF, "rate", {}),
        (MomentumEKF, "momentum", {"inertia_walk": 0.002, "substeps": 2}),
        (RateEKF, "rate", {"gyro_std": 1e-4}),
        (FilterpyAdaptiveEKF, "adaptive", {"log_q_drift": 1.0}),
        (AdaptiveEKF, "adaptive", {"inertia_walk_min": 0.001, "substeps": 2}),
    ],
)
@pytest.mark.parametrize("net", [False, True])
@pytest.mark.compiled
def test_a_plugged_in_filter_gives_what_the_compiled_one_gives(foreign, own, settings, net):
    asked = {"reward": {"net": net}, "include_covariance": True}
    compiled = SatInertiaIDEnv(estimator={"name": own} | settings, **asked)
    plugged = SatInertiaIDEnv(estimator=foreign(**settings), **asked)
    for _ in range(2):
        a, b = compiled.reset(seed=4), plugged.reset(seed=4)
        np.testing.assert_allclose(a[0], b[0], rtol=0, atol=1e-9)
        for x, y in zip(fly(compiled, actions(40)), fly(plugged, actions(40)), strict=True):
            # the observation is float32: one unit in its last place is the finest that can be asked of it
            np.testing.assert_allclose(x[0], y[0], rtol=2.0**-22, atol=1e-9)
            assert x[1] == pytest.approx(y[1], rel=0, abs=1e-9)
            assert x[2:4] == y[2:4]
            assert list(x[4]) == list(y[4])
            np.testing.assert_allclose(x[4]["inertia_estimate"], y[4]["inertia_estimate"], rtol=1e-9)
            for key in ("information_gain", "information_held", "relative_error"):
                assert x[4][key] == pytest.approx(y[4][key], rel=1e-7, abs=1e-8), key


@cases("coordinates", ["adaptive", "momenta", None])
def test_a_plugged_in_filter_in_unknown_coordinates_is_refused(coordinates):
    estimator = FilterpyMomentumEKF()
    estimator.coordinates = coordinates
    with pytest.raises(ValueError, match="unknown coordinates of the estimator"):
        SatInertiaIDEnv(estimator=estimator)


def test_an_unscented_filter_can_be_plugged_in():
    env = SatInertiaIDEnv(estimator=FilterpyMomentumUKF())
    env.reset(seed=0)
    *_, info = fly(env, actions(30))[-1]
    assert 0.0 < info["relative_error"] < 0.02
    assert info["information_held"] > 10.0


def test_plugged_in_filter_learns_of_the_satellite_the_episode_flies():
    env = SatInertiaIDEnv("microsat", estimator=FilterpyMomentumEKF())
    _, info = env.reset(seed=0, options={"satellite": "cubesat"})
    assert info["inertia_estimate"][0, 0] == pytest.approx(0.26)


# Any number of wheels, any tensor


def test_pyramid_of_four_wheels_on_a_full_tensor(pyramid):
    """All six parameters of a tilted body come out within 1 % of the tensor's norm."""
    env = SatInertiaIDEnv(
        pyramid, "static", {"tilt_std": 0.05}, {"name": "momentum", "parameters": "full", "inertia_walk": 0.0}
    )
    observation, info = env.reset(seed=0)
    assert env.action_space.shape == (4,)
    assert observation.shape == (16 + 8 + 30,)
    axes, authority = pyramid.wheels.axes, env.layout["control_authority"]
    assert np.abs(info["inertia_true"] - np.diag(np.diag(info["inertia_true"]))).max() > 0.1
    spread = np.linalg.pinv(axes)
    for step in range(150):
        target = 0.8 * np.where((step / 30.0 + np.arange(3) / 3.0) % 1.0 < 0.5, 1.0, -1.0)
        wanted = (observation[:3] - target) / observation[authority]
        command = spread @ wanted * 2.0
        observation, reward, terminated, _, info = env.step(np.clip(command, -1.0, 1.0).astype(np.float32))
        assert np.isfinite(reward)
        assert not terminated
    assert info["relative_error"] < 0.01
    assert info["nees"] < 10.0


def test_problem_is_what_was_asked_for():
    env = SatInertiaIDEnv("cubesat", "step", "tight", "rate", {"net": True}, 50, include_covariance=True)
    assert env.problem == problem("cubesat", "step", "tight", "rate", {"net": True}, 50, True)
    assert env.problem != problem("cubesat", "step", "tight", "rate", {"net": True}, 50)
    assert env.problem.scenario.decisions == 50
    assert (env.problem.scenario.name, env.problem.estimator.name) == ("tight", "rate")


@cases("estimator", ["momentum", "adaptive", "rate"])
def test_environments_share_their_dtypes(estimator):
    """Numba would compare at length, in every call, a dtype that is only equal to one it has seen."""
    one, other = (SatInertiaIDEnv("cubesat", estimator=estimator) for _ in range(2))
    many = SatInertiaIDVectorEnv(2, satellite="random", estimator=estimator)
    assert one.fleet.work.dtype is other.fleet.work.dtype
    for part in ("plants", "beliefs", "tasks", "reports"):
        assert getattr(one.fleet.rows, part).dtype is getattr(other.fleet.rows, part).dtype
        assert getattr(one.fleet.rows, part).dtype is getattr(many.fleet.rows, part).dtype
    for record in ("draws", "plants", "beliefs", "tasks"):
        assert getattr(one.fleet.templates.records, record).dtype is getattr(many.fleet.templates.records, record).dtype
