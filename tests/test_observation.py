"""The observation: every part from belief and measurement, by its definition, and within its bounds."""

from __future__ import annotations

import itertools
import warnings

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_for_sb3

from satid_gym import SATELLITES, Panel, ReactionWheels, SatInertiaIDEnv, SatInertiaIDVectorEnv
from satid_gym.appendages import panel_pair
from satid_gym.core import kernels
from satid_gym.core.belief.modes import bend
from satid_gym.core.observation import BOUND, MODE_PARTS, layout
from satid_gym.estimators import MomentumEKF, RateEKF
from satid_gym.modes import mode_of
from satid_gym.policies import build, find
from satid_gym.policy import missions
from satid_gym.problem import problem
from satid_gym.satellite import BENCHMARK_SATELLITES
from satid_gym.scenario import prior_of
from tests.cases import cases

PANELS = Panel(
    mass=0.37,
    hinge=[0.0, 0.3, 0.0],
    axis=[0.0, 0.0, 1.0],
    arm=[0.0, 0.6, 0.0],
    inertia=[0.045, 0.0001, 0.045],
    frequency=0.35,
    damping=0.005,
    mass_std=0.2,
    frequency_std=0.3,
    deflection_std=0.001,
    mirrored=True,
)
FLEXIBLE = SATELLITES["microsat"].replace(name="flexible", oscillators=[PANELS])


class KeepsReadings:
    """Mixed into a filter, it keeps the last readings the environment gave it."""

    def reset(self, prior, gyro, wheel_speed):
        self.gyro, self.wheel_speed = gyro, wheel_speed
        self.nis = []
        super().reset(prior, gyro, wheel_speed)

    def update(self, gyro, wheel_speed):
        self.gyro, self.wheel_speed = gyro, wheel_speed
        self.nis.append(super().update(gyro, wheel_speed))
        return self.nis[-1]


class MomentumRecorder(KeepsReadings, MomentumEKF):
    pass


class RateRecorder(KeepsReadings, RateEKF):
    pass


def test_layout_is_contiguous_and_fills_the_space():
    for n, p in ((3, 3), (3, 6), (4, 6)):
        parts = list(layout(n, p).values())
        assert parts[0].start == 0
        assert all(a.stop == b.start for a, b in itertools.pairwise(parts))
        assert parts[-1].stop == 16 + 2 * n + 5 * p
    env = SatInertiaIDEnv(estimator={"name": "momentum", "parameters": "full"})
    assert env.observation_space.shape == (16 + 6 + 30,)
    assert env.layout == layout(3, 6)
    for n, p, modes in ((3, 3, 0), (4, 6, 0), (8, 6, 3)):
        parts = list(layout(n, p, form="body", mode_count=modes).values())
        assert all(a.stop == b.start for a, b in itertools.pairwise(parts))
        assert parts[-1].stop == 25 + 5 * p + 17 * modes
    env = SatInertiaIDEnv(FLEXIBLE, observation="body")
    assert env.observation_space.shape == (57,)
    assert env.layout == layout(3, 3, form="body", mode_count=1)
    rigid = SatInertiaIDEnv(FLEXIBLE, estimator={"name": "momentum", "flexible": False}, observation="body")
    assert rigid.observation_space.shape == (40,)


