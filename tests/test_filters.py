"""The filters: textbook oracles, then filterpy's versions of them over whole episodes, then what must never break."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from satid_gym import SATELLITES, Disturbance, InertiaLaw, ReactionWheels, Satellite, simulate
from satid_gym.core import kernels
from satid_gym.estimators import (
    AdaptiveEKF,
    FilterPrior,
    FilterpyAdaptiveEKF,
    FilterpyMomentumEKF,
    FilterpyMomentumUKF,
    FilterpyRateEKF,
    MomentumEKF,
    MomentumEKFSettings,
    RateEKF,
)
from satid_gym.estimators.filterpy.model import MomentumModel
from satid_gym.estimators.inertia import inertia_parameters
from satid_gym.laws import INERTIA_MODES
from satid_gym.scenario import prior_of
from satid_gym.scenario_catalogue import SCENARIOS
from tests.cases import cases

DT = 0.1
LAWS = {
    "static": InertiaLaw("static"),
    "step": InertiaLaw("step", size=0.1, time=150.0),
    "drift": InertiaLaw("drift", size=0.05, time=300.0),
    "periodic": InertiaLaw("periodic", size=0.03, frequency=0.02),
}


@dataclass
class Readings:
    """Gyro (N, 3) and tachometers (N, n) of a noisy flight whose true inertia is off the prior's."""

    gyro: np.ndarray
    wheel_speed: np.ndarray
    inertia: np.ndarray
    prior: FilterPrior


def fly(
    satellite: Satellite,
    mode: str,
    seconds: int = 300,
    seed: int = 0,
    true_scale: float = 1.1,
    rest: tuple[float, float] = (0.0, 0.0),
) -> Readings:
    rng = np.random.default_rng(seed)
    n = satellite.wheels.count
    t = np.arange(round(seconds / DT))
    wave = np.where((t[:, None] * DT / 30.0 + np.arange(n) / n) % 1.0 < 0.5, 1.0, -1.0)
    wave[(t * DT >= rest[0]) & (t * DT < rest[1])] = 0.0
    torque = 0.08 * satellite.wheels.max_torque * wave + 0.01 * satellite.wheels.max_torque * rng.normal(
        size=wave.shape
    )
    std = satellite.disturbance_std
    disturbance = Disturbance(constant=std * rng.normal(size=3), sine=std * rng.normal(size=3), gravity_gradient=True)
    flight = simulate(
        satellite.replace(inertia=true_scale * satellite.inertia),
        torque,
        DT,
        wheel_speed0=0.1 * satellite.wheels.max_speed * rng.uniform(-1.0, 1.0, n),
        law=LAWS[mode],
        disturbance=disturbance,
        substeps=1,
    )
    return Readings(
        gyro=flight.omega + satellite.gyro_noise_std * rng.normal(size=flight.omega.shape),
        wheel_speed=flight.wheel_speed + satellite.tachometer_noise_std * rng.normal(size=flight.wheel_speed.shape),
        inertia=flight.inertia,
        prior=prior_of(satellite, SCENARIOS["default"]),
    )


def run_slowly(estimator, readings: Readings) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean, covariance and nis of every reading, through the estimators' protocol."""
    estimator.reset(readings.prior, readings.gyro[0], readings.wheel_speed[0])
    mean, covariance, nis = [estimator.mean], [estimator.covariance], [0.0]
    for gyro, speed in zip(readings.gyro[1:], readings.wheel_speed[1:], strict=True):
        estimator.predict(speed, DT)
        nis.append(estimator.update(gyro, speed))
        mean.append(estimator.mean)
        covariance.append(estimator.covariance)
    return np.array(mean), np.array(covariance), np.array(nis)


def assert_equal_filters(run, slow, tolerance: float = 1e-9) -> None:
    """Means relative to the size of each state, covariances to the standard deviations."""
    mean, covariance, nis = slow
    size = np.abs(mean).max(axis=0)
    assert (np.abs(run.mean - mean) / size).max() < tolerance
    std = np.sqrt(np.einsum("tii->ti", covariance))
    assert (np.abs(run.covariance - covariance) / (std[:, :, None] * std[:, None, :])).max() < tolerance
    np.testing.assert_allclose(run.nis, nis, rtol=1e-7, atol=1e-9)


# Textbook oracles


