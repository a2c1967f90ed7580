"""Consistency of the filters' uncertainty, and the wall: belief and measurement alone reach the agent.

NEES is per degree of freedom. Over N episodes at one time its average is chi-square with 3 N degrees of freedom
over 3 N where the filter is consistent; at different times it is correlated, so that several times are several
tests (Bonferroni), not more data.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import scipy.stats

from satid_gym import SatInertiaIDEnv, SatInertiaIDVectorEnv, paper_law
from satid_gym.core import kernels
from satid_gym.core.observation import layout
from satid_gym.core.records import Rows, log_dtype, report_dtype
from satid_gym.estimators import MomentumEKF
from satid_gym.estimators.momentum import MomentumEKFSettings
from satid_gym.estimators.records import new_belief, new_work
from satid_gym.law_ranges import PAPER_LAWS
from satid_gym.laws import INERTIA_MODES
from satid_gym.metrics import final_error
from satid_gym.satellite import BENCHMARK_SATELLITES
from satid_gym.scenario import prior_of
from satid_gym.templates import build_templates
from tests.cases import cases

EPISODES = 100
PARTS = layout(3, 3)
STATIC = {"name": "momentum", "inertia_walk": 0.0}
INSTANTS = np.array([120, 180, 240, 300]) - 1
EARLY = np.array([10, 30, 60]) - 1

pytestmark = pytest.mark.compiled  # hundreds of episodes


def square_wave(observation: np.ndarray, step: int) -> np.ndarray:
    """Persistent excitation inside the envelope: rates follow square waves of 30 s, 10 s apart, at 0.8 of the limit."""
    target = 0.8 * np.where((step / 30.0 + np.arange(3) / 3.0) % 1.0 < 0.5, 1.0, -1.0)
    wanted = (observation[:, PARTS["rate"]] - target) / observation[:, PARTS["control_authority"]]
    return np.clip(wanted, -1.0, 1.0).astype(np.float32)


def coast(observation: np.ndarray, step: int) -> np.ndarray:
    return np.zeros((len(observation), 3), np.float32)


@dataclass
class Flights:
    """(T, N) of each."""

    nees: np.ndarray
    error: np.ndarray
    scale: np.ndarray  # of the true inertia to the first: tells when a step came
    cost: np.ndarray
    gain: np.ndarray
    std: np.ndarray  # (N, 3) of theta at the end over that at the start

    @property
    def settled(self) -> np.ndarray:
        """False in the 10 s after a step of the inertia."""
        jump = np.abs(np.diff(self.scale, axis=0, prepend=self.scale[:1])) > 0.04
        since = np.array([jump[max(0, t - 10) : t + 1].any(axis=0) for t in range(len(jump))])
        return ~since


def fly(policy, satellite, inertia, *, scenario="default", estimator=None, episodes=EPISODES, seed=0) -> Flights:
    env = SatInertiaIDVectorEnv(episodes, satellite, inertia, scenario, estimator)
    observation, info = env.reset(seed=seed)
    first, start = observation[:, PARTS["uncertainty"]].astype(float), info["inertia_true"][:, 0, 0]
    series = {"nees": [], "relative_error": [], "cost": [], "information_gain": []}
    scale = []
    for step in range(env.problem.scenario.decisions):
        observation, _, terminated, _, info = env.step(policy(observation, step))
        assert not terminated.any()
        for key, values in series.items():
            values.append(info[key])
        scale.append(info["inertia_true"][:, 0, 0] / start)
    std = 10.0 ** (observation[:, PARTS["uncertainty"]] - first)
    arrays = [np.array(series[key]) for key in ("nees", "relative_error", "cost", "information_gain")]
    return Flights(arrays[0], arrays[1], np.array(scale), arrays[2], arrays[3], std)


def band(episodes: int, tests: int) -> tuple[float, float]:
    """95 % of the averages of a consistent filter, all `tests` of them at once."""
    tail = 0.025 / tests
    return tuple(scipy.stats.chi2.ppf([tail, 1.0 - tail], 3 * episodes) / (3 * episodes))


# Consistent uncertainty


MATCHED = {
    # the filter's model is the world's: constant disturbance, gyros without drift, a prior that truth is drawn from
    "orbit_rate": 0.0,
    "gravity_gradient": False,
    "solar_pressure": 0.0,
    "gyro_bias_walk": 0.0,
    "tachometer_noise_std": 1e-6,  # else one reading's noise is in two predictions and an update
    "inertia_std": 0.05,
    "prior_std": 0.05,
}


@pytest.mark.parametrize("satellite", BENCHMARK_SATELLITES)
def test_filter_is_consistent_in_the_world_it_models(satellite):
    """The algebra alone: with nothing mismatched, NEES is chi-square, and so is its average over all episodes."""
    estimator = STATIC | {"disturbance_walk": 0.0, "substeps": 4}
    nees = fly(square_wave, satellite, "static", scenario=MATCHED, estimator=estimator).nees
    low, high = band(EPISODES, len(INSTANTS))
    average = nees[INSTANTS].mean(axis=1)
    assert ((low < average) & (average < high)).all(), average
    low, high = band(EPISODES, 1)
    assert low < nees.mean() < high


# The contract: 100 episodes in the 95 % band, in the default scenario with the inertia walk off. Five hundreds of
# episodes, so that no luck with the seeds decides.


@pytest.fixture(scope="module")
def static_cells() -> dict[str, np.ndarray]:
    """NEES (T, 500) of the default scenario with static inertia and without its walk."""
    return {
        s: fly(square_wave, s, "static", estimator=STATIC, episodes=5 * EPISODES).nees for s in BENCHMARK_SATELLITES
    }


def averages(nees: np.ndarray, instants: np.ndarray) -> np.ndarray:
    """NEES averaged over each hundred episodes, at each instant."""
    return nees[instants].reshape(len(instants), -1, EPISODES).mean(axis=2)


@pytest.mark.parametrize("satellite", BENCHMARK_SATELLITES)
def test_nees_is_in_the_chi_square_band_for_static_inertia(satellite, static_cells):
    average = averages(static_cells[satellite], INSTANTS)
    low, high = band(EPISODES, average.size)
    assert ((low < average) & (average < high)).all(), average


@pytest.mark.parametrize("satellite", BENCHMARK_SATELLITES)
def test_nees_is_in_the_chi_square_band_in_the_first_minute(satellite, static_cells):
    average = averages(static_cells[satellite], EARLY)
    low, high = band(EPISODES, average.size)
    assert ((low < average) & (average < high)).all(), average


@pytest.fixture(scope="module")
def default_cells() -> dict[tuple[str, str], Flights]:
    """The default scenario and tuning, 100 episodes a cell."""
    return {(s, mode): fly(square_wave, s, mode) for s in BENCHMARK_SATELLITES for mode in INERTIA_MODES}


@pytest.mark.parametrize("mode", INERTIA_MODES)
@pytest.mark.parametrize("satellite", BENCHMARK_SATELLITES)
def test_default_tuning_stays_consistent_while_the_inertia_varies(satellite, mode, default_cells):
    flights = default_cells[satellite, mode]
    assert flights.settled.all() == (mode != "step")
    assert 0.3 < flights.nees[flights.settled].mean() < 2.0


@pytest.mark.parametrize("mode", INERTIA_MODES)
@pytest.mark.parametrize("satellite", BENCHMARK_SATELLITES)
def test_final_error_under_persistent_excitation(satellite, mode, default_cells):
    """At most 0.2 %, by the paper's metric, at most 1 % of the time outside the envelope."""
    flights = default_cells[satellite, mode]
    assert final_error(flights.error).mean() < 2e-3
    assert flights.cost.mean() < 0.01


