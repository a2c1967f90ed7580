"""Batch estimators against the simulator, statistics, and an optimiser of its own."""

import numpy as np
import pytest
import scipy.optimize
import scipy.stats

from satid_gym import SATELLITES, SCENARIOS, simulate
from satid_gym.estimators import least_squares
from satid_gym.estimators.batch.second_moment import (
    factor_jacobian,
    from_factor,
    is_physical,
    nearest_physical,
    to_factor,
)
from satid_gym.estimators.least_squares import (
    NotIdentifiedError,
    differentiated,
    instrumental_variable,
    momentum_form,
    output_error,
)
from satid_gym.rigid_body import inertia_tensor
from satid_gym.scenario import prior_of
from tests.cases import cases

MOMENTUM_METHODS = [momentum_form, instrumental_variable, output_error]


def smooth_torque(satellite, time, seed=0):
    """Three tones a wheel, no steps."""
    rng = np.random.default_rng(seed)
    n = satellite.wheels.count
    frequency, phase = rng.uniform(0.01, 0.05, (3, n)), rng.uniform(0.0, 6.0, (3, n))
    tones = np.sin(2.0 * np.pi * frequency * time[:, None, None] + phase).mean(axis=1)
    return 0.2 * satellite.wheels.max_torque * tones


def record(satellite, dt=0.1, duration=60.0, bias=0.1, **options):
    """Noise-free readings of a flight with momentum in the wheels, up to `bias` of their limit."""
    time = dt * np.arange(round(duration / dt))
    speed = np.linspace(-bias, bias, satellite.wheels.count) * satellite.wheels.max_speed
    flight = simulate(satellite, smooth_torque(satellite, time), dt, wheel_speed0=speed, **options)
    return flight.omega, flight.wheel_speed, dt


def known(satellite, gyro_noise_std=1e-8):
    """A first guess that is 15 % off, and sensors as good as said."""
    guess = prior_of(satellite.replace(inertia=0.85 * satellite.inertia), SCENARIOS["default"])
    return guess.replace(gyro_noise_std=gyro_noise_std, tachometer_noise_std=0.0)


def relative(fit, satellite):
    return np.linalg.norm(fit.inertia - satellite.inertia) / np.linalg.norm(satellite.inertia)


# what noise-free data give


@cases("method", MOMENTUM_METHODS)
@cases(
    ("name", "parameters"), [("microsat", "principal"), ("microsat", "full"), ("skewed", "full"), ("pyramid", "full")]
)
@pytest.mark.compiled
def test_momentum_methods_recover_the_truth(method, name, parameters, request):
    satellite = request.getfixturevalue(name)
    fit = method(known(satellite), *record(satellite), parameters=parameters)
    assert relative(fit, satellite) < 1e-4
    assert fit.condition >= 1.0


@pytest.mark.parametrize(("method", "order"), [(differentiated, 2.0), (momentum_form, 2.0)])
@pytest.mark.compiled
def test_error_goes_with_the_square_of_the_sample_period(method, order, skewed):
    periods = [0.4, 0.2, 0.1]
    errors = [relative(method(known(skewed), *record(skewed, dt), parameters="full"), skewed) for dt in periods]
    slope = np.polyfit(np.log(periods), np.log(errors), 1)[0]
    assert slope == pytest.approx(order, abs=0.3)


def test_logged_acceleration_is_used(microsat):
    gyro, speed, dt = record(microsat)
    right = differentiated(known(microsat), gyro, speed, dt, wheel_acceleration=np.gradient(speed, dt, axis=0))
    wrong = differentiated(known(microsat), gyro, speed, dt, wheel_acceleration=1.1 * np.gradient(speed, dt, axis=0))
    assert relative(right, microsat) < 1e-3
    assert 0.05 < relative(wrong, microsat) < 0.2


@pytest.mark.compiled
def test_unknown_torque_is_estimated(skewed):
    data = record(skewed, duration=200.0, disturbance=(2e-4, -3e-4, 1e-4))
    without = momentum_form(known(skewed), *data, parameters="full")
    assert relative(without, skewed) > 1e-3
    for method in MOMENTUM_METHODS:
        assert relative(method(known(skewed), *data, parameters="full", constant_torque=True), skewed) < 1e-4


def test_huber_shrugs_off_outliers(microsat):
    gyro, speed, dt = record(microsat)
    gyro = gyro.copy()
    gyro[::50] += 0.002
    plain = differentiated(known(microsat), gyro, speed, dt)
    robust = differentiated(known(microsat), gyro, speed, dt, huber_scale=1e-4)
    assert relative(robust, microsat) < 0.2 * relative(plain, microsat)


# what noise does


def noisy_estimates(method, satellite, std, count, bias=0.1):
    gyro, speed, dt = record(satellite, dt=0.5, duration=150.0, bias=bias)
    rng = np.random.default_rng(1)
    prior = known(satellite, std)
    fits = [method(prior, gyro + std * rng.standard_normal(gyro.shape), speed, dt) for _ in range(count)]
    return np.array([fit.theta for fit in fits]), np.array([fit.covariance for fit in fits]), gyro