def test_equals_the_kalman_filter_where_the_dynamics_are_linear():
    """A ball of known inertia c: dM/dt = M x (M - a) / c + tau = a x M / c + tau, z = (M - a) / c + noise.

    Linear in (M, tau) for any wheel momentum a, so the textbook's Kalman filter, in its batch form, is exact. The
    noise of the tachometers would enter as M times noise; it is off.
    """
    c, sigma, walk, std = 6.0, 5e-5, 0.02, 5e-5
    wheels = ReactionWheels(inertia=2e-3, max_torque=0.1, max_speed=900.0)
    prior = FilterPrior(
        wheels=wheels,
        inertia=c * np.eye(3),
        prior_std=0.0,
        product_std=0.0,
        gyro_noise_std=sigma,
        tachometer_noise_std=0.0,
        disturbance_std=std,
    )
    rng = np.random.default_rng(1)
    count = 600
    speed = 100.0 * np.array([1.0, -1.0, 0.5]) + np.cumsum(rng.normal(size=(count, 3)), axis=0)
    gyro = 0.02 * np.sin(np.arange(count)[:, None] / 50.0 + np.arange(3)) + sigma * rng.normal(size=(count, 3))
    run = MomentumEKF(inertia_walk=0.0, disturbance_walk=walk).run(prior, gyro, speed, DT)

    def slope(a):
        """(6, 6) matrix of d(M, tau)/dt."""
        matrix = np.zeros((6, 6))
        matrix[:3, :3] = np.cross(np.eye(3), -a / c).T  # columns: e_i x (-a / c)
        matrix[:3, 3:] = np.eye(3)
        return matrix

    spin = 2e-3 * speed
    x = np.concatenate([c * gyro[0] + spin[0], np.zeros(3)])
    p = np.diag([(c * sigma) ** 2] * 3 + [std**2] * 3)
    q = np.diag([0.0] * 3 + [(walk * std) ** 2 * DT] * 3)
    h, r = np.hstack([np.eye(3) / c, np.zeros((3, 3))]), sigma**2 * np.eye(3)
    for i in range(1, count):
        first, second = slope(spin[i - 1]), slope(0.5 * (spin[i - 1] + spin[i]))
        f = np.eye(6) + DT * second @ (np.eye(6) + 0.5 * DT * first)
        x, p = f @ x, f @ p @ f.T + q
        gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + r)
        x = x + gain @ (gyro[i] - (h @ x - spin[i] / c))
        p = (np.eye(6) - gain @ h) @ p
        keep = np.r_[0:3, 6:9]
        scale = np.sqrt(np.diag(p))
        assert (np.abs(run.mean[i][keep] - x) / scale).max() < 1e-7
        np.testing.assert_allclose(
            run.covariance[i][np.ix_(keep, keep)] / np.outer(scale, scale),
            p / np.outer(scale, scale),
            rtol=0,
            atol=1e-9,
        )
    np.testing.assert_allclose(run.inertia, c, rtol=1e-15)