def test_a_step_is_seen_and_then_forgiven():
    """Just after a step a filter of one walk is wrong and does not know it; ten seconds later it does."""
    flights = fly(square_wave, "microsat", "step", estimator="momentum")
    steps = np.abs(np.diff(flights.scale, axis=0)).argmax(axis=0)
    at = np.array([flights.nees[t + 1, i] for i, t in enumerate(steps)])
    later = np.array([flights.nees[t + 20, i] for i, t in enumerate(steps)])
    assert np.median(at) > 10.0
    assert np.median(later) < 2.0


def test_open_loop_excitation_is_consistent_too():
    """Another persistently exciting policy, blind: torque square waves."""

    def blind(observation, step):
        sign = np.where((step / 30.0 + np.arange(3) / 3.0) % 1.0 < 0.5, 1.0, -1.0)
        return (0.04 / observation[:, PARTS["control_authority"]] * sign).astype(np.float32)

    flights = fly(blind, "microsat", "random")
    assert 0.3 < flights.nees[flights.settled].mean() < 2.0


# No excitation, no information


QUIET = {
    "initial_rate_std": 0.0,
    "wheel_speed_range": 0.0,
    "torque_noise": 0.0,
    "disturbance_scale": 0.0,
    "gravity_gradient": False,
    "solar_pressure": 0.0,
    "gyro_bias_walk": 0.0,
}


