"""The rate loop of the environment, `control="rate"`: by hand, against the truth, and in the worlds it is made for."""

from __future__ import annotations

import pickle
import warnings

import numpy as np
import pytest

from satid_gym import SATELLITES, SCENARIOS, Pilot, SatInertiaIDEnv, SatInertiaIDVectorEnv
from satid_gym.control.rate_loop import RateMargin
from satid_gym.estimators import MomentumEKF
from satid_gym.evaluation import fly, seeds
from satid_gym.policies import build, make_baseline
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.policy import missions
from satid_gym.problem import problem
from satid_gym.sb3 import RateCommandVecEnv
from tests.cases import cases

QUIET = {
    "torque_noise": 0.0,
    "gyro_noise_std": 1e-9,
    "gyro_bias_walk": 0.0,
    "tachometer_noise_std": 1e-6,
    "disturbance_scale": 0.0,
    "gravity_gradient": False,
    "solar_pressure": 0.0,
    "initial_rate_std": 0.0,
    "wheel_speed_range": 0.0,
    "inertia_std": 0.0,
    "prior_std": 1e-4,
}
LIMIT = SATELLITES["microsat"].rate_limit


def test_a_small_step_is_followed_as_by_a_first_order_loop():
    """Of the error 1 - k dt = 0.9 is left after each sample: 1 - 0.9^10 of the step is made after ten, and so on."""
    env = SatInertiaIDEnv("microsat", "static", QUIET, control="rate")
    env.reset(seed=0)
    step = np.array([0.05, -0.03, 0.02])
    for decision in range(1, 5):
        env.step(step)
        expected = LIMIT * step * (1.0 - 0.9 ** (10 * decision))
        np.testing.assert_allclose(env.fleet.rows.plants["rate"][0], expected, rtol=2e-3)


def test_a_reference_with_a_slope_is_followed_at_that_slope():
    """Along a ramp of slope s a first-order loop of bandwidth k lags by s / k, and its rate grows by s a second."""
    env = SatInertiaIDEnv("microsat", "static", {**QUIET, "reference_slope": 0.25}, control="rate")
    slope = 0.25 * 0.1 / 6.53
    env.reset(seed=0)
    rates = []
    for _ in range(6):
        env.step(np.array([0.9, -0.9, 0.0]))
        rates.append(env.fleet.rows.plants["rate"][0].copy())
    grown = np.diff(rates, axis=0)[3:]  # the lag has settled, and the command, 7.05 s away, is not reached
    np.testing.assert_allclose(grown[:, 0], slope, rtol=0.02)
    np.testing.assert_allclose(grown[:, 1], -slope, rtol=0.02)
    for _ in range(8):
        env.step(np.array([0.9, -0.9, 0.0]))
    np.testing.assert_allclose(env.fleet.rows.plants["rate"][0, :2], [0.9 * LIMIT, -0.9 * LIMIT], rtol=0.02)
    env.reset(seed=0)
    env.step(np.zeros(3))
    assert np.abs(env.fleet.rows.plants["rate"][0]).max() < 1e-3 * LIMIT, "an episode begins with a reference of zero"


def test_a_bandwidth_beyond_half_a_sample_is_cut_to_it():
    env = SatInertiaIDEnv("microsat", "static", {**QUIET, "rate_bandwidth": 50.0}, control="rate")
    env.reset(seed=0)
    env.step(np.array([1e-3, 0.0, 0.0]))
    assert env.fleet.rows.plants["rate"][0, 0] == pytest.approx(1e-3 * LIMIT * (1.0 - 0.5**10), rel=1e-3)


def test_it_learns_how_strong_the_motors_are_and_what_their_bearings_take():
    """The truth is not told: a wheel that has lost 40 % of its torque, and Coulomb friction of 5 and 2 of 100 mN m."""
    world = {
        **QUIET,
        "torque_noise": 0.02,
        "wheel_speed_range": 0.2,
        "friction": {"coulomb": 5e-3},
        "faults": {"wheel_loss": 1.0, "wheel_loss_size": (0.4, 0.4), "time": (0.01, 0.01)},
    }
    env = SatInertiaIDEnv("microsat", "static", world, control="rate")
    for seed in range(3):
        env.reset(seed=seed)
        for decision in range(120):
            env.step(0.5 * np.where((decision / 16.0 + np.arange(3) / 3.0) % 1.0 < 0.5, 1.0, -1.0))
        motors = env.fleet.rows.tasks["tracking"]["motors"]
        weak = int(env.fleet.rows.plants["wheel_loss_wheel"][0])
        gains = np.where(np.arange(3) == weak, 0.6, 1.0)
        np.testing.assert_allclose(motors["gain"][0], gains, atol=0.06)
        np.testing.assert_allclose(motors["friction"][0], 0.05, atol=0.015)