def test_one_axis_is_linear_regression():
    """A body that turns about one axis at a known momentum: the filter is least squares on z = M / J.

    With M = -a exactly known to start with and no disturbance, 200 readings of omega = M / J fix J to
    sigma J / (omega sqrt(N)), up to the prior.
    """
    sigma, inertia, omega, count = 5e-5, 6.0, 0.02, 200
    prior = FilterPrior(
        wheels=ReactionWheels(inertia=2e-3, max_torque=0.1, max_speed=900.0),
        inertia=6.3 * np.eye(3),
        prior_std=0.1,
        product_std=0.0,
        gyro_noise_std=sigma,
        tachometer_noise_std=0.0,
        disturbance_std=0.0,
    )
    rng = np.random.default_rng(3)
    # at rest with known momentum zero, then the wheel takes -J omega and stays
    ekf = MomentumEKF(inertia_walk=0.0, disturbance_walk=0.0)
    ekf.reset(prior, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    ekf.records["covariance"][0, :3, :] = ekf.records["covariance"][0, :, :3] = 0.0
    speed = np.array([-inertia * omega / 2e-3, 0.0, 0.0])
    readings = omega + sigma * rng.normal(size=count)
    for z in readings:
        ekf.predict(speed, DT)
        ekf.update((z, 0.0, 0.0), speed)
    std = np.sqrt(ekf.covariance[3, 3])
    expected = 1.0 / np.sqrt(count * (omega / (inertia * sigma)) ** 2 + 1.0 / 0.63**2)
    assert std == pytest.approx(expected, rel=1e-2)
    least_squares = inertia * omega / readings.mean()
    assert abs(ekf.mean[3] - least_squares) < 0.2 * std
    np.testing.assert_allclose(ekf.mean[4:6], 6.3)


# Jacobians


def central_differences(function, x: np.ndarray, steps: np.ndarray) -> np.ndarray:
    columns = [(function(x + h) - function(x - h)) / (2.0 * h.max()) for h in np.diag(steps)]
    return np.array(columns).T


@pytest.fixture
def slender(microsat) -> Satellite:
    """Of another moment about each axis, so that the tachometers' noise is as well."""
    return microsat.replace(name="slender", inertia=(1.0, 6.0, 6.5))


@pytest.fixture(scope="module")
def states():
    """A state in the middle of flight for each shape of filter: (satellite, parameters, gyro, speed before, after)."""
    pyramid_axes = np.array([[0.6, -0.6, -0.6, 0.6], [0.6, 0.6, -0.6, -0.6], [0.529150262212918] * 4])
    pyramid_axes /= np.linalg.norm(pyramid_axes, axis=0)
    skewed = SATELLITES["microsat"].replace(inertia=[[6.5, 0.4, -0.3], [0.4, 6.0, 0.5], [-0.3, 0.5, 4.5]])
    pyramid = skewed.replace(
        wheels=skewed.wheels.replace(axes=pyramid_axes, inertia=2e-3, max_torque=0.1, max_speed=900.0)
    )
    rng = np.random.default_rng(0)
    return {
        name: (satellite, parameters, rng.normal(size=3) * 0.02, speed, speed + rng.normal(size=len(speed)))
        for name, satellite, parameters, speed in (
            ("principal", SATELLITES["microsat"], "principal", np.array([100.0, -200.0, 50.0])),
            ("full", skewed, "full", np.array([100.0, -200.0, 50.0])),
            ("pyramid", pyramid, "full", np.array([100.0, -200.0, 50.0, 150.0])),
        )
    }


@cases("shape", ["principal", "full", "pyramid"])
def test_jacobians_of_the_momentum_model(shape, states):
    satellite, parameters, gyro, before, after = states[shape]
    prior = prior_of(satellite, SCENARIOS["default"])
    model = MomentumModel(MomentumEKFSettings(parameters=parameters), prior)
    x, _ = model.start(gyro, before)
    x[-3:] = 3e-5, -2e-5, 1e-5
    a0, a1 = model.spin @ before, model.spin @ after
    steps = np.concatenate([np.full(3, 1e-4), np.full(model.p, 1e-4), np.full(3, 1e-4)])
    for jacobian, function in (
        (model.slope_jacobian(x, a0), lambda v: model.slope(v, a0)),
        (model.step_jacobian(x, a0, a1, DT), lambda v: model.step(v, a0, a1, DT)),
        (model.rate_jacobian(x, a0), lambda v: model.rate(v, a0)),
    ):
        np.testing.assert_allclose(jacobian, central_differences(function, x, steps), rtol=1e-7, atol=1e-9)


@cases("shape", ["principal", "full", "pyramid"])
def test_jacobian_of_the_rate_model(shape, states):
    satellite, parameters, gyro, before, after = states[shape]
    ekf = FilterpyRateEKF(parameters=parameters)
    ekf.reset(prior_of(satellite, SCENARIOS["default"]), gyro, before)
    x, acceleration = ekf.mean, (after - before) / DT
    steps = np.concatenate([np.full(3, 1e-4), np.full(ekf.p, 1e-4), np.full(ekf.n, 1e-1)])
    expected = central_differences(lambda v: ekf._slope(v, acceleration), x, steps)
    np.testing.assert_allclose(ekf._slope_jacobian(x, acceleration), expected, rtol=1e-7, atol=1e-9)


@pytest.mark.interpreted
@cases("shape", ["principal", "full"])
@cases("new", [MomentumEKF, RateEKF])
def test_transition_of_the_filter(new, shape, states):
    """One compiled prediction from states moved to both sides; the rest of the transition is identity."""
    satellite, parameters, gyro, before, after = states[shape]
    ekf = new(parameters=parameters)
    ekf.reset(prior_of(satellite, SCENARIOS["default"]), gyro, before)
    start = ekf.records.copy()
    x = ekf.mean

    def predicted(mean):
        ekf.records[:] = start
        ekf.records["mean"][0] = mean
        ekf.predict(after, DT)
        return ekf.mean

    size, p = len(x), 3 if parameters == "principal" else 6
    steps = np.full(size, 1e-4)
    if new is RateEKF:
        steps[3 + p :] = 1e-1
    else:
        steps[3 + p :] = 1e-3
    expected = central_differences(predicted, x, steps)
    predicted(x)
    np.testing.assert_allclose(ekf.work["transition"][0, :3, :size], expected[:3], rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(expected[3:], np.eye(size)[3:], rtol=0, atol=1e-8)


@cases("parameters", ["principal", "full"])
def test_first_covariance_is_that_of_samples(parameters, states):
    """M0 = J omega + a of samples from the prior and the sensors has the mean and covariance the filter starts with."""
    satellite, _, gyro, speed, _ = states["full"]
    prior = prior_of(satellite, SCENARIOS["default"]).replace(gyro_noise_std=2e-3, tachometer_noise_std=20.0)
    ekf = MomentumEKF(parameters=parameters)
    ekf.reset(prior, gyro, speed)
    rng = np.random.default_rng(0)
    count, p = 200_000, 3 if parameters == "principal" else 6
    theta = inertia_parameters(prior.inertia, parameters)
    drawn = theta + prior.prior_theta_std(parameters) * rng.normal(size=(count, p))
    tensors = np.zeros((count, 3, 3))
    for k, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))[:p]):
        tensors[:, i, j] = tensors[:, j, i] = drawn[:, k]
    mean_tensor = tensors.mean(axis=0) if parameters == "full" else np.diag(theta)
    # the filter is linear in noise: J_prior times gyro noise, without the product of two errors
    omega_noise = 2e-3 * rng.normal(size=(count, 3))
    spin_noise = 20.0 * rng.normal(size=(count, 3))
    wheels = prior.wheels
    momentum = tensors @ gyro + omega_noise @ mean_tensor + (speed + spin_noise) * wheels.inertia
    sampled = np.cov(np.hstack([momentum, drawn]).T)
    keep = slice(0, 3 + p)
    std = np.sqrt(np.diag(ekf.covariance)[keep])
    error = (ekf.covariance[keep, keep] - sampled) / np.outer(std, std)
    assert np.abs(error).max() < 5.0 * np.sqrt(2.0 / count)