@cases("satellite", BENCHMARK_SATELLITES)
def test_a_body_at_rest_under_perfect_sensors_tells_nothing(satellite):
    scenario = QUIET | {"gyro_noise_std": 0.0, "tachometer_noise_std": 0.0}
    flights = fly(coast, satellite, "static", scenario=scenario, estimator=STATIC, episodes=5)
    np.testing.assert_allclose(flights.std, 1.0, rtol=1e-6)
    np.testing.assert_allclose(flights.gain, 0.0, atol=1e-9)
    assert (flights.error < 0.8).all()


@cases("satellite", BENCHMARK_SATELLITES)
def test_a_body_at_rest_under_real_sensors_tells_almost_nothing(satellite):
    flights = fly(coast, satellite, "static", scenario=QUIET, estimator=STATIC, episodes=20)
    assert flights.std.mean() > 0.9
    assert flights.gain.sum(axis=0).mean() < 0.5
    assert flights.nees[-1].mean() < 2.0


def test_an_axis_that_does_not_turn_is_not_learned():
    """Only wheel 0 works: 20 times less is learned about the other axes than about the first."""

    def one_axis(observation, step):
        action = square_wave(observation, step)
        action[:, 1:] = 0.0
        return action

    std = fly(one_axis, "microsat", "static", scenario=QUIET, estimator=STATIC, episodes=20).std
    assert std[:, 0].max() < 0.01
    assert (std[:, 1:].min(axis=1) > 20.0 * std[:, 0]).all()


# Truth stays out


class Recorder(MomentumEKF):
    """The MomentumEKF, which keeps every reading it is given."""

    def reset(self, prior, gyro, wheel_speed):
        self.readings = [(gyro, wheel_speed)]
        super().reset(prior, gyro, wheel_speed)

    def update(self, gyro, wheel_speed):
        self.readings.append((gyro, wheel_speed))
        return super().update(gyro, wheel_speed)