def test_what_the_readings_say_of_a_motor_is_as_noisy_as_it_takes_them_for():
    """R_0 against drawn readings: white noise of tachometers, and angles that an encoder rounds to whole pulses."""
    rng, wheels = np.random.default_rng(0), SATELLITES["microsat"].wheels
    scale = wheels.inertia[0] / (0.1 * wheels.max_torque[0])
    exact = np.cumsum(rng.uniform(7.0, 8.0, 20_000))  # pulses that the wheel has turned
    rate = np.diff(2.0 * np.pi / 24 * (np.floor(exact) - exact)) / 0.1
    drawn = {
        "white": ({}, np.diff(SATELLITES["microsat"].tachometer_noise_std * rng.standard_normal(20_000))),
        "counted": ({"sensors": {"encoder_pulses": 24}}, np.diff(rate)),
    }
    for name, (world, change) in drawn.items():
        env = SatInertiaIDEnv("microsat", "static", {"torque_noise": 0.03, **world}, control="rate")
        expected = np.hypot(0.03, scale * np.std(change))
        prior = env.fleet.templates.records.tasks["tracking"]["motors"]["prior"][0, 0]
        np.testing.assert_allclose(np.sqrt(prior), expected / [0.16, 0.05], rtol=0.02, err_msg=name)


def test_wheels_that_turn_against_each_other_are_brought_to_share(pyramid):
    """What cancels among four wheels leaves within tens of seconds, and the body does not feel it."""
    env = SatInertiaIDEnv(pyramid, "static", {**QUIET, "wheel_speed_range": 0.3}, control="rate")
    env.reset(seed=1)
    axes = pyramid.wheels.axes
    null = np.linalg.svd(axes)[2][3]
    against, rates = [], []
    for _ in range(60):
        spin = pyramid.wheels.inertia * env.fleet.rows.plants["wheel_speed"][0]
        against.append(abs(null @ spin))
        env.step(np.zeros(3))
        rates.append(np.abs(env.fleet.rows.plants["rate"][0]).max())
    assert against[0] > 0.02
    assert against[-1] < 0.1 * against[0]
    assert max(rates) < 1e-3 * pyramid.rate_limit


def flown(control, scenario, satellite="microsat", episodes=8):
    """Share of the time outside the envelope."""
    policy = RateSquarePolicy(36.0, 3.5 if control == "rate" else 2.5)
    flight = fly(
        policy, satellite=satellite, inertia="static", seeds=seeds("validation", episodes), scenario=scenario,
        control=control,
    )  # fmt: skip
    return float(flight.scores()["outside_fraction"].mean())


@cases(
    ("name", "scenario", "most"),
    [
        ("as nominal", {}, 0.001),
        ("friction 5 of 100 mN m", {"friction": {"coulomb": 5e-3}}, 0.002),
        ("inertia off by 30 %", {"inertia_std": 0.3}, 0.005),
        ("commands 1 sample late", {"faults": {"torque_delay": (1, 1)}}, 0.005),
        ("commands 3 samples late", {"faults": {"torque_delay": (3, 3)}}, 0.01),
    ],
)
def test_rates_stay_inside_where_the_deadbeat_loop_does_not(name, scenario, most):
    assert flown("rate", scenario) <= most
    if "late" in name:
        assert flown("torque", scenario) > 0.2


def test_single_and_vector_agree_and_a_pickle_goes_on():
    settings = {"satellite": "microsat", "scenario": "faults", "control": "rate"}
    one, many = SatInertiaIDEnv(**settings), SatInertiaIDVectorEnv(3, **settings)
    assert one.action_space.shape == (3,)
    (a, _), (b, _) = one.reset(seed=5), many.reset(seed=4)
    rng = np.random.default_rng(0)
    for decision in range(12):
        np.testing.assert_array_equal(a, b[1])
        action = rng.uniform(-1.0, 1.0, 3).astype(np.float32)
        if decision == 6:
            one = pickle.loads(pickle.dumps(one))
        a, b = one.step(action)[0], many.step(np.tile(action, (3, 1)))[0]