# filterpy


@pytest.mark.parametrize("mode", INERTIA_MODES)
@pytest.mark.parametrize(
    ("fast", "slow"),
    [(MomentumEKF, FilterpyMomentumEKF), (AdaptiveEKF, FilterpyAdaptiveEKF), (RateEKF, FilterpyRateEKF)],
    ids=["momentum", "adaptive", "rate"],
)
@pytest.mark.compiled
def test_compiled_equals_filterpy_over_an_episode(fast, slow, mode, microsat):
    """All of it with a step; laws without one do in the first minute what they do in all others."""
    seconds = 300 if mode == "step" else 60
    readings = fly(microsat, mode, seconds=seconds)
    run = fast().run(readings.prior, readings.gyro, readings.wheel_speed, DT)
    assert len(run.mean) == 10 * seconds + 1
    assert run.constrained_updates == 0
    assert_equal_filters(run, run_slowly(slow(), readings))


@pytest.mark.parametrize(
    ("name", "fast", "slow"),
    [
        ("skewed", MomentumEKF, FilterpyMomentumEKF),
        ("skewed", RateEKF, FilterpyRateEKF),
        ("pyramid", MomentumEKF, FilterpyMomentumEKF),
        ("pyramid", AdaptiveEKF, FilterpyAdaptiveEKF),
    ],
)
@pytest.mark.compiled
def test_compiled_equals_filterpy_on_the_full_tensor(name, fast, slow, request):
    readings = fly(request.getfixturevalue(name), "drift")
    run = fast(parameters="full").run(readings.prior, readings.gyro, readings.wheel_speed, DT)
    assert run.inertia.shape == (3001, 6)
    assert_equal_filters(run, run_slowly(slow(parameters="full"), readings))


