"""The posterior bound against the information recursion written out; the envelope bound against search."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from satid_gym import SATELLITES, simulate
from satid_gym.bounds import (
    TrueMotion,
    envelope_bound,
    episode_bounds,
    population_bound,
    posterior_bound,
    rate_cap,
    reference_limit,
    sample_information,
)
from satid_gym.estimators import MomentumEKFSettings
from satid_gym.estimators.filterpy.model import MomentumModel
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario, prior_of

DT = 0.1
RATES = np.array([0.02, -0.03, 0.025])


def fly(
    satellite: Satellite, torque: np.ndarray, disturbance: tuple[float, float, float] = (2e-5, -1e-5, 3e-5)
) -> TrueMotion:
    """The truth of one episode under motor torque (T - 1, n)."""
    path = simulate(satellite, torque, DT, omega0=0.2 * RATES, wheel_speed0=np.full(3, 20.0), disturbance=disturbance)
    tau = np.broadcast_to(disturbance, path.omega.shape)
    return TrueMotion(
        momentum=path.momentum[None],
        rate=path.omega[None],
        wheel_speed=path.wheel_speed[None],
        inertia=path.inertia[None],
        torque=tau[None],
    )


def square(satellite: Satellite, seconds: int, period: int = 6) -> np.ndarray:
    """Staggered square wave of full motor torque."""
    time = np.arange(round(seconds / DT)) * DT
    phase = time[:, None] / period + np.arange(3) / 3.0 + 0.25
    return np.where(np.mod(phase, 1.0) < 0.5, 1.0, -1.0) * satellite.wheels.max_torque


@pytest.mark.interpreted
@pytest.mark.parametrize("parameters", ["principal", "full"])
@pytest.mark.parametrize("walk", [0.0, 0.004])
def test_posterior_bound_is_the_information_recursion(skewed: Satellite, parameters: str, walk: float) -> None:
    satellite = skewed if parameters == "full" else SATELLITES["microsat"]
    motion = fly(satellite, 0.5 * square(satellite, 5))
    inertia = np.linspace(1.0, 1.2, motion.rate.shape[1])[None, :, None, None] * motion.inertia
    free = motion.momentum - motion.wheel_speed @ (satellite.wheels.axes * satellite.wheels.inertia).T
    motion = replace(motion, inertia=inertia, rate=np.linalg.solve(inertia, free[..., None])[..., 0])
    prior = prior_of(satellite, Scenario())
    settings = MomentumEKFSettings(parameters=parameters, inertia_walk=walk)
    model = MomentumModel(settings, prior)
    places = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)][: model.p]
    spin = motion.wheel_speed[0] @ model.spin.T

    def state(k: int) -> np.ndarray:
        theta = [motion.inertia[0, k, i, j] for i, j in places]
        return np.concatenate([motion.momentum[0, k], theta, motion.torque[0, k]])

    told = prior_of(satellite.replace(name="truth"), Scenario())
    assert np.array_equal(told.inertia, motion.inertia[0, 0])  # prior mean is the truth, as the bound takes it
    covariance = model.start(motion.rate[0, 0], motion.wheel_speed[0, 0])[1]
    out = posterior_bound(motion, prior, settings, DT)[0]
    information = np.linalg.inv(covariance)
    for k in range(1, len(out)):
        before, here = state(k - 1), state(k)
        f = model.step_jacobian(before, spin[k - 1], spin[k], DT)
        q = model.process_noise(before, spin[k - 1], DT, DT)
        h, r = model.rate_jacobian(here, spin[k]), model.measurement_noise(here)
        information = np.linalg.inv(q + f @ np.linalg.inv(information) @ f.T) + h.T @ np.linalg.solve(r, h)
        block = slice(3, 3 + model.p)
        np.testing.assert_allclose(out[k], np.linalg.inv(information)[block, block], rtol=1e-5)


def test_information_of_a_sample_by_hand() -> None:
    satellite = SATELLITES["cubesat"]
    prior = prior_of(satellite, Scenario())
    inertia = np.diag([0.26, 0.26, 0.16])
    found = sample_information(np.array([0.05, 0.05, 0.05]), inertia, prior, 6)
    # std of J omega about z: sqrt((1e-4 * 0.16)^2 + (1e-4 * 0.05)^2) = 1.676e-5; 0.05 over it, squared
    assert found[2] == pytest.approx(0.05**2 / (2.56e-10 + 2.5e-11), rel=1e-12)
    x = 0.05**2 / ((1e-4 * 0.26) ** 2 + 2.5e-11)
    assert found[3] == pytest.approx(2.0 * x, rel=1e-12)


def test_rate_cap_by_hand() -> None:
    satellite = SATELLITES["cubesat"]
    still = np.zeros((1, 40, 3))
    inertia = np.broadcast_to(satellite.inertia, (1, 40, 3, 3))
    motion = TrueMotion(momentum=still, rate=still, wheel_speed=still, inertia=inertia, torque=still)
    cap = rate_cap(motion, satellite, DT)[0]
    # 0.01 N m on 0.26 - 1e-4 kg m^2: 0.0385 rad/s after 1 s, at the limit of 0.05 after 1.3 s
    assert cap[10, 0] == pytest.approx(0.01 / 0.2599, rel=1e-12)
    assert cap[13, 0] == pytest.approx(0.05)
    tight = Scenario(wheel_speed_scale=0.1).operate(satellite)
    # 1e-4 kg m^2 at 46 rad/s: 4.6e-3 N m s, 0.0177 rad/s of 0.26 kg m^2
    assert rate_cap(motion, tight, DT)[0, -1, 0] == pytest.approx(4.6e-3 / 0.26)


def varying(satellite: Satellite, episodes: int = 2) -> TrueMotion:
    """Two seconds of courses whose inertia grows by 10 %, from rates and torques of their own."""
    rng = np.random.default_rng(0)
    shape = (episodes, 21, 3)
    growth = np.linspace(1.0, 1.1, 21)[None, :, None, None] * np.linspace(1.0, 1.2, episodes)[:, None, None, None]
    return TrueMotion(
        momentum=0.05 * rng.normal(size=shape),
        rate=0.5 * satellite.rate_limit * rng.normal(size=shape),
        wheel_speed=50.0 * rng.normal(size=shape),
        inertia=growth * satellite.inertia,
        torque=1e-4 * rng.normal(size=shape),
    )


@pytest.mark.parametrize("parameters", ["principal", "full"])
def test_sample_information_is_the_largest_inside_the_box(skewed: Satellite, parameters: str) -> None:
    """L_j^T W L_j is convex in omega, so the largest over the box |omega_i| <= cap_i is at one of its corners."""
    prior, cap = prior_of(skewed, Scenario()), np.array([0.03, 0.02, 0.01])
    inertia, wheels = skewed.inertia, prior.wheels
    noise = prior.gyro_noise_std**2 * inertia @ inertia
    noise += (wheels.axes * (wheels.inertia * prior.tachometer_noise_std) ** 2) @ wheels.axes.T
    corners = cap * np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
    p = 3 if parameters == "principal" else 6
    found = np.zeros((len(corners), p))
    for c, omega in enumerate(corners):
        x, y, z = omega
        regressor = np.array([[x, 0, 0, y, z, 0], [0, y, 0, x, 0, z], [0, 0, z, 0, x, y]])[:, :p]
        found[c] = np.einsum("ij,ij->j", regressor, np.linalg.solve(noise, regressor))
    expected = found.max(axis=0)
    np.testing.assert_allclose(sample_information(cap, inertia, prior, p), expected, rtol=1e-10)


def test_rate_cap_by_its_definition(skewed: Satellite) -> None:
    """The three limits of the module's docstring, instant by instant, each of which binds somewhere."""
    motion, wheels = varying(skewed), skewed.wheels
    limits = set()
    for scale in (1.0, 0.02):
        satellite = skewed.replace(wheels=wheels.replace(max_speed=scale * wheels.max_speed), rate_limit=0.02)
        stored = np.abs(wheels.axes) @ (wheels.inertia * wheels.max_speed * scale)
        J_free = motion.inertia - (wheels.axes * wheels.inertia) @ wheels.axes.T
        cap = rate_cap(motion, satellite, DT)
        for i in range(2):
            tau = np.linalg.norm(motion.torque[i], axis=1).max()
            for k in range(21):
                momentum = np.linalg.norm(motion.momentum[i, 0]) + k * DT * tau
                storage = np.abs(np.linalg.inv(motion.inertia[i, k])) @ (momentum + stored)
                push = np.abs(wheels.axes) @ wheels.max_torque + momentum * np.sqrt(3.0) * 0.02 + tau
                reached = np.abs(J_free[i, 0] @ motion.rate[i, 0]) + k * DT * push
                torque = np.abs(np.linalg.inv(J_free[i, k])) @ reached
                candidates = np.array([np.full(3, 0.02), storage, torque])
                limits |= set(candidates.argmin(axis=0).tolist())
                np.testing.assert_allclose(cap[i, k], candidates.min(axis=0), rtol=1e-12)
    assert limits == {0, 1, 2}