@cases(
    ("name", "parameters", "wheels", "size"),
    [
        ("momentum", "principal", 3, 37 + 6 + 9 * 8 // 2 - 9),
        ("momentum", "full", 4, 54 + 6 + 12 * 11 // 2 - 18),
        ("rate", "principal", 3, 37 + 6 + 9 * 8 // 2 - 9),
        ("rate", "full", 3, 52 + 6 + 12 * 11 // 2 - 18),
    ],
)
def test_the_covariance_follows_and_changes_nothing_before(name, parameters, wheels, size, pyramid):
    settings = {
        "satellite": "cubesat" if wheels == 3 else pyramid,
        "estimator": {"name": name, "parameters": parameters},
    }
    short, long = (SatInertiaIDEnv(**settings, include_covariance=flag) for flag in (False, True))
    assert long.observation_space.shape == (size,)
    parts = list(long.layout.items())
    assert parts[:-2] == list(short.layout.items())
    assert parts[-1][1].stop == size
    assert all(a.stop == b.start for (_, a), (_, b) in itertools.pairwise(parts))
    (a, _), (b, _) = short.reset(seed=3), long.reset(seed=3)
    rng = np.random.default_rng(0)
    for _ in range(8):
        np.testing.assert_array_equal(a, b[: len(a)])
        assert len(b) == size
        action = rng.uniform(-0.3, 0.3, wheels).astype(np.float32)
        (a, *rest, info), (b, *same, same_info) = short.step(action), long.step(action)
        assert rest == same
        for key, value in info.items():
            np.testing.assert_array_equal(value, same_info[key], err_msg=key)


@pytest.mark.interpreted
@cases("new", [MomentumRecorder, RateRecorder])
@cases(("name", "parameters"), [*((name, "principal") for name in BENCHMARK_SATELLITES), ("pyramid", "full")])
def test_every_part_by_its_definition(name, parameters, new, pyramid):
    recorder = new(parameters=parameters)
    satellite = SATELLITES.get(name, pyramid)
    env = SatInertiaIDEnv(satellite, scenario={"decision_period": 2.0}, estimator=recorder, include_covariance=True)
    scenario, wheels = env.problem.scenario, satellite.wheels
    spin, prior = wheels.axes * wheels.inertia, prior_of(satellite, scenario).inertia
    moments = np.diag(prior)
    places = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)][: 3 if parameters == "principal" else 6]
    p = len(places)
    scale = np.sqrt([moments[i] * moments[j] for i, j in places])
    if recorder.coordinates == "momentum":
        others = [*moments * satellite.rate_limit, *3 * [satellite.disturbance_std]]
    else:
        others = [*3 * [satellite.rate_limit], *wheels.max_speed]
    rows, columns = np.triu_indices(p + len(others), 1)  # row by row
    told = (rows < 3) & (columns >= 3) & (columns < 3 + p)
    observation, _ = env.reset(seed=5)
    rng = np.random.default_rng(0)
    for step in range(8):
        action = rng.uniform(-0.3, 0.3, wheels.count).astype(np.float32)
        observation, *_ = env.step(action)
        x, covariance = recorder.mean, recorder.covariance
        theta, std = x[3 : 3 + p], np.sqrt(np.diag(covariance))
        inertia = np.zeros((3, 3))
        for value, (i, j) in zip(theta, places, strict=True):
            inertia[i, j] = inertia[j, i] = value
        if recorder.coordinates == "momentum":
            momentum, tau = x[:3], x[3 + p :]
            omega = np.linalg.solve(inertia, momentum - spin @ recorder.wheel_speed)
        else:
            omega, tau = x[:3], np.zeros(3)
            momentum = inertia @ omega + spin @ x[3 + p :]
        slope = np.linalg.solve(inertia, np.cross(momentum, omega) + tau)
        expected = {
            "rate": recorder.gyro / satellite.rate_limit,
            "wheel_speed": recorder.wheel_speed / wheels.max_speed,
            "inertia": (theta - [prior[place] for place in places]) / scale,
            "uncertainty": np.log10(std[3 : 3 + p] / scale) + 2.0,
            "disturbance": tau / satellite.disturbance_std,
            "correlation": (covariance[:3, 3 : 3 + p] / np.outer(std[:3], std[3 : 3 + p])).ravel(),
            "control_authority": np.abs(wheels.axes) @ wheels.max_torque * 2.0 / moments / satellite.rate_limit,
            "momentum_fraction": moments * satellite.rate_limit / (np.abs(spin) @ wheels.max_speed),
            "coast_rate_change": slope * 2.0 / satellite.rate_limit,
            "command": action,
            "time_left": [1.0 - (step + 1) / 150],
            "state_uncertainty": np.log10(np.delete(std, slice(3, 3 + p)) / others) + 2.0,
            "state_correlation": (covariance / np.outer(std, std))[rows, columns][~told],
        }
        for part, place in env.layout.items():
            value = np.clip(expected.pop(part), -BOUND, BOUND)
            np.testing.assert_allclose(observation[place], value, rtol=2e-6, atol=2e-6, err_msg=part)
        assert not expected


@cases("walk", [None, 0.0])
def test_a_torque_whose_prior_std_is_zero(walk):
    """No multiple of that is its std, whether the gravity gradient lets it walk or it is certain."""
    satellite = SATELLITES["cubesat"].replace(disturbance_std=0.0)
    estimator = {"name": "momentum", "disturbance_walk": walk}
    env = SatInertiaIDEnv(satellite, estimator=estimator, include_covariance=True)
    observation, _ = env.reset(seed=0)
    rows, columns = np.triu_indices(9, 1)
    torque = columns[(rows >= 3) | (columns < 3) | (columns >= 6)] >= 6
    for _ in range(5):
        observation, *_ = env.step(np.array([0.2, -0.1, 0.1], np.float32))
        std, correlation = (observation[env.layout[f"state_{part}"]] for part in ("uncertainty", "correlation"))
        np.testing.assert_array_equal(std[3:], -BOUND)
        assert (np.abs(std[:3]) < BOUND).all()
        assert (correlation[~torque] != 0.0).all()
        assert np.any(correlation[torque]) == (walk is None)


def test_what_is_beyond_ten_is_cut_to_ten():
    env = SatInertiaIDEnv()
    env.reset(seed=0)
    env.fleet.rows.plants["gyro"] = np.array([1.0, -1.0, 9.9 / 100.0 * 3.0])  # the limit is 0.03 rad/s
    kernels.look(env.fleet.rows, env.fleet.work)
    observation = env.fleet.rows.observations[0]
    np.testing.assert_allclose(observation[:3], [10.0, -10.0, 9.9], rtol=1e-6)
    assert env.observation_space.contains(observation)


@cases("name", BENCHMARK_SATELLITES)
@pytest.mark.compiled
def test_observation_is_of_order_one_in_ordinary_flight(name):
    env = SatInertiaIDEnv(name, include_covariance=True)
    seen = []
    for seed in range(3):
        observation, _ = env.reset(seed=seed)
        for step in range(300):
            seen.append(observation)
            rate = observation[env.layout["rate"]]
            authority = observation[env.layout["control_authority"]]
            target = 0.8 * np.where((step / 30.0 + np.arange(3) / 3.0) % 1.0 < 0.5, 1.0, -1.0)
            observation, *_ = env.step(np.clip((rate - target) / authority, -1.0, 1.0).astype(np.float32))
    seen = np.array(seen)
    assert np.abs(seen).max() < BOUND, "nothing is cut"
    for part in (seen[:, :37], seen[:, 37:]):
        assert np.abs(part).mean() < 1.5
        assert np.abs(part).mean() > 0.1


@cases("observation", ["wheels", "body"])
@pytest.mark.compiled
def test_observation_is_finite_and_bounded_whatever_the_action(observation):
    settings = {"include_covariance": True, "observation": observation}
    env = SatInertiaIDEnv("random", scenario={"termination_factor": 1e6}, **settings)
    rng = np.random.default_rng(0)
    for seed in range(6):
        observation, _ = env.reset(seed=seed)
        for _ in range(100):
            assert env.observation_space.contains(observation)
            observation, reward, *_ = env.step(rng.choice([-1.0, 1.0], 3).astype(np.float32))
            assert np.isfinite(reward)


def test_observations_and_infos_are_copies():
    env = SatInertiaIDEnv()
    first, info = env.reset(seed=0)
    kept, kept_info = first.copy(), {k: np.copy(v) for k, v in info.items()}
    second, *_, later = env.step(np.full(3, 0.5, np.float32))
    np.testing.assert_array_equal(first, kept)
    for key, value in info.items():
        np.testing.assert_array_equal(value, kept_info[key])
        assert not (isinstance(value, np.ndarray) and np.shares_memory(value, later[key]))
    second[:] = 7.0
    info["inertia_true"][:] = 7.0
    twin = SatInertiaIDEnv()
    twin.reset(seed=0)
    twin.step(np.full(3, 0.5, np.float32))
    np.testing.assert_array_equal(env.step(np.zeros(3, np.float32))[0], twin.step(np.zeros(3, np.float32))[0])


# in the body frame


@cases("new", [MomentumRecorder, RateRecorder])
@cases(("name", "parameters"), [("microsat", "principal"), ("pyramid", "full")])
def test_parts_in_the_body_frame_by_their_definitions(name, parameters, new, pyramid):
    """All others are as in the form "wheels", to the last bit."""
    satellite = SATELLITES.get(name, pyramid)
    wheels, scenario = satellite.wheels, {"decision_period": 2.0}
    recorder = new(parameters=parameters)
    settings = {"scenario": scenario, "include_covariance": True}
    body = SatInertiaIDEnv(satellite, estimator=recorder, observation="body", **settings)
    twin = SatInertiaIDEnv(satellite, estimator=new(parameters=parameters), **settings)
    body.reset(seed=5)
    twin.reset(seed=5)
    rng = np.random.default_rng(0)
    corners = satellite.rate_limit * np.array(list(itertools.product([-1.0, 1.0], repeat=3)))
    for _ in range(6):
        action = rng.uniform(-0.3, 0.3, wheels.count).astype(np.float32)
        recorder.nis = []
        (seen, _, _, _, info), (other, *_) = body.step(action), twin.step(action)
        spin, limit = wheels.inertia * recorder.wheel_speed, wheels.inertia * wheels.max_speed
        taken = info["inertia_estimate"] @ (recorder.gyro - corners).T  # momentum from the body, corner by corner
        reached = spin[:, None] + np.linalg.pinv(wheels.axes) @ taken
        expected = {
            "wheel_momentum": wheels.axes @ spin / (np.abs(wheels.axes) @ limit),
            "fastest_wheel": [np.max(np.abs(spin) / limit), np.max(np.abs(reached) / limit[:, None])],
            "command": -wheels.axes @ (action * wheels.max_torque) / (np.abs(wheels.axes) @ wheels.max_torque),
            "nis": [np.log10(np.mean(recorder.nis))],
            "modes": [],
        }
        assert len(recorder.nis) == 20
        for part, place in body.layout.items():
            if part in expected:
                np.testing.assert_allclose(seen[place], expected.pop(part), rtol=2e-6, atol=2e-6, err_msg=part)
            else:
                np.testing.assert_array_equal(seen[place], other[twin.layout[part]], err_msg=part)
        assert not expected


@pytest.mark.interpreted
def test_three_wheels_and_four_are_observed_alike():
    """Four wheels of axes (+-2, 0, 1) and (0, +-2, 1) over root 5, which have together what three along the axes have.

    By hand: a momentum (0.36, -0.18, 0.09) N m s of 1.8, and a torque on the body (0.05, 0, -0.02) N m of 0.1.
    """
    three, root = SATELLITES["microsat"], np.sqrt(5.0)
    share = root / 4.0  # the sum over four wheels of |component| is 4 / root 5 along each axis
    axes = np.array([[2.0, -2.0, 0.0, 0.0], [0.0, 0.0, 2.0, -2.0], [1.0, 1.0, 1.0, 1.0]]) / root
    own = {name: share * getattr(three.wheels, name)[0] for name in ("inertia", "max_torque")}
    wheels = ReactionWheels(axes=axes, max_speed=three.wheels.max_speed[0], **own)
    four = three.replace(name="four", wheels=wheels)
    assert three.wheels.inertia[0] * three.wheels.max_speed[0] == pytest.approx(1.8)
    settings = {"estimator": {"name": "momentum", "parameters": "full"}, "include_covariance": True}
    envs = [SatInertiaIDEnv(s, observation="body", **settings) for s in (three, four)]
    assert envs[0].layout == envs[1].layout
    # spinning against each other at 100 rad/s in addition to 225, -135, -45 and 135 rad/s that give the momentum
    speeds = [np.array([180.0, -90.0, 45.0]), np.array([325.0, -35.0, -145.0, 35.0])]
    commands = [np.array([-0.5, 0.0, 0.2]), np.linalg.pinv(axes) @ [-0.05, 0.0, 0.02] / wheels.max_torque]
    for env, speed, command in zip(envs, speeds, commands, strict=True):
        env.reset(seed=0)
        rows, first = env.fleet.rows, envs[0].fleet.rows
        for name in ("mean", "covariance"):
            rows.beliefs[name] = first.beliefs[name]
        rows.beliefs["wheel_input"][0, :3] = [0.36, -0.18, 0.09]
        rows.plants["gyro"], rows.plants["tachometer"] = [0.01, 0.0, -0.02], speed
        rows.tasks["command"], rows.tasks["nis_sum"], rows.tasks["nis_count"] = command, 20.0, 10
        kernels.look(rows, env.fleet.work)
    a, b = (env.fleet.rows.observations[0] for env in envs)
    alike = np.ones(len(a), bool)
    alike[envs[0].layout["fastest_wheel"]] = False
    np.testing.assert_allclose(a[alike], b[alike], rtol=1e-5, atol=1e-6)
    part = {name: a[place] for name, place in envs[0].layout.items()}
    np.testing.assert_allclose(part["wheel_momentum"], [0.2, -0.1, 0.05], rtol=1e-6)
    np.testing.assert_allclose(part["command"], [0.5, 0.0, -0.2], atol=1e-7)
    assert part["nis"][0] == pytest.approx(np.log10(2.0))
    assert part["fastest_wheel"][0] == pytest.approx(180.0 / 900.0)
    assert b[envs[1].layout["fastest_wheel"]][0] == pytest.approx(325.0 / 900.0)


def test_modes_are_the_beliefs():
    env = SatInertiaIDEnv(FLEXIBLE, "static", {"decision_period": 2.0}, observation="body", include_covariance=True)
    (mission,) = missions(env.problem)
    (mode,) = mission.prior.modes
    rung = np.linalg.norm(mode.coupling) * FLEXIBLE.rate_limit  # deta/dt by a step of the rate by its limit
    w = 2.0 * np.pi * mode.frequency
    observation, _ = env.reset(seed=2)
    places = np.cumsum([0, *MODE_PARTS.values()])
    rng = np.random.default_rng(1)
    for _ in range(8):
        belief = env.fleet.rows.beliefs[0]
        mean, std = belief["mean"], np.sqrt(np.diag(belief["covariance"]))
        eta, p, log_w, log_d, log_zeta = mean[9:14]
        d, J = np.exp(log_d) * mode.coupling, np.diag(mean[3:6])
        bent = J + eta * np.exp(log_d) * mode.inertia_slope + eta**2 * mode.inertia_curvature
        omega = np.linalg.solve(bent - np.outer(d, d), mean[:3] - belief["wheel_input"][:3] - d * p)
        expected = {
            "deflection": eta * w / rung,
            "deflection_rate": (p - d @ omega) / rung,
            "deflection_limit": 10.0,  # the panels have none
            "frequency": 2.0 * mode.frequency * np.exp(log_w),
            "frequency_std": np.log10(std[11]) + 2.0,
            "coupling": d / np.sqrt(mean[3:6]),
            "coupling_std": np.log10(std[12]) + 2.0,
            "damping": np.log10(mode.damping * np.exp(log_zeta)) + 2.0,
            "damping_std": -10.0,  # the data sheet says it is as nominal
            "centrifugal": (np.exp(log_d) * mode.inertia_slope)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
            * (0.5 * FLEXIBLE.rate_limit**2 / (w * np.exp(log_w)) ** 2 * w / rung),
        }
        seen = observation[env.layout["modes"]]
        for i, (name, value) in enumerate(expected.items()):
            np.testing.assert_allclose(seen[places[i] : places[i + 1]], value, rtol=1e-5, atol=1e-6, err_msg=name)
        assert list(expected) == list(MODE_PARTS)
        shown = observation[env.layout["state_uncertainty"]]  # of momentum, torque and the five states of the mode
        np.testing.assert_allclose(10.0 ** (shown[6:10] - 2.0), std[9:13] / [rung / w, rung, 1.0, 1.0], rtol=1e-5)
        assert shown[10] == -10.0
        np.testing.assert_array_equal(seen[places[5] : places[5] + 2], 0.0)  # panels turn z alone
        observation, *_ = env.step(rng.uniform(-0.3, 0.3, 3).astype(np.float32))


@cases("side", [1.0, -1.0])
def test_a_rotation_pulls_panels_as_far_as_is_observed(side):
    """Rates about the panels' own axis and the third bend them for as long as they stay, by the simulated truth."""
    panels = panel_pair(SATELLITES["microsat"], 0.1, 0, 2, frequency=0.1, damping=0.2, deflection_limit=0.01)
    quiet = {"torque_noise": 0.0, "inertia_std": 0.0, "disturbance_scale": 0.0, "solar_pressure": 0.0}
    env = SatInertiaIDEnv(
        SATELLITES["microsat"].replace(oscillators=[panels]), "static", quiet, control="rate", observation="body"
    )
    env.reset(seed=0)
    for _ in range(120):
        observation, *_ = env.step(np.array([0.8, 0.8 * side, 0.0], np.float32))
    seen, at = observation[env.layout["modes"]], np.cumsum([0, *MODE_PARTS.values()])
    deflection, limit = seen[0], seen[2]
    x, y, z = observation[env.layout["rate"]].astype(float)
    K = dict(zip(("xx", "yy", "zz", "xy", "xz", "yz"), seen[at[-2] :], strict=True))
    pulled = K["xx"] * x * x + K["yy"] * y * y + K["zz"] * z * z + 2.0 * (K["xy"] * x * y + K["xz"] * x * z)
    pulled += 2.0 * K["yz"] * y * z
    true = env.fleet.rows.plants["oscillators"]["deflection"].mean() / panels.deflection_limit
    assert np.sign(true) == np.sign(pulled)
    assert true == pytest.approx(pulled / limit, rel=0.05)
    assert deflection == pytest.approx(pulled, rel=0.05)


def test_a_limit_of_deflection_is_of_angle_whatever_the_mass():
    """A filter that is told the truth, panels 1.4 times as heavy, knows how much of the limit they are bent by."""
    limited, factor, angle = PANELS.replace(deflection_limit=0.004), 1.4, 0.003
    env = SatInertiaIDEnv(
        FLEXIBLE.replace(oscillators=[limited]), "static", observation="body", include_covariance=True
    )
    env.reset(seed=2)
    (mode,) = env.problem.satellites[0].modes
    heavier = mode_of(limited.replace(mass=factor * limited.mass, inertia=factor * limited.inertia), None)
    eta = angle * np.sqrt(2.0 * factor * limited.inertance)  # of a pair, of unit modal mass
    belief = env.fleet.rows.beliefs[0]
    belief["mean"][9], belief["mean"][12] = eta, 0.5 * np.log(factor)
    assert bend(belief) == pytest.approx(angle / limited.deflection_limit, rel=1e-12)
    assert bend(belief) == pytest.approx(eta / heavier.deflection_limit, rel=1e-12)
    kernels.look(env.fleet.rows, env.fleet.work)
    seen = env.fleet.rows.observations[0][env.layout["modes"]]
    rung = np.linalg.norm(mode.coupling) * FLEXIBLE.rate_limit
    assert seen[2] == pytest.approx(heavier.deflection_limit * 2.0 * np.pi * mode.frequency / rung, rel=1e-5)
    assert seen[0] / seen[2] == pytest.approx(angle / limited.deflection_limit, rel=1e-5)


def test_a_decision_without_readings_shows_a_nis_as_expected():
    faults = {"gyro_dropout": 1.0, "gyro_dropout_duration": [1e3, 1e3]}
    env = SatInertiaIDEnv(scenario={"faults": faults}, observation="body")
    observation, _ = env.reset(seed=0)
    assert observation[env.layout["nis"]] == 0.0
    shown = [env.step(np.zeros(3, np.float32))[0][env.layout["nis"]][0] for _ in range(200)]
    assert shown[0] != 0.0
    assert shown[-1] == 0.0


@cases("satellite", ["microsat", FLEXIBLE])
@cases("more", [{}, {"include_covariance": True}])
def test_both_checkers_and_the_vector_in_the_body_frame(satellite, more):
    settings = {"satellite": satellite, "observation": "body", **more}
    env = SatInertiaIDEnv(**settings)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env, skip_render_check=True)
        check_env_for_sb3(env)
    many = SatInertiaIDVectorEnv(2, **settings)
    assert many.single_observation_space == env.observation_space
    (one, _), (both, _) = env.reset(seed=8), many.reset(seed=7)
    rng = np.random.default_rng(3)
    for _ in range(5):
        np.testing.assert_array_equal(one, both[1])
        action = rng.uniform(-0.5, 0.5, 3).astype(np.float32)
        one, both = env.step(action)[0], many.step(np.array([action, action]))[0]


@cases("more", [{}, {"include_covariance": True}, {"observation": "body"}])
def test_the_filters_walk_is_observed(more):
    """What the adaptive filter has found of the inertia's walk, as info tells it, in both environments."""
    settings = {"inertia": "periodic", "include_walk": True, **more}
    env, many = SatInertiaIDEnv(**settings), SatInertiaIDVectorEnv(2, **settings)
    without = SatInertiaIDEnv(**{**settings, "include_walk": False})
    assert env.observation_space.shape[0] == without.observation_space.shape[0] + 1
    place, seen = env.layout["inertia_walk"].start, []
    (one, _), (both, _) = env.reset(seed=8), many.reset(seed=7)
    rng = np.random.default_rng(3)
    for _ in range(40):
        np.testing.assert_array_equal(one, both[1])
        action = rng.uniform(-0.5, 0.5, 3).astype(np.float32)
        (one, *_, info), both = env.step(action), many.step(np.array([action, action]))[0]
        assert one[place] == pytest.approx(np.log10(info["inertia_walk"]) + 2.0, abs=1e-6)
        seen.append(one[place])
    assert len(set(seen)) > 10, "it is found again"


def test_mpc_plans_with_the_walk_that_it_observes():
    env = SatInertiaIDVectorEnv(2, inertia="periodic", include_walk=True)
    policy = build("mpc", {"include_walk": True, "edits": 1})
    assert policy.include_walk
    policy.reset(missions(env.problem)[0], [4, 5])
    observation, _ = env.reset(seed=4)
    for _ in range(5):
        observation, *_, info = env.step(policy(observation))
    policy(observation)
    beliefs = policy._planner.beliefs
    planned = beliefs["walk"][:, 3:6] / beliefs["theta_scale"]
    np.testing.assert_allclose(planned, np.tile(info["inertia_walk"], (3, 1)).T, rtol=1e-5)


def test_what_needs_each_wheel_refuses_the_body_frame():
    """Policies of both loops say so before a flight; what looks at no observation flies the same."""
    (mission,) = missions(problem(observation="body", include_covariance=True))
    for policy in (build("rate_square", {"period": 36.0, "margin": 2.5}), build("mpc", {})):
        with pytest.raises(ValueError, match=r'need the speed of each wheel.*give observation="wheels"'):
            policy.reset(mission, [0])
    with pytest.raises(ValueError, match='generalist observes "wheels", this environment gives "body"'):
        find("generalist").reset(mission, [0])
    with pytest.raises(ValueError, match=r"unknown observation of Problem 'bodies'.*Did you mean 'body'"):
        problem(observation="bodies")
    errors = []
    for observation in ("wheels", "body"):
        env = SatInertiaIDVectorEnv(1, observation=observation)
        profile = build("multi_step", {"amplitude": 0.02})
        profile.reset(missions(env.problem)[0], [4])
        seen, _ = env.reset(seed=4)
        for _ in range(10):
            seen, *_, info = env.step(profile(seen))
        errors.append(info["relative_error"][0])
    assert errors[0] == errors[1]
