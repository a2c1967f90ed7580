"""The observation: every part from belief and measurement, by its definition, and within its bounds."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from satid_gym import SATELLITES, SatInertiaIDEnv
from satid_gym.core import kernels
from satid_gym.core.observation import BOUND, layout
from satid_gym.estimators import MomentumEKF, RateEKF
from satid_gym.scenario import prior_of
from tests.cases import cases


class KeepsReadings:
    """Mixed into a filter, it keeps the last readings the environment gave it."""

    def reset(self, prior, gyro, wheel_speed):
        self.gyro, self.wheel_speed = gyro, wheel_speed
        super().reset(prior, gyro, wheel_speed)

    def update(self, gyro, wheel_speed):
        self.gyro, self.wheel_speed = gyro, wheel_speed
        return super().update(gyro, wheel_speed)


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


@cases(
    ("name", "parameters", "wheels", "size"),
    [
        ("momentum", "principal", 3, 37 + 6 + 9 * 8 // 2 - 9),
        ("momentum", "full", 4, 54 + 6 + 12 * 11 // 2 - 18),
        ("rate", "principal", 3, 37 + 6 + 9 * 8 // 2 - 9),
        ("rate", "full", 4, 54 + 7 + 13 * 12 // 2 - 18),
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


@cases("new", [MomentumRecorder, RateRecorder])
@cases(("name", "parameters"), [*((name, "principal") for name in SATELLITES), ("pyramid", "full")])
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


@cases("name", SATELLITES)
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


@pytest.mark.compiled
def test_observation_is_finite_and_bounded_whatever_the_action():
    env = SatInertiaIDEnv("random", scenario={"termination_factor": 1e6}, include_covariance=True)
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