@pytest.mark.parametrize(("parameters", "law_known"), [("principal", False), ("principal", True), ("full", False)])
def test_envelope_bound_is_a_scalar_riccati_equation(skewed: Satellite, parameters: str, law_known: bool) -> None:
    """1/v' = 1 / (g^2 (v + walk)) + information, parameter by parameter."""
    motion, prior = varying(skewed), prior_of(skewed, Scenario())
    settings = MomentumEKFSettings(parameters=parameters, inertia_walk=0.01)
    p = 3 if parameters == "principal" else 6
    information = sample_information(rate_cap(motion, skewed, DT), motion.inertia, prior, p)
    out = envelope_bound(motion, skewed, prior, settings, DT, law_known=law_known)
    walk = (0.01 * prior.theta_scale(parameters)) ** 2 * DT
    for i in range(2):
        precision = 1.0 / prior.prior_theta_std(parameters) ** 2 + information[i, 0]
        np.testing.assert_allclose(out[i, 0], 1.0 / precision, rtol=1e-12)
        for k in range(1, 21):
            growth = motion.inertia[i, k, 0, 0] / motion.inertia[i, k - 1, 0, 0] if law_known else 1.0
            precision = 1.0 / (growth**2 * (1.0 / precision + walk)) + information[i, k]
            np.testing.assert_allclose(out[i, k], 1.0 / precision, rtol=1e-10)


