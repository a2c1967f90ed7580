"""Information and reward, against numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from satid_gym import SATELLITES, Panel, SatInertiaIDEnv
from satid_gym.core import kernels
from satid_gym.core.records import Criterion
from satid_gym.estimators import MomentumEKF
from satid_gym.reward import RewardSettings
from satid_gym.scenario import prior_of
from satid_gym.scenario_catalogue import SCENARIOS
from tests.cases import cases

LOG2 = np.log(2.0)
LIGHT = Panel(  # so light that the body does not give way
    mass=1e-5, hinge=[0.0, 0.3, 0.0], axis=[0.0, 0.0, 1.0], arm=[0.0, 0.6, 0.0], frequency=0.25, damping=0.0,
    mass_std=0.2, mirrored=True, deflection_limit=0.01,
)  # fmt: skip
CALM = {"disturbance_scale": 0.0, "torque_noise": 0.0, "initial_rate_std": 0.0, "wheel_speed_range": 0.0}


class Recorder(MomentumEKF):
    """The MomentumEKF, which keeps the readings it is given: the environment's belief seen from outside."""

    def reset(self, prior, gyro, wheel_speed):
        self.gyro = [gyro]
        super().reset(prior, gyro, wheel_speed)

    def update(self, gyro, wheel_speed):
        self.gyro.append(gyro)
        return super().update(gyro, wheel_speed)


def started(gyro=(0.0, 0.0, 0.0), **changes) -> MomentumEKF:
    """A filter of the microsat with the prior's numbers replaced, after its first reading."""
    ekf = MomentumEKF(inertia_walk=0.0, disturbance_walk=0.0)
    prior = prior_of(SATELLITES["microsat"], SCENARIOS["default"])
    ekf.reset(prior.replace(**changes), gyro, (0.0, 0.0, 0.0))
    return ekf


def nats(ekf: MomentumEKF, criterion: int) -> float:
    return kernels.uncertainty_nats(ekf.records, ekf.work, int(criterion))


# Information


@cases(
    ("stds", "logdet", "trace", "maxeig"),
    [
        # std over prior std: none learned; one axis to a half; every axis to a quarter
        ((1.0, 1.0, 1.0), 0.0, 0.0, 0.0),
        ((0.5, 1.0, 1.0), -LOG2, 1.5 * np.log(2.25 / 3.0), 0.0),
        ((0.25, 0.25, 0.25), -6.0 * LOG2, -6.0 * LOG2, -6.0 * LOG2),
        ((0.5, 0.25, 0.125), -6.0 * LOG2, 1.5 * np.log((16 + 4 + 1) / 64 / 3), -3.0 * LOG2),
    ],
)
def test_nats_of_independent_moments(stds, logdet, trace, maxeig):
    """p = 3: D is the sum of log std ratios, A and E are 3/2 log of the mean and of the largest variance ratio."""
    ekf = started()
    ekf.records["covariance"][0, 3:6, 3:6] = np.diag((ekf.records["prior_theta_std"][0] * stds) ** 2)
    assert nats(ekf, Criterion.LOGDET) == pytest.approx(logdet, abs=1e-12)
    assert nats(ekf, Criterion.TRACE) == pytest.approx(trace, abs=1e-12)
    assert nats(ekf, Criterion.MAXEIG) == pytest.approx(maxeig, abs=1e-12)


def test_nats_of_two_correlated_moments():
    """Correlation 0.6: determinant 1 - 0.36 = 0.64, largest eigenvalue 1.6, trace as before."""
    ekf = started()
    correlation = np.array([[1.0, 0.6, 0.0], [0.6, 1.0, 0.0], [0.0, 0.0, 1.0]])
    scale = ekf.records["prior_theta_std"][0]
    ekf.records["covariance"][0, 3:6, 3:6] = correlation * np.outer(scale, scale)
    assert nats(ekf, Criterion.LOGDET) == pytest.approx(np.log(0.8))
    assert nats(ekf, Criterion.TRACE) == pytest.approx(0.0, abs=1e-15)
    assert nats(ekf, Criterion.MAXEIG) == pytest.approx(1.5 * np.log(1.6))