@pytest.mark.compiled
def test_compiled_equals_filterpy_with_substeps(microsat):
    readings = fly(microsat, "static", seconds=60)
    settings = {"substeps": 3, "inertia_walk": 0.01}
    run = MomentumEKF(**settings).run(readings.prior, readings.gyro, readings.wheel_speed, DT)
    assert_equal_filters(run, run_slowly(FilterpyMomentumEKF(**settings), readings))


@cases("new", [MomentumEKF, AdaptiveEKF, RateEKF])
def test_run_equals_reading_by_reading(new, microsat):
    readings = fly(microsat, "periodic", seconds=30)
    run = new().run(readings.prior, readings.gyro, readings.wheel_speed, DT)
    mean, covariance, nis = run_slowly(new(), readings)
    np.testing.assert_array_equal(run.mean, mean)
    np.testing.assert_array_equal(run.covariance, covariance)
    np.testing.assert_array_equal(run.nis, nis)


@pytest.mark.compiled
def test_unscented_filter_agrees_once_converged(microsat):
    """What linearisation costs: a few percent of a standard deviation."""
    readings = fly(microsat, "static", seconds=180)
    run = MomentumEKF().run(readings.prior, readings.gyro, readings.wheel_speed, DT)
    mean, covariance, _ = run_slowly(FilterpyMomentumUKF(), readings)
    late = slice(1000, None)
    std = np.sqrt(np.einsum("tii->ti", run.covariance[late]))
    assert (np.abs(run.mean[late] - mean[late]) / std).max() < 0.05
    np.testing.assert_allclose(np.sqrt(np.einsum("tii->ti", covariance[late])), std, rtol=0.005)


@pytest.mark.compiled
def test_estimate_converges_to_the_truth(skewed):
    """All six parameters, within five of their standard deviations and to half a percent of the tensor."""
    readings = fly(skewed, "static")
    run = MomentumEKF(parameters="full").run(readings.prior, readings.gyro, readings.wheel_speed, DT)
    truth = inertia_parameters(readings.inertia[-1], "full")
    std = np.sqrt(np.diag(run.inertia_covariance[-1]))
    assert (np.abs(run.inertia[-1] - truth) < 5.0 * std).all()
    assert np.linalg.norm(run.inertia[-1] - truth) / np.linalg.norm(truth) < 5e-3


# The same, step by step, from random beliefs in which every term is large


ROUGH = {
    # prior of a satellite whose every sensor is bad, so that all noises count
    "gyro_noise_std": 2e-3,
    "tachometer_noise_std": 2.0,
    "disturbance_std": 1e-2,
    "disturbance_walk": 2e-3,
}
SHAPES = [("skewed", "principal"), ("skewed", "full"), ("pyramid", "full")]


def random_belief(fast, slow, rng: np.random.Generator, spread: float, theta: np.ndarray, scale: np.ndarray) -> None:
    """The same mean and a full covariance in both; `spread` is the std of the moments relative to them."""
    size, p = len(fast.mean), len(theta)
    mixing = rng.normal(size=(size, size)) + 2.0 * np.eye(size)
    correlation = mixing @ mixing.T
    root = np.sqrt(np.diag(correlation))
    std = np.concatenate([scale[:3], spread * theta[:3], np.full(p - 3, spread), scale[3:]])
    covariance = correlation / np.outer(root, root) * np.outer(std, std)
    mean = fast.mean
    mean[3 : 3 + p] = theta
    mean[3 + p :] += scale[3:] * rng.normal(size=len(scale) - 3)
    fast.records["mean"][0], fast.records["covariance"][0] = mean, covariance
    slow.filter.x, slow.filter.P = mean.copy(), covariance.copy()


def assert_same_belief(fast, slow, tolerance: float = 1e-10) -> None:
    std = np.sqrt(np.diag(slow.covariance))
    np.testing.assert_allclose(fast.mean / std, slow.mean / std, rtol=tolerance, atol=tolerance)
    size = np.outer(std, std)
    np.testing.assert_allclose(fast.covariance / size, slow.covariance / size, rtol=0, atol=tolerance)