@pytest.mark.interpreted
def test_a_known_law_scales_what_is_known(skewed: Satellite) -> None:
    """Without walk and without noise in the momentum, a law that doubles J doubles theta's standard deviations.

    Against the motion of a body whose inertia stays: with no information in between, the factor is that of the law.
    """
    still = varying(skewed, 1)
    zero = np.zeros_like(still.rate)
    inertia = np.broadcast_to(np.diag(np.diag(skewed.inertia)), (1, 21, 3, 3))
    grown = inertia * np.linspace(1.0, 2.0, 21)[None, :, None, None]
    prior = prior_of(skewed, Scenario()).replace(gyro_noise_std=1e3)
    settings = MomentumEKFSettings(inertia_walk=0.0)
    motion = TrueMotion(momentum=zero, rate=zero, wheel_speed=zero, inertia=grown, torque=zero)
    known = posterior_bound(motion, prior, settings, DT, law_known=True)[0]
    np.testing.assert_allclose(known[-1], 4.0 * known[0], rtol=1e-9)
    np.testing.assert_allclose(known[10], 2.25 * known[0], rtol=1e-9)
    unknown = posterior_bound(motion, prior, settings, DT)[0]
    np.testing.assert_allclose(unknown[-1], unknown[0], rtol=1e-9)
    deployed = inertia.copy()
    deployed[:, 10:, 0, 2] = deployed[:, 10:, 2, 0] = 0.5
    motion = TrueMotion(momentum=zero, rate=zero, wheel_speed=zero, inertia=deployed, torque=zero)
    with pytest.raises(ValueError, match=r'factor on each parameter, and Jxz passes through zero.* "principal"'):
        posterior_bound(motion, prior, settings, DT, law_known=True)