def test_d_optimality_is_least_and_e_optimality_most():
    """Inequality of the means: D <= A <= E for any covariance."""
    rng, ekf = np.random.default_rng(0), started()
    for _ in range(100):
        a = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-3, 0, 3)
        ekf.records["covariance"][0, 3:6, 3:6] = a @ a.T
        d, mean, largest = (nats(ekf, criterion) for criterion in Criterion)
        assert d <= mean + 1e-12
        assert mean <= largest + 1e-12


def test_one_reading_of_a_known_momentum_by_hand():
    """M known, omega = (w, 0, 0): z_x = M_x / J_x, so d z_x / d J_x = -w / J_x and log(1 + r) / 2 is learned.

    Here r = (w std_J / (J sigma))^2 is the ratio of the two variances. J = 6, std_J = 0.6, w = 0.03 and
    sigma = 0.003 make r = 1: half a log 2 is learned, all of it about J_x, whose variance halves.
    """
    ekf = started(inertia=np.diag([6.0, 6.0, 6.0]), prior_std=0.1, gyro_noise_std=3e-3, tachometer_noise_std=0.0)
    belief = ekf.records[0]
    belief["covariance"][:] = 0.0
    belief["covariance"][3:6, 3:6] = 0.36 * np.eye(3)
    belief["mean"][:3] = 6.0 * 0.03, 0.0, 0.0
    before = nats(ekf, Criterion.LOGDET)
    ekf.update((0.03, 0.0, 0.0), (0.0, 0.0, 0.0))  # as predicted: the estimate stays where the derivative is taken
    assert before - nats(ekf, Criterion.LOGDET) == pytest.approx(0.5 * LOG2, rel=1e-12)
    np.testing.assert_allclose(np.diag(ekf.covariance)[3:6], [0.18, 0.36, 0.36], rtol=1e-12)
    np.testing.assert_allclose(ekf.mean[3:6], 6.0, rtol=1e-12)


def test_a_lost_covariance_is_flagged_and_not_hidden():
    ekf = started()
    ekf.records["covariance"][0, 4, 4] = -1e-9
    assert np.isnan(nats(ekf, Criterion.LOGDET))
    assert ekf.records["broken"][0] == 1


@cases("criterion", Criterion)
@cases("variance", [0.0, -1.0])
def test_a_covariance_without_spread_is_flagged_by_every_criterion(criterion, variance):
    """Nothing is known to a variance of zero or below: not a number, and the flag says that the filter is lost."""
    ekf = started()
    ekf.records["covariance"][0, 3:6, 3:6] = variance * np.eye(3)
    assert np.isnan(nats(ekf, criterion))
    assert ekf.records["broken"][0] == 1


# Reward


def square_wave(step: int, amplitude: float = 0.1) -> np.ndarray:
    return amplitude * np.where((step / 20.0 + np.arange(3) / 3.0) % 1.0 < 0.5, 1.0, -1.0).astype(np.float32)


@cases("criterion", ["logdet", "trace", "maxeig"])
def test_reward_is_a_tenth_of_the_information_inside_the_envelope(criterion):
    env = SatInertiaIDEnv(reward=criterion)
    env.reset(seed=1)
    for step in range(30):
        _, reward, _, _, info = env.step(square_wave(step, 0.05))
        assert info["cost"] == 0.0
        assert reward == pytest.approx(0.1 * info["information_held"], rel=1e-12)
    assert info["information_held"] > 5.0


def test_effort_is_the_mean_square_of_the_action_cut_to_the_limits():
    reward = {"held_scale": 0.0, "envelope_weight": 0.0, "effort_weight": 2.0}
    env = SatInertiaIDEnv(reward=reward)
    env.reset(seed=1)
    # (1 + 1/4 + 0) / 3 = 5/12, and (1 + 1/16 + 0) / 3 with 7 cut to 1
    for action, effort in (((1.0, -0.5, 0.0), 5 / 12), ((7.0, 0.25, 0.0), 17 / 48)):
        _, value, _, _, info = env.step(np.array(action, np.float32))
        assert info["effort"] == pytest.approx(effort, rel=1e-12)
        assert value == pytest.approx(-2.0 * effort, rel=1e-12)


