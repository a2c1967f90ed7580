"""MomentumSmoother against filterpy's smoother, a batch Gaussian solution, and what statistics promise."""

import numpy as np
import pytest
import scipy.stats
from filterpy.kalman import KalmanFilter

from satid_gym import SCENARIOS, simulate
from satid_gym.estimators import FilterpyMomentumEKF, MomentumEKF, MomentumEKFSettings, MomentumSmoother
from satid_gym.estimators.smoother import _Transition
from satid_gym.scenario import prior_of
from tests.cases import cases


def flight(satellite, count, dt=0.5, seed=0, omega0=(0.0, 0.0, 0.0), disturbance=None):
    """FilterPrior and noisy readings of a flight with momentum in the wheels."""
    rng = np.random.default_rng(seed)
    n = satellite.wheels.count
    torque = 0.2 * satellite.wheels.max_torque * rng.choice([-1.0, 1.0], (count, n))
    speed = 0.05 * satellite.wheels.max_speed * np.linspace(-1.0, 1.0, n)
    truth = simulate(satellite, torque, dt, omega0=omega0, wheel_speed0=speed, disturbance=disturbance)
    known = prior_of(satellite, SCENARIOS["default"])
    gyro = truth.omega + known.gyro_noise_std * rng.standard_normal(truth.omega.shape)
    wheel_speed = truth.wheel_speed + known.tachometer_noise_std * rng.standard_normal(truth.wheel_speed.shape)
    return known, gyro, wheel_speed, truth


class Reference:
    """filterpy's run of the filter, with the affine transitions and measurements it linearised to."""

    def __init__(self, known, gyro, wheel_speed, dt, parameters):
        kf = FilterpyMomentumEKF(parameters=parameters)
        kf.reset(known, gyro[0], wheel_speed[0])
        self.mean, self.covariance = [kf.mean], [kf.covariance]
        self.jacobian, self.noise, self.ahead, self.rows, self.readings = [], [], [], [], []
        for z, speed in zip(gyro[1:], wheel_speed[1:], strict=True):
            kf.predict(speed, dt)
            self.jacobian.append(kf.filter.F.copy())
            self.noise.append(kf.filter.Q.copy())
            x, a = kf.mean, kf.model.spin @ speed
            self.ahead.append(x)
            h = kf.model.measurement_jacobian(x, a, z)
            self.rows.append((h, kf.model.measurement_noise(x)))
            self.readings.append(z - kf.model.rate(x, a) + h @ x)
            kf.update(z, speed)
            self.mean.append(kf.mean)
            self.covariance.append(kf.covariance)

    @property
    def offsets(self):
        """b of x_{k+1} = F x_k + b."""
        return [ahead - f @ m for ahead, f, m in zip(self.ahead, self.jacobian, self.mean, strict=False)]


def assert_same(run, mean, covariance, rtol=1e-5):
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    assert np.abs((run.mean - mean) / std).max() < rtol
    assert np.abs((run.covariance - covariance) / (std[:, :, None] * std[:, None, :])).max() < rtol


@pytest.mark.interpreted
@cases("parameters", ["principal", "full"])
def test_equals_filterpy(parameters, pyramid):
    known, gyro, wheel_speed, _ = flight(pyramid, 40)
    reference = Reference(known, gyro, wheel_speed, 0.5, parameters)
    shift = [np.zeros_like(reference.mean[0])]  # with it the transitions are linear, as filterpy wants them
    for f, b in zip(reference.jacobian, reference.offsets, strict=True):
        shift.append(f @ shift[-1] + b)
    unused = np.eye(len(shift[0]))
    size = len(shift[0])
    kf = KalmanFilter(dim_x=size, dim_z=3)
    x, p, _, _ = kf.rts_smoother(
        np.array(reference.mean) - np.array(shift),
        np.array(reference.covariance),
        Fs=[unused, *reference.jacobian],
        Qs=[unused, *reference.noise],
    )
    run = MomentumSmoother(parameters=parameters).run(known, gyro, wheel_speed, 0.5)
    assert_same(run, x + np.array(shift), p)


@pytest.mark.compiled
def test_equals_the_batch_gaussian_solution(skewed):
    """All states at once: affine functions of independent unit normals, conditioned on all readings."""
    known, gyro, wheel_speed, _ = flight(skewed, 12)
    known = known.replace(prior_std=0.04)  # coarser, and updates are iterated: no longer one affine reading each
    reference = Reference(known, gyro, wheel_speed, 0.5, "full")
    size, steps = len(reference.mean[0]), len(reference.mean)
    to_state, offset = [np.zeros((size, steps * size))], [reference.mean[0]]
    to_state[0][:, :size] = root(reference.covariance[0])
    for k in range(steps - 1):
        f = reference.jacobian[k]
        to_state.append(f @ to_state[-1])
        to_state[-1][:, (k + 1) * size : (k + 2) * size] = root(reference.noise[k])
        offset.append(f @ offset[-1] + reference.offsets[k])
    rows, values = [np.eye(steps * size)], [np.zeros(steps * size)]
    for k, ((h, noise), reading) in enumerate(zip(reference.rows, reference.readings, strict=True), start=1):
        whiten = np.linalg.inv(np.linalg.cholesky(noise))
        rows.append(whiten @ h @ to_state[k])
        values.append(whiten @ (reading - h @ offset[k]))
    q, r = np.linalg.qr(np.concatenate(rows))
    normals = np.linalg.solve(r, q.T @ np.concatenate(values))
    spread = [a @ np.linalg.inv(r) for a in to_state]
    mean = np.array([a @ normals + b for a, b in zip(to_state, offset, strict=True)])
    run = MomentumSmoother(parameters="full").run(known, gyro, wheel_speed, 0.5)
    assert_same(run, mean, np.array([s @ s.T for s in spread]))