def test_an_estimator_of_ones_own_steers_as_the_compiled_one():
    scenario = {"friction": {"coulomb": 5e-3}}
    own = SatInertiaIDEnv("microsat", "static", scenario, MomentumEKF(parameters="principal"), control="rate")
    compiled = SatInertiaIDEnv(
        "microsat", "static", scenario, {"name": "momentum", "parameters": "principal"}, control="rate"
    )
    own.reset(seed=3)
    compiled.reset(seed=3)
    rng = np.random.default_rng(0)
    for _ in range(10):
        action = rng.uniform(-0.5, 0.5, 3)
        (a, *_, one), (b, *_, other) = own.step(action), compiled.step(action)
        np.testing.assert_allclose(a, b, atol=2e-6)
        np.testing.assert_allclose(one["torque_applied"], other["torque_applied"], rtol=1e-7, atol=1e-12)


class Steps:
    """A policy that reverses half of the rate limit about every axis, every `held` decisions."""

    name, kind = "steps", "closed_loop"

    def __init__(self, held=6):
        self.held = held

    def reset(self, mission, seeds):
        self.decision = 0

    def __call__(self, observation):
        self.decision += 1
        return np.full((len(observation), 3), 0.5 if self.decision // self.held % 2 else -0.5)


def motors_of(pilot):
    return {name: pilot._tasks["tracking"]["motors"][name][0].copy() for name in ("gain", "friction")}


def by_pilot(period, lost=lambda time: False, blind=lambda time: False, horizon=88.0):
    """A pilot whose readings come every `period` seconds from an exact rigid body with Coulomb friction of 5 mN m.

    `lost` and `blind` say when there are no wheel speeds, and no gyro. Returns it and the rates (T, 3) over the limit.
    """
    satellite = SATELLITES["microsat"]
    wheels, J = satellite.wheels, satellite.inertia
    pilot = Pilot(satellite, Steps(), scenario={"horizon": 300.0}, control="rate", patience=0.5)
    rng = np.random.default_rng(0)
    free = np.linalg.inv(J - wheels.rotor_inertia)
    rate, speed, rates = np.zeros(3), np.array([100.0, -120.0, 140.0]), []
    torque = pilot.start(0.0, rate, speed)
    fine = 20
    for sample in range(1, round(horizon / period) + 1):
        for _ in range(fine):
            felt = torque - 5e-3 * np.sign(speed)
            spin = wheels.axes @ (wheels.inertia * speed)
            change = free @ (-wheels.axes @ felt - np.cross(rate, J @ rate + spin))
            speed = speed + period / fine * (felt / wheels.inertia - wheels.axes.T @ change)
            rate = rate + period / fine * change
        time = sample * period
        gyro = None if blind(time) else rate + satellite.gyro_noise_std * rng.standard_normal(3)
        torque = pilot.step(time, gyro, None if lost(time) else speed + 0.05 * rng.standard_normal(3))
        rates.append(rate / satellite.rate_limit)
    return pilot, np.array(rates)


@cases("period", [0.05, 0.1, 0.2])
def test_a_pilot_learns_the_same_of_the_motors_however_often_readings_come(period):
    pilot, rates = by_pilot(period)
    found = motors_of(pilot)
    np.testing.assert_allclose(found["gain"], 1.0, atol=0.1)
    np.testing.assert_allclose(found["friction"], 0.05, atol=0.02)
    np.testing.assert_allclose(np.abs(rates[-1]), 0.5, atol=0.03)


def test_a_pilot_that_coasted_does_not_take_the_coast_for_its_motors():
    """Six seconds without gyro, in which it commands nothing and friction slows the wheels."""
    before, _ = by_pilot(0.1, horizon=30.0)
    pilot, _ = by_pilot(0.1, blind=lambda time: 30.0 < time < 36.0, horizon=37.5)
    for name, value in motors_of(before).items():
        np.testing.assert_allclose(motors_of(pilot)[name], value, atol=0.1)


def test_a_pilot_without_wheel_speeds_follows_no_rate():
    """The torque of one sample is not held until the next decision: speeds are lost in the middle of a reversal."""
    pilot, rates = by_pilot(0.1, lost=lambda time: 12.2 < time < 17.9, horizon=17.8)
    assert not pilot.step(17.85, np.zeros(3), None).any()
    assert np.abs(rates).max() < 0.6


def test_an_open_loop_design_is_flown_as_rates():
    """`planned_rates` is what the body is to do, whatever the actions are."""
    policy = make_baseline("open_loop_optimal", "microsat")
    cell = {"satellite": "microsat", "inertia": "static", "seeds": seeds("validation", 4), "scenario": QUIET}
    torque, rate = (fly(policy, **cell, control=control).scores()["final_error"] for control in ("torque", "rate"))
    np.testing.assert_allclose(np.log(rate / torque), 0.0, atol=1.0)
    (mission,) = missions(problem("microsat", control="rate"))
    policy.reset(mission, [0])
    script = np.array([policy(np.empty((1, 0)))[0] for _ in range(300)])
    assert script.shape == (300, 3)
    assert np.abs(script).max() == pytest.approx(policy.fraction)


def test_sb3s_rate_commands_are_the_actions_there():
    env = RateCommandVecEnv(2, satellite="microsat", control="rate", margin=3.5)
    env.reset()
    env.step(np.full((2, 3), 0.4, np.float32))
    (mission,) = missions(env.vector_env.problem)
    expected = RateMargin([mission], 3.5)(np.empty((1, 0)), np.full(3, 0.4))
    np.testing.assert_allclose(env.vector_env.fleet.rows.tasks["command"], np.tile(expected, (2, 1)), rtol=1e-6)


@pytest.mark.parametrize("given_by", ["satellite", "scenario"])
def test_rates_keep_off_the_limit_by_the_scale_of_the_gyro(given_by):
    """3.5 standard deviations of 0.4 %, wherever that stands, next to noise of 0.3 % of the limit."""
    body = SATELLITES["microsat"]
    body = body.replace(gyro_noise_std=0.003 * body.rate_limit)
    world = SCENARIOS["default"].replace(torque_noise=0.0)
    if given_by == "satellite":
        body = body.replace(tolerances={"gyro_scale": 0.004})
    else:
        world = world.replace(tolerances={"gyro_scale": 0.004})
    share = RateMargin(missions(problem(body, scenario=world, control="rate")), 3.5)(np.empty((1, 0)), np.ones(3))
    np.testing.assert_allclose(share, 1.0 - 3.5 * 0.005, rtol=1e-12)


def test_several_satellites_have_no_common_mission():
    with pytest.raises(ValueError, match=r"prepared for one satellite, and the problem has \['cubesat', 'microsat'\]"):
        fly(Steps(), satellite=["cubesat", "microsat"], inertia="static", seeds=[1], control="rate")


def test_profiles_command_rates_there():
    (mission,) = missions(problem(control="rate"))
    profile = build("sine", {"amplitude": 0.5})
    profile.reset(mission, [0])
    env = SatInertiaIDEnv("microsat", "static", QUIET, control="rate")
    observation, _ = env.reset(seed=0)
    action = profile(observation[None])
    assert action.shape == (1, 3)
    assert np.abs(action).max() <= 0.5


def test_what_cannot_be_is_refused(pyramid):
    with pytest.raises(ValueError, match=r"unknown control.*'rates'.*Did you mean 'rate'"):
        SatInertiaIDEnv(control="rates")
    for bandwidth in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="rate_bandwidth"):
            SatInertiaIDEnv(scenario={"rate_bandwidth": bandwidth}, control="rate")
    env = SatInertiaIDEnv(pyramid, control="rate")
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"\(3,\)"):
        env.step(np.zeros(4, np.float32))
    with pytest.raises(ValueError, match="action"):
        env.step(np.array([0.0, np.nan, 0.0]))


@pytest.mark.slow
def test_other_satellites_and_worlds_stay_inside(pyramid):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for satellite in ("cubesat", "smallsat", pyramid):
            assert flown("rate", {}, satellite) <= 0.01
        assert flown("rate", {"tilt_std": 0.15}) <= 0.005
        assert flown("rate", {"sensors": {"tachometer_delay": 1.0}}) <= 0.01