def test_swapping_the_true_inertia_under_the_same_measurements_changes_nothing():
    """The episode's readings replayed through belief and task alone, next to a truth of no relation to them."""
    recorder = Recorder()
    env = SatInertiaIDEnv(inertia="periodic", estimator=recorder, reward={"held_scale": 0.1, "effort_weight": 0.1})
    observation, _ = env.reset(seed=3)
    actions = [square_wave(observation[None], 0)[0]]
    observations, rewards = [observation], []
    for step in range(1, 61):
        observation, reward, *_ = env.step(actions[-1])
        observations.append(observation)
        rewards.append(reward)
        actions.append(square_wave(observation[None], step)[0])

    problem = env.problem
    beliefs = new_belief(prior_of(problem.satellites[0], problem.scenario), MomentumEKFSettings())
    work, tasks = new_work(beliefs), build_templates(problem).records.tasks
    # a truth of twice the inertia, upside down, under another law and at its own rate
    other = build_templates(problem, inertia=2.0 * np.array([4.53, 5.96, 6.53])).records.plants
    other["rate"], other["momentum"], other["law"] = 0.01, 0.3, 2
    other["law_time"], other["change"] = 100.0, np.diag([1.0, 2.0, 3.0])
    rows = Rows(
        plants=other,
        beliefs=beliefs,
        tasks=tasks,
        reports=np.zeros(1, report_dtype(3)),
        observations=np.zeros((1, len(observation)), np.float32),
        logs=np.zeros((1, 0), log_dtype(3, 3)),
    )
    task, report = rows.tasks[0], rows.reports[0]

    readings = iter(recorder.readings)

    def show() -> tuple[np.ndarray, np.ndarray]:
        gyro, speed = next(readings)
        other["gyro"], other["tachometer"] = gyro, speed
        return gyro, speed

    kernels.start_filter(beliefs, work, *show())
    kernels.look(rows, work)
    np.testing.assert_allclose(rows.observations[0], observations[0], rtol=0, atol=1e-9)
    for i, action in enumerate(actions[:-1]):
        task["command"], report["effort"] = action, np.mean(np.square(action, dtype=float))
        report["peak_rate"], report["information_gain"] = 0.0, 0.0
        for _ in range(task["samples"]):
            gyro, speed = show()
            report["peak_rate"] = np.maximum(report["peak_rate"], np.abs(gyro))
            kernels.predict_filter(beliefs, work, speed, 0.1)
            before = kernels.uncertainty_nats(beliefs, work, 0)
            kernels.condition_filter(beliefs, work, gyro, speed)
            report["information_gain"] += before - kernels.uncertainty_nats(beliefs, work, 0)
        kernels.conclude(rows, work)
        np.testing.assert_allclose(rows.observations[0], observations[i + 1], rtol=0, atol=1e-9)
        assert report["reward"] == pytest.approx(rewards[i], abs=1e-9)
    assert report["relative_error"] > 0.3, "the truth next to it is another"


# The truth it is scored against


class Oracle(MomentumEKF):
    """Says J0 whatever it reads."""

    def __init__(self, inertia):
        super().__init__()
        self.answer = np.asarray(inertia)

    @property
    def mean(self):
        mean = super().mean
        mean[3:6] = self.answer
        return mean


@cases(
    ("mode", "low", "high"),
    [("static", 0.0, 1e-12), ("step", 0.09085, 0.09095), ("drift", 0.04305, 0.04315), ("periodic", 0.0184, 0.0191)],
)
@cases("given", ["options", "scenario"])
def test_a_perfect_constant_estimate_scores_what_the_law_is_off_by(mode, low, high, given):
    """Over the last 20 %: 1/11 on the step, 0.045/1.045 on the drift, 0.03 (2/pi) on the periodic law."""
    truth = np.array([6.0, 5.5, 5.0])
    law = paper_law(mode)
    options = {"true_inertia": truth} | ({"inertia": law} if given == "options" else {})
    scenario = {"laws": PAPER_LAWS} if given == "scenario" else "default"
    env = SatInertiaIDEnv(inertia=mode, scenario=scenario, estimator=Oracle(truth))
    _, info = env.reset(seed=0, options=options)
    errors, factors = [], []
    for step in range(300):
        *_, info = env.step(0.02 * np.where((step / 20.0 + np.arange(3) / 3.0) % 1.0 < 0.5, 1.0, -1.0))
        errors.append(info["relative_error"])
        factors.append(np.diag(info["inertia_true"]) / truth)
        t = info["time"]
        expected = {
            "static": 1.0,
            "step": 1.1 if t >= 150.0 else 1.0,
            "drift": 1.0 + 0.05 * t / 300.0,
            "periodic": 1.0 + 0.03 * np.sin(2.0 * np.pi * 0.02 * t),
        }[mode]
        np.testing.assert_allclose(factors[-1], expected, rtol=1e-12)
        assert t == pytest.approx(step + 1)
        assert info["relative_error"] == pytest.approx(abs(1.0 - 1.0 / expected), abs=1e-12)
    assert low <= final_error(np.array(errors)[:, None])[0] <= high