def test_envelope_penalty_by_hand():
    """Largest readings of the decision 0.97, 0.5 and 1.2 limits: 10 (0 + 0 + 0.2) = 2; nothing is paid inside."""
    env = SatInertiaIDEnv(reward={"held_scale": 0.0})
    env.reset(seed=1)
    env.fleet.rows.reports["peak_rate"][0] = np.array([0.97, 0.5, 1.2]) * 0.03
    kernels.conclude(env.fleet.rows, env.fleet.work)
    assert env.fleet.rows.reports["reward"][0] == pytest.approx(-2.0, rel=1e-9)


def test_envelope_penalty_counts_the_largest_reading_of_the_decision():
    recorder = Recorder()
    env = SatInertiaIDEnv(
        reward={"held_scale": 0.0, "envelope_weight": 3.0, "envelope_margin": 0.5}, estimator=recorder
    )
    env.reset(seed=2)
    penalties = []
    for step in range(40):
        _, reward, *_ = env.step(square_wave(step, 0.2))
        peak = np.abs(recorder.gyro[-10:]).max(axis=0) / 0.03
        assert reward == pytest.approx(-3.0 * np.maximum(0.0, peak - 0.5).sum(), rel=1e-9, abs=1e-12)
        penalties.append(reward)
    assert min(penalties) < 0.0
    assert max(penalties) == 0.0


def test_cost_is_the_share_of_samples_that_the_true_rate_is_outside():
    env = SatInertiaIDEnv(
        scenario={"disturbance_scale": 0.0, "torque_noise": 0.0, "initial_rate_std": 0.0, "wheel_speed_range": 0.0}
    )
    env.reset(seed=3, options={"inertia": "static", "true_inertia": (6.0, 6.0, 6.0)})
    # full torque on one wheel: 0.1 / (6 - j) rad/s^2, so 0.03 rad/s is passed at 1.7994 s: 2 of 10 samples inside
    costs = [env.step(np.array([1.0, 0.0, 0.0], np.float32))[4]["cost"] for _ in range(3)]
    assert costs == [0.0, pytest.approx(0.3), 1.0]


def test_a_wheel_at_its_speed_limit_costs_its_share_of_the_wheels():
    calm = {"disturbance_scale": 0.0, "torque_noise": 0.0, "initial_rate_std": 0.0, "wheel_speed_range": 0.0}
    weights = {"held_scale": 0.0, "envelope_weight": 0.0, "saturation_weight": 3.0}
    env = SatInertiaIDEnv("cubesat", "static", {**calm, "name": "tight"}, reward=weights)  # 46 rad/s hold .0046 N m s
    env.reset(seed=3)
    steps = [env.step(np.array([0.5, 0.0, 0.0], np.float32)) for _ in range(2)]  # .005 N m: full after .92 s
    assert [step[1] for step in steps] == [pytest.approx(-1.0), pytest.approx(-1.0)]
    assert [step[4]["cost"] for step in steps] == [pytest.approx(1.0 / 3.0)] * 2
    assert [step[4]["outside"] for step in steps] == [0.0, 0.0]


def bent(deflection: float, **settings) -> SatInertiaIDEnv:
    """A body at rest whose panels are bent by this many limits."""
    flexible = SATELLITES["microsat"].replace(oscillators=[LIGHT])
    env = SatInertiaIDEnv(flexible, "static", {**CALM, "solar_pressure": 0.0, "gravity_gradient": False}, **settings)
    env.reset(seed=1)
    env.fleet.rows.plants["oscillators"]["deflection"] = deflection * LIGHT.deflection_limit
    return env


def test_deflection_costs_the_share_of_samples_beyond_the_limit():
    """q = q_0 cos(w t), w = pi / 2 per s: 2 limits until acos(1/2) / w = 2/3 s, so 6 of the first 10 samples."""
    env = bent(2.0)
    _, _, terminated, _, info = env.step(np.zeros(3, np.float32))
    assert info["costs"]["deflection"] == pytest.approx(0.6)
    assert info["cost"] == pytest.approx(0.6)
    assert not terminated
    assert bent(0.99).step(np.zeros(3, np.float32))[4]["costs"]["deflection"] == 0.0