@pytest.mark.interpreted
@cases("spread", [0.2, 0.07, 0.03])
@cases("substeps", [1, 3])
@cases(("name", "parameters"), [*SHAPES, ("slender", "principal")])
def test_a_step_of_the_momentum_filter_is_filterpys(name, parameters, substeps, spread, request):
    """Coarse and fair beliefs are iterated, fine ones not; rates on both sides of the limit of noise."""
    satellite = request.getfixturevalue(name)
    prior = prior_of(satellite, SCENARIOS["default"]).replace(**ROUGH)
    if name == "slender":
        prior = prior.replace(gyro_noise_std=2e-4)
    rng = np.random.default_rng(int(1000 * spread) + substeps)
    settings = {"parameters": parameters, "substeps": substeps, "inertia_walk": 0.05}
    fast, slow = MomentumEKF(**settings), FilterpyMomentumEKF(**settings)
    n, theta = satellite.wheels.count, inertia_parameters(satellite.inertia, parameters)
    # a tachometer's noise is 6e-4 to 9e-4 rad/s of body rate: 5 of these, less what the gyro takes away
    for rates in ((0.3, -0.4, 0.2), (4.5e-3, -1.5e-3, 2.5e-3), (2.5e-3, 4.5e-3, -6e-3), (1e-3, 2e-3, -2e-3)):
        speed = 200.0 * rng.uniform(-1.0, 1.0, n)
        for filter in (fast, slow):
            filter.reset(prior, np.array(rates), speed)
        assert_same_belief(fast, slow)
        random_belief(fast, slow, rng, spread, theta, np.array([0.01] * 3 + [1e-3] * 3))
        after = speed + 2.0 * rng.normal(size=n)
        for filter in (fast, slow):
            filter.predict(after, 0.3)
        assert_same_belief(fast, slow)
        gyro = np.array(rates) + 2e-3 * rng.normal(size=3)
        assert fast.update(gyro, after) == pytest.approx(slow.update(gyro, after), rel=1e-7)
        assert_same_belief(fast, slow, 1e-8)
        assert fast.constrained_updates == 0


@pytest.mark.interpreted
@cases(("name", "parameters"), SHAPES)
def test_a_step_of_the_rate_filter_is_filterpys(name, parameters, request):
    satellite = request.getfixturevalue(name)
    prior = prior_of(satellite, SCENARIOS["default"])
    rng = np.random.default_rng(4)
    settings = {
        "parameters": parameters,
        "gyro_std": 0.02,
        "wheel_speed_std": 3.0,
        "rate_walk": 0.03,
        "inertia_walk": 0.5,
        "wheel_speed_walk": 2.0,
        "prior_rate_std": 0.05,
        "prior_inertia_std": 0.7,
        "prior_wheel_speed_std": 4.0,
    }
    fast, slow = RateEKF(**settings), FilterpyRateEKF(**settings)
    n, theta = satellite.wheels.count, inertia_parameters(satellite.inertia, parameters)
    for _ in range(3):
        speed, gyro = 200.0 * rng.uniform(-1.0, 1.0, n), 0.3 * rng.normal(size=3)
        for filter in (fast, slow):
            filter.reset(prior, gyro, speed)
        assert_same_belief(fast, slow)
        random_belief(fast, slow, rng, 0.05, theta, np.array([0.02] * 3 + [5.0] * n))
        after = speed + 5.0 * rng.normal(size=n)
        for filter in (fast, slow):
            filter.predict(after, 0.3)
        assert_same_belief(fast, slow)
        gyro, reading = gyro + 0.05 * rng.normal(size=3), after + 3.0 * rng.normal(size=n)
        assert fast.update(gyro, reading) == pytest.approx(slow.update(gyro, reading), rel=1e-9)
        assert_same_belief(fast, slow)
        # what the next prediction starts from is the tachometers' last reading
        for filter in (fast, slow):
            filter.predict(reading, 0.3)
        assert_same_belief(fast, slow)