@cases("bias", [0.0, 0.1])
@cases("method", MOMENTUM_METHODS)
@pytest.mark.compiled
def test_covariance_is_the_scatter(method, bias, microsat):
    """With momentum in the wheels the attitude's random walk counts as much as the reading's own noise."""
    count = 150
    theta, covariance, _ = noisy_estimates(method, microsat, 2e-4, count, bias)
    error = theta - np.diag(microsat.inertia)
    nees = np.einsum("ki,kij,kj->k", error, np.linalg.inv(covariance), error)
    low, high = scipy.stats.chi2.ppf([0.0005, 0.9995], 3 * count) / count
    assert low < nees.mean() < high


@pytest.mark.compiled
def test_instrument_removes_the_bias_of_noise(microsat):
    """Noise of variance s^2 on a regressor of variance v shrinks least squares by s^2 / (v + s^2)."""
    std, count = 2.5e-3, 60
    plain, _, gyro = noisy_estimates(momentum_form, microsat, std, count, bias=0.0)
    instrumental, covariance, _ = noisy_estimates(instrumental_variable, microsat, std, count, bias=0.0)
    truth = np.diag(microsat.inertia)
    shrink = std**2 / (gyro.var(axis=0) + std**2)
    assert shrink.min() > 0.01
    std_of_mean = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2).mean(axis=0) / count)
    np.testing.assert_allclose(1.0 - plain.mean(axis=0) / truth, shrink, rtol=0.35)
    assert (np.abs(instrumental.mean(axis=0) - truth) < 4.0 * std_of_mean + 0.1 * shrink * truth).all()


# what is refused


@cases("method", [differentiated, *MOMENTUM_METHODS])
def test_axis_without_motion_is_named(method, microsat):
    time = np.arange(100) * 0.5
    torque = smooth_torque(microsat, time)
    torque[:, 2] = 0.0
    flight = simulate(microsat, torque, 0.5)
    rng = np.random.default_rng(0)
    gyro = flight.omega * np.array([1.0, 1.0, 0.0]) + 5e-5 * rng.standard_normal((101, 3))
    with pytest.raises(NotIdentifiedError, match="Jzz"):
        method(known(microsat, 5e-5), gyro, flight.wheel_speed, 0.5)


@cases("method", [differentiated, *MOMENTUM_METHODS])
def test_record_at_rest_identifies_nothing(method, microsat):
    with pytest.raises(NotIdentifiedError, match="turn the body more"):
        method(known(microsat), np.zeros((50, 3)), np.zeros((50, 3)), 1.0)


def test_arguments_are_checked(microsat):
    gyro, speed, dt = record(microsat)
    with pytest.raises(ValueError, match="Did you mean 'full'"):
        momentum_form(known(microsat), gyro, speed, dt, parameters="ful")
    with pytest.raises(ValueError, match=r"gyro must have shape \(N, 3\) with N >= 6"):
        momentum_form(known(microsat), gyro[:3], speed[:3], dt)
    with pytest.raises(ValueError, match="wheel_speed must have shape"):
        momentum_form(known(microsat), gyro, speed[:-1], dt)
    with pytest.raises(ValueError, match="wheel_acceleration must have shape"):
        differentiated(known(microsat), gyro, speed, dt, wheel_acceleration=speed[:-1])
    with pytest.raises(ValueError, match="huber_scale"):
        differentiated(known(microsat), gyro, speed, dt, huber_scale=0.0)


def test_public_name():
    assert least_squares.momentum_form is momentum_form


# physical estimates


@cases("method", [differentiated, *MOMENTUM_METHODS])
@pytest.mark.compiled
def test_estimate_of_a_flat_plate_is_physical(method):
    plate = SATELLITES["microsat"].replace(name="plate", inertia=np.array([3.0, 4.0, 6.99]))
    gyro, speed, dt = record(plate, dt=0.5, duration=100.0)
    rng = np.random.default_rng(3)
    for _ in range(10):
        fit = method(known(plate, 3e-4), gyro + 3e-4 * rng.standard_normal(gyro.shape), speed, dt)
        inertia_tensor(fit.inertia)


@cases("count", [3, 6])
def test_coordinates_go_there_and_back(count):
    theta = np.array([6.5, 6.0, 4.5, 0.4, -0.3, 0.5])[:count]
    entries = to_factor(theta)
    np.testing.assert_allclose(from_factor(entries), theta, rtol=1e-12)
    numeric = scipy.optimize.approx_fprime(entries, from_factor, 1e-7)
    np.testing.assert_allclose(factor_jacobian(entries), numeric, atol=1e-5)


def test_nearest_physical_is_the_constrained_minimum():
    """Against sequential quadratic programming on the triangle inequalities themselves."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        theta = np.array([1.0, 1.2, 2.2 + rng.uniform(0.1, 0.5)])
        root = rng.standard_normal((3, 3)) + 2.0 * np.eye(3)
        information = root @ root.T
        assert not is_physical(theta)
        found = nearest_physical(theta, information)
        triangle = [{"type": "ineq", "fun": lambda x, s=s: s @ x} for s in 1.0 - 2.0 * np.eye(3)]
        best = scipy.optimize.minimize(
            lambda x, c=theta, w=information: (x - c) @ w @ (x - c),
            np.full(3, 1.5),
            method="SLSQP",
            constraints=triangle,
        )
        cost = (found - theta) @ information @ (found - theta)
        assert cost <= best.fun * (1.0 + 1e-3) + 1e-9
        inertia_tensor(found)