@cases(("deflection", "ends"), [(3.9, False), (4.2, True)])
def test_deflection_beyond_its_factor_ends_the_episode(deflection, ends):
    """Sampled .1 s on, q_0 cos(0.157) = 0.988 q_0 counts: 3.85 and 4.15 limits of the 4 that are allowed."""
    _, _, terminated, _, info = bent(deflection).step(np.zeros(3, np.float32))
    assert terminated == ends
    np.testing.assert_allclose(info["deflection"], deflection * np.cos(0.05 * np.pi) * 0.01, rtol=1e-3)


def test_deflection_penalty_by_hand():
    """A largest estimate of 1.5 limits in the decision pays 4 (1.5 - 1) = 2; 0.9 limits pay nothing."""
    for bend, paid in ((1.5, 2.0), (0.9, 0.0)):
        env = bent(0.0, reward={"held_scale": 0.0, "envelope_weight": 0.0, "deflection_weight": 4.0})
        env.fleet.rows.reports["peak_bend"] = bend
        kernels.conclude(env.fleet.rows, env.fleet.work)
        assert env.fleet.rows.reports["reward"][0] == pytest.approx(-paid, abs=1e-12)


def test_deflection_is_paid_for_as_the_filter_estimates_it():
    """The filter, told that the panels are 1.4 times as heavy and bent by 1.5 limits, pays for 1.5 at their largest."""
    env = bent(1.5, reward={"held_scale": 0.0, "envelope_weight": 0.0, "deflection_weight": 1.0})
    belief = env.fleet.rows.beliefs[0]
    eta = 1.5 * LIGHT.deflection_limit * np.sqrt(2.0 * 1.4 * LIGHT.inertance)  # of a pair, of unit modal mass
    at = belief["modes"]["first"]
    belief["mean"][at], belief["mean"][at + 3] = eta, 0.5 * np.log(1.4)
    _, value, *_ = env.step(np.zeros(3, np.float32))
    assert value == pytest.approx(-(1.5 * np.cos(0.05 * np.pi) - 1.0), rel=0.01)


def test_net_gain_telescopes_and_held_is_its_sum():
    """Net of forgetting, the gains of an episode are what is known at its end less what was known at its start."""
    env = SatInertiaIDEnv(reward={"net": True})
    _, info = env.reset(seed=1)
    gains = []
    for step in range(60):
        *_, info = env.step(square_wave(step, 0.05))
        gains.append(info["information_gain"])
        assert sum(gains) == pytest.approx(info["information_held"], abs=1e-9)


@pytest.mark.compiled
def test_summed_gain_exceeds_net_gain_by_what_the_filter_forgot():
    runs = {}
    for net in (False, True):
        env = SatInertiaIDEnv(reward={"net": net}, estimator="momentum")
        env.reset(seed=1)
        runs[net] = np.array([env.step(square_wave(step, 0.05))[4]["information_gain"] for step in range(60)])
    assert (runs[False] >= 0.0).all(), "an update never loses information"
    assert (runs[False] > runs[True]).all()
    # with no random walk of the inertia nothing is forgotten
    env = SatInertiaIDEnv(reward={"net": True}, estimator={"name": "momentum", "inertia_walk": 0.0})
    env.reset(seed=1)
    still = np.array([env.step(square_wave(step, 0.05))[4]["information_gain"] for step in range(60)])
    assert (still >= 0.0).all()


def test_held_information_pays_by_its_own_scale():
    env = SatInertiaIDEnv(reward={"gain_scale": 0.2, "held_scale": 0.5, "held_reference": 3.0})
    env.reset(seed=1)
    for step in range(20):
        _, reward, _, _, info = env.step(square_wave(step, 0.05))
        held, gained = info["information_held"], info["information_gain"]
        assert reward == pytest.approx(0.5 * (held - 3.0) + 0.2 * gained, rel=1e-12)
    assert RewardSettings().gain_scale == 0.0