@pytest.mark.interpreted
@cases(("left", "fraction"), [(0.5, 1.0), (0.07, 1.0), (0.03, 0.5), (-0.8, 0.5), (-0.95, 0.25), (-59.0, 2.0**-6)])
@cases(("name", "parameters"), SHAPES)
def test_an_update_is_halved_until_a_twentieth_of_the_prior_is_left(name, parameters, left, fraction, request):
    """A reading made so that the whole update would leave `left` of the prior of the first moment.

    The whole mean moves by the same fraction of what filterpy's update says, and the covariance as ever.
    """
    satellite = request.getfixturevalue(name)
    satellite = satellite.replace(inertia=np.diag(np.diag(satellite.inertia)))
    prior, n = prior_of(satellite, SCENARIOS["default"]), satellite.wheels.count
    fast, slow = RateEKF(parameters=parameters), FilterpyRateEKF(parameters=parameters)
    speed = np.full(n, 10.0)
    for filter in (fast, slow):
        filter.reset(prior, (0.0, 0.0, 0.0), speed)
    covariance = slow.filter.P
    covariance[0, 3] = covariance[3, 0] = 0.5 * np.sqrt(covariance[0, 0] * covariance[3, 3])
    fast.records["covariance"][0] = covariance
    gain = covariance[3, 0] / (covariance[0, 0] + 1e-6)
    moment = satellite.inertia[0, 0]
    gyro = np.array([(left - 1.0) * moment / gain, 0.0, 0.0])
    before = fast.mean
    slow.filter.P = covariance.copy()
    fast.update(gyro, speed)
    slow.update(gyro, speed)
    assert slow.mean[3] == pytest.approx(left * moment, rel=1e-9)
    np.testing.assert_allclose(fast.mean, before + fraction * (slow.mean - before), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(fast.covariance, slow.covariance, rtol=1e-9, atol=1e-15)
    assert fast.constrained_updates == (fraction < 1.0)


# What must never break


@pytest.mark.parametrize("new", [MomentumEKF, AdaptiveEKF, RateEKF])
@pytest.mark.parametrize("calm", [True, False], ids=["flight", "wild"])
@pytest.mark.compiled
def test_covariance_stays_symmetric_and_positive_definite_over_1e5_steps(new, calm, microsat):
    """Ten thousand seconds of flight, and as many of readings that no body can give."""
    if calm:
        flight = fly(microsat, "periodic", seconds=10_000)
        gyro, speed = flight.gyro, flight.wheel_speed
    else:
        rng = np.random.default_rng(0)
        gyro = np.clip(np.cumsum(0.02 * rng.normal(size=(100_001, 3)), axis=0), -0.3, 0.3)
        speed = 900.0 * rng.uniform(-1.0, 1.0, (100_001, 3))
    ekf = new()
    run = ekf.run(prior_of(microsat, SCENARIOS["default"]), gyro, speed, DT)
    assert np.isfinite(run.mean).all()
    std = np.sqrt(np.einsum("tii->ti", run.covariance))
    assert (std > 0.0).all()
    correlation = run.covariance / (std[:, :, None] * std[:, None, :])
    assert np.abs(correlation - correlation.transpose(0, 2, 1)).max() < 1e-15
    np.linalg.cholesky(correlation)  # raises where one is not positive definite
    assert (run.inertia > 0.0).all()
    if calm:
        assert run.constrained_updates == 0


def test_a_wild_reading_is_guarded_and_counted(microsat):
    """A reading that would make a moment negative moves the mean a part of the way, and says so."""
    prior = prior_of(microsat, SCENARIOS["default"])
    ekf = MomentumEKF()
    ekf.reset(prior, (0.02, 0.02, 0.02), (50.0, -50.0, 50.0))
    assert ekf.constrained_updates == 0
    ekf.predict((-150.0, -250.0, -150.0), DT)
    ekf.update((30.0, -30.0, 30.0), (-150.0, -250.0, -150.0))
    assert ekf.constrained_updates == 1
    assert (ekf.mean[3:6] > 0.05 * np.diag(prior.inertia)).all()


@cases("new", [MomentumEKF, AdaptiveEKF, RateEKF])
def test_a_filter_started_again_forgets_everything(new, microsat):
    """The same rows started twice: nothing of the first flight is left, its count and its flag neither."""
    prior, first = prior_of(microsat, SCENARIOS["default"]), (np.array([0.01, -0.02, 0.03]), np.array([9.0, 8.0, 7.0]))
    ekf, fresh = new(), new()
    for filter in (ekf, fresh):
        filter.reset(prior, *first)
    assert ekf.records["broken"][0] == 0
    names = ["mean", "covariance", "wheel_input", "constrained_updates", "broken"]
    if new is AdaptiveEKF:
        for name in ("log_q", "log_q_variance", "theta_slope", "covariance_slope", "steps"):
            ekf.records["adaptation"][name] = 7
    for name in names:
        ekf.records[name] = 7
    kernels.start_filter(ekf.records, ekf.work, *first)
    assert ekf.records.tobytes() == fresh.records.tobytes()


def test_an_update_never_raises_and_a_prediction_never_lowers_uncertainty(microsat):
    readings = fly(microsat, "static", seconds=30)
    ekf = MomentumEKF()
    ekf.reset(readings.prior, readings.gyro[0], readings.wheel_speed[0])
    for gyro, speed in zip(readings.gyro[1:], readings.wheel_speed[1:], strict=True):
        spread = kernels.uncertainty_nats(ekf.records, ekf.work, 0)
        ekf.predict(speed, DT)
        predicted = kernels.uncertainty_nats(ekf.records, ekf.work, 0)
        ekf.update(gyro, speed)
        assert predicted > spread
        assert kernels.uncertainty_nats(ekf.records, ekf.work, 0) <= predicted


@pytest.mark.interpreted
@pytest.mark.parametrize("parameters", ["principal", "full"])
def test_turning_wheels_about_changes_no_estimate(parameters, microsat):
    """Two wheels swapped, one axis reversed: the same flight, the same belief."""
    readings = fly(microsat, "static", seconds=60)
    order, sign = [2, 0, 1], np.array([1.0, -1.0, 1.0])
    wheels = readings.prior.wheels
    turned = readings.prior.replace(wheels=wheels.replace(axes=wheels.axes[:, order] * sign))
    one = MomentumEKF(parameters=parameters).run(readings.prior, readings.gyro, readings.wheel_speed, DT)
    other = MomentumEKF(parameters=parameters).run(turned, readings.gyro, readings.wheel_speed[:, order] * sign, DT)
    std = np.sqrt(np.einsum("tii->ti", one.covariance))
    assert (np.abs(one.mean - other.mean) / std).max() < 1e-6


# What the filters refuse


@cases(
    ("call", "message"),
    [
        (lambda f: f.predict((0.0, 0.0), DT), r"wheel_speed must have shape \(3,\), got \(2,\)"),
        (lambda f: f.predict((0.0, 0.0, np.nan), DT), "wheel_speed must be finite"),
        (lambda f: f.predict((0.0, 0.0, 0.0), 0.0), "dt must be finite and more than 0, got 0.0"),
        (lambda f: f.predict((0.0, 0.0, 0.0), np.nan), "dt must be finite"),
        (lambda f: f.update((0.0, 0.0, np.inf), (0.0, 0.0, 0.0)), "gyro must be finite"),
        (lambda f: f.update((0.0, 0.0), (0.0, 0.0, 0.0)), r"gyro must have shape \(3,\), got \(2,\)"),
        (lambda f: f.update((0.0, 0.0, 0.0), (0.0,) * 4), r"wheel_speed must have shape \(3,\), got \(4,\)"),
    ],
)
def test_a_bad_reading_is_refused_and_leaves_the_belief_as_it_was(call, message, microsat):
    ekf = MomentumEKF()
    ekf.reset(prior_of(microsat, SCENARIOS["default"]), (0.01, 0.0, 0.0), (10.0, 0.0, 0.0))
    before = ekf.records.tobytes()
    with pytest.raises(ValueError, match=message):
        call(ekf)
    assert ekf.records.tobytes() == before


@cases("use", [lambda f: f.mean, lambda f: f.constrained_updates, lambda f: f.predict((0.0,) * 3, DT)])
def test_a_filter_without_belief_says_how_to_start_it(use):
    with pytest.raises(RuntimeError, match=r"call reset\(prior, gyro, wheel_speed\) first"):
        use(MomentumEKF())


def test_series_of_another_length_are_refused(microsat):
    prior = prior_of(microsat, SCENARIOS["default"])
    with pytest.raises(ValueError, match=r"wheel_speed must have shape \(5, 3\), got \(4, 3\)"):
        MomentumEKF().run(prior, np.zeros((5, 3)), np.zeros((4, 3)), DT)
    with pytest.raises(ValueError, match=r"gyro must have shape \(N, 3\) with N >= 1"):
        MomentumEKF().run(prior, np.zeros((0, 3)), np.zeros((0, 3)), DT)