@pytest.mark.interpreted
@pytest.mark.parametrize("parameters", ["principal", "full"])
def test_the_bound_is_taken_at_the_truth(skewed: Satellite, parameters: str) -> None:
    """What the filter was told of the mean does not matter, only how far it was told to trust it."""
    motion, prior = varying(skewed), prior_of(skewed, Scenario())
    settings = MomentumEKFSettings(parameters=parameters, inertia_walk=0.0)
    other = prior.replace(
        inertia=1.25 * prior.inertia, prior_std=prior.prior_std / 1.25, product_std=prior.product_std / 1.25
    )
    first, second = (posterior_bound(motion, told, settings, DT) for told in (prior, other))
    np.testing.assert_allclose(second, first, rtol=1e-9, atol=1e-12 * first.max())


def test_relative_bounds_by_hand() -> None:
    """A product of inertia stands twice in the tensor; two episodes' information is averaged, not their bounds."""
    inertia = np.broadcast_to(np.diag([2.0, 2.0, 1.0]), (2, 1, 3, 3))  # norm 3
    variance = np.array([[[0.09, 0.18, 0.27]], [[0.09, 0.36, 0.27]]])
    np.testing.assert_allclose(episode_bounds(variance, inertia), [[0.06], [0.08]])
    # 0.18 and 0.36 have the harmonic mean 0.24
    np.testing.assert_allclose(population_bound(variance, inertia), [(0.09 + 0.24 + 0.27) / 9.0])
    full = np.concatenate([variance, variance], axis=2)
    np.testing.assert_allclose(episode_bounds(full, inertia), [[0.18], [0.24]])
    matrix = variance[..., None] * np.eye(3)
    np.testing.assert_allclose(episode_bounds(matrix, inertia), [[0.06], [0.08]])
    # correlated: the inverse of the mean of inverses, by hand for one episode is the matrix itself
    correlated = np.array([[[[0.09, 0.03, 0.0], [0.03, 0.18, 0.0], [0.0, 0.0, 0.27]]]])
    np.testing.assert_allclose(population_bound(correlated, inertia[:1]), [0.06])
    both = np.concatenate([correlated, matrix[1:]])
    mean = 0.5 * (np.linalg.inv(correlated[0, 0]) + np.linalg.inv(matrix[1, 0]))
    np.testing.assert_allclose(population_bound(both, inertia), [np.trace(np.linalg.inv(mean)) / 9.0])


@pytest.mark.parametrize("parameters", ["principal", "full"])
def test_reference_limit_is_that_of_a_scalar_filter(skewed: Satellite, parameters: str) -> None:
    """Gain k of the filter's Riccati equation: lag' = (1 - k) (lag - change), noise' = (1 - k)^2 noise + k^2 R."""
    motion, prior = varying(skewed), prior_of(skewed, Scenario())
    settings = MomentumEKFSettings(parameters=parameters, inertia_walk=0.01)
    p = 3 if parameters == "principal" else 6
    places = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)][:p]
    information = sample_information(rate_cap(motion, skewed, DT), motion.inertia, prior, p)
    out = reference_limit(motion, skewed, prior, settings, DT)
    walk = (0.01 * prior.theta_scale(parameters)) ** 2 * DT
    for i in range(2):
        theta = np.array([motion.inertia[i, :, a, b] for a, b in places]).T
        error = np.array([prior.inertia[a, b] for a, b in places]) - theta[0]
        variance, noise = prior.prior_theta_std(parameters) ** 2, np.zeros(p)
        for k in range(21):
            if k > 0:
                variance, error = variance + walk, error - (theta[k] - theta[k - 1])
            sensor = 1.0 / information[i, k]
            gain = variance / (variance + sensor)
            variance, error = (1.0 - gain) * variance, (1.0 - gain) * error
            noise = (1.0 - gain) ** 2 * noise + gain**2 * sensor
            np.testing.assert_allclose(out[i, k], noise + error**2, rtol=1e-9)