def root(covariance):
    """S with S S^T = covariance, which may be singular."""
    std = np.sqrt(np.diag(covariance))
    std = np.where(std > 0.0, std, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(std, std))
    return std[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))


@cases("substeps", [1, 4])
def test_transition_is_the_filters(substeps, skewed):
    known, gyro, wheel_speed, _ = flight(skewed, 3, omega0=(0.02, -0.03, 0.04))
    kf = MomentumEKF(substeps=substeps, parameters="full")
    kf.reset(known, gyro[0], wheel_speed[0])
    mean, covariance = kf.mean, kf.covariance
    transition = _Transition(known, MomentumEKFSettings(substeps=substeps, parameters="full"), 0.5)
    ahead, spread, jacobian = transition(mean, covariance, wheel_speed[0], wheel_speed[1])
    kf.predict(wheel_speed[1], 0.5)
    np.testing.assert_allclose(ahead, kf.mean, rtol=1e-13)
    np.testing.assert_allclose(spread, kf.covariance, rtol=1e-9, atol=1e-9 * spread.diagonal().min())
    for j in range(len(mean)):
        step = 1e-4 * max(abs(mean[j]), 1e-3)
        sides = []
        for sign in (1.0, -1.0):
            moved = mean.copy()
            moved[j] += sign * step
            sides.append(transition(moved, covariance, wheel_speed[0], wheel_speed[1])[0])
        np.testing.assert_allclose((sides[0] - sides[1]) / (2.0 * step), jacobian[:, j], rtol=1e-5, atol=1e-8)


@pytest.mark.compiled
def test_ends_where_the_filter_ends_and_knows_more_before(microsat):
    known, gyro, wheel_speed, _ = flight(microsat, 200)
    forward = MomentumEKF().run(known, gyro, wheel_speed, 0.5)
    run = MomentumSmoother().run(known, gyro, wheel_speed, 0.5)
    np.testing.assert_array_equal(run.mean[-1], forward.mean[-1])
    before, after = (np.diagonal(r.covariance, axis1=1, axis2=2) for r in (forward, run))
    assert (after <= before * (1.0 + 1e-9)).all()
    assert (after[1, 3:6] < 0.5 * before[1, 3:6]).all()
    assert run.constrained_updates == forward.constrained_updates
    np.testing.assert_array_equal(run.nis, forward.nis)


def test_a_certain_state_stays_certain(microsat):
    known, gyro, wheel_speed, _ = flight(microsat, 30)
    run = MomentumSmoother().run(known.replace(disturbance_std=0.0, disturbance_walk=0.0), gyro, wheel_speed, 0.5)
    assert np.isfinite(run.mean).all()
    assert (run.mean[:, 6:] == 0.0).all()
    assert (run.covariance[:, 6:] == 0.0).all()


@pytest.mark.compiled
def test_consistent_over_a_hundred_flights(microsat):
    """Static inertia and disturbance drawn from the prior, no random walks: NEES is chi-square."""
    rng = np.random.default_rng(11)
    count, nees = 100, []
    for seed in range(count):
        moments = np.diag(microsat.inertia) * (1.0 + 0.05 * rng.standard_normal(3))
        torque = microsat.disturbance_std * rng.standard_normal(3)
        known, gyro, wheel_speed, _ = flight(microsat.replace(inertia=moments), 60, seed=seed, disturbance=torque)
        known = known.replace(inertia=microsat.inertia, prior_std=0.05)
        run = MomentumSmoother(inertia_walk=0.0, disturbance_walk=0.0).run(known, gyro, wheel_speed, 0.5)
        error = run.mean[20, 3:] - np.concatenate([moments, torque])
        nees.append(error @ np.linalg.solve(run.covariance[20, 3:, 3:], error))
    low, high = scipy.stats.chi2.ppf([0.0005, 0.9995], 6 * count) / count
    assert low < np.mean(nees) < high


def test_arguments_are_checked(microsat):
    known, gyro, wheel_speed, _ = flight(microsat, 5)
    forward = MomentumEKF().run(known, gyro, wheel_speed, 0.5)
    with pytest.raises(ValueError, match="wheel_speed must have shape"):
        MomentumSmoother().correct(forward, known, wheel_speed[1:], 0.5)
    with pytest.raises(ValueError, match="Did you mean 'substeps'"):
        MomentumSmoother(substep=2)