@pytest.mark.parametrize("walk", [0.0, 0.004])
@pytest.mark.parametrize("parameters", ["principal", "full"])
@pytest.mark.compiled
def test_envelope_bound_is_below_the_posterior_bound(parameters: str, walk: float) -> None:
    satellite = SATELLITES["microsat"]
    settings = MomentumEKFSettings(parameters=parameters, inertia_walk=walk)
    prior = prior_of(satellite, Scenario())
    for period, amplitude in ((4, 0.5), (8, 0.3), (12, 0.2)):
        motion = fly(satellite, amplitude * square(satellite, 30, period))
        assert np.abs(motion.rate).max() < satellite.rate_limit
        posterior = posterior_bound(motion, prior, settings, DT)
        least = envelope_bound(motion, satellite, prior, settings, DT)
        assert (np.diagonal(posterior, axis1=2, axis2=3) >= least * (1 - 1e-9)).all()


def swings(satellite: Satellite, commands: np.ndarray) -> TrueMotion:
    """Truth of plans (N, B, 3): rates that go to each command as fast as torque allows, and stay a second.

    The rates are given, so M follows from dM/dt = M x omega alone, and the wheels from a = M - J omega. Plans
    that the wheels cannot fly are marked with NaN.
    """
    inertia, limit = np.diag(satellite.inertia), satellite.rate_limit
    slew = DT * 0.9 * satellite.wheels.max_torque / inertia
    count, blocks = commands.shape[:2]
    rate = np.zeros((count, blocks * 10 + 1, 3))
    momentum = np.zeros_like(rate)
    for k in range(blocks * 10):
        wanted = limit * np.clip(commands[:, k // 10], -1.0, 1.0)
        rate[:, k + 1] = rate[:, k] + np.clip(wanted - rate[:, k], -slew, slew)
        middle = 0.5 * (rate[:, k] + rate[:, k + 1])
        half = momentum[:, k] + 0.5 * DT * np.cross(momentum[:, k], rate[:, k])
        momentum[:, k + 1] = momentum[:, k] + DT * np.cross(half, middle)
    speed = (momentum - inertia * rate) / satellite.wheels.inertia
    motor = np.diff(satellite.wheels.inertia * (speed + rate), axis=1) / DT
    flown = (np.abs(motor) <= satellite.wheels.max_torque).all((1, 2)) & (
        np.abs(speed) <= satellite.wheels.max_speed
    ).all((1, 2))
    momentum[~flown] = np.nan
    shape = (*rate.shape[:2], 3, 3)
    return TrueMotion(
        momentum=momentum,
        rate=rate,
        wheel_speed=speed,
        inertia=np.broadcast_to(satellite.inertia, shape),
        torque=np.zeros_like(rate),
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cubesat", "smallsat"])
@pytest.mark.parametrize("walk", [0.0, 0.004])
@pytest.mark.compiled
def test_no_excitation_that_search_finds_beats_the_envelope_bound(name: str, walk: float) -> None:
    """Cross-entropy search over rate plans of 30 s for the least final error of all."""
    satellite = SATELLITES[name]
    prior, settings = prior_of(satellite, Scenario()), MomentumEKFSettings(inertia_walk=walk)
    rng = np.random.default_rng(1)
    mean, std, best = np.zeros((30, 3)), np.full((30, 3), 1.0), np.inf
    first = swings(satellite, mean[None])
    least = population_bound(envelope_bound(first, satellite, prior, settings, DT), first.inertia)[-1]
    for _ in range(20):
        plans = mean + std * rng.standard_normal((64, 30, 3))
        motion = swings(satellite, plans)
        flown = np.isfinite(motion.momentum).all((1, 2))
        assert flown.sum() > 12
        covariance = posterior_bound(motion, prior, settings, DT)[:, -1]
        error = np.where(flown, np.trace(covariance, axis1=1, axis2=2), np.inf) / np.linalg.norm(satellite.inertia) ** 2
        elite = plans[np.argsort(error)[:12]]
        mean, std = elite.mean(axis=0), elite.std(axis=0) + 0.05
        best = min(best, error.min())
    assert least <= best < (1.1 if walk > 0.0 else 3.0) * least  # with forgetting the bound is nearly reached
