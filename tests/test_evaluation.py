"""Scores against numbers worked out by hand; flights against the single environment."""

import itertools

import numpy as np
import pytest
import scipy.stats

import satid_gym
from satid_gym import metrics
from satid_gym.evaluation import Flight, benchmark_scenario, fly, seeds
from satid_gym.laws import InertiaLaw
from satid_gym.policies import build
from satid_gym.policy import missions
from satid_gym.problem import problem
from tests.cases import cases


class Constant:
    """The same action always."""

    name, kind = "constant", "scripted"

    def __init__(self, *action):
        self.action = np.array(action, float)

    def reset(self, mission, seeds):
        self.mission, self.count = mission, len(seeds)

    def __call__(self, observation):
        self.first = getattr(self, "first", observation)
        return np.tile(self.action, (self.count, 1))


class Asking(Constant):
    include_covariance = True


# metrics


def test_errors_by_hand():
    error = np.array([[0.5, 1.0], [0.2, 1.0], [0.1, 1.0], [0.04, 1.0], [0.03, 0.5]] * 2)
    np.testing.assert_allclose(metrics.final_error(error), [0.035, 0.75])  # the last 2 of 10
    np.testing.assert_allclose(metrics.mean_error(error), [0.174, 0.9])


def test_final_error_has_a_window_of_at_least_one():
    np.testing.assert_allclose(metrics.final_error(np.array([[3.0], [1.0]])), [1.0])


def test_time_to():
    error = np.array([[0.5, 0.5, 0.001], [0.01, 0.5, 0.5], [0.5, 0.5, 0.5]])
    np.testing.assert_array_equal(metrics.time_to(error, np.array([1.0, 2.0, 3.0])), [2.0, np.inf, 1.0])


def test_ten_seconds_of_turning_after_a_step_are_left_out():
    """Step before the end of row 11; in the second episode the body rests in rows 13 to 17."""
    stepped, turning = np.zeros((30, 2), bool), np.ones((30, 2), bool)
    stepped[11:], turning[13:18, 1] = True, False
    first, second = metrics.settled(stepped, turning, 1.0).T
    assert list(np.flatnonzero(~first)) == list(range(11, 21))
    assert list(np.flatnonzero(~second)) == list(range(11, 26))
    assert list(np.flatnonzero(~metrics.settled(stepped, turning, 5.0)[:, 0])) == [11, 12]
    assert not metrics.settled(stepped, np.zeros_like(turning), 1.0)[11:].any()


def test_a_body_turns_from_a_tenth_of_its_rate_limit_on():
    rate = np.array([[0.0, -0.06, 0.0], [0.049, 0.049, 0.049], [0.06, 0.0, 0.0]])
    assert metrics.turns(rate, 0.5).tolist() == [True, False, True]
    assert metrics.turns(rate, np.array([0.5, 0.4, 0.7])).tolist() == [True, True, False]


def test_consistency_is_the_mean_where_it_is_settled():
    settled = np.ones((4, 2), bool)
    settled[1, 0] = False
    nees = np.array([[1.0, 1.0], [100.0, 2.0], [2.0, 3.0], [np.nan, 6.0]])
    np.testing.assert_allclose(metrics.consistency(nees, settled), [1.5, 3.0])
    assert np.isnan(metrics.consistency(nees, np.zeros_like(settled))).all()


def test_interquartile_mean():
    assert metrics.iqm(np.array([-100.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 1000.0])) == pytest.approx(3.5)
    np.testing.assert_allclose(metrics.iqm(np.array([[0.0, 1.0, 3.0, 9.0], [4.0, 4.0, 4.0, 4.0]])), [2.0, 4.0])


def test_improvements():
    wins = metrics.improvements(np.array([1.0, 2.0, 3.0, 4.0]), np.array([2.0, 2.0, 2.0, 5.0]))
    np.testing.assert_array_equal(wins, [1.0, 0.5, 0.0, 1.0])


@cases(("trim", "statistic"), [(0.0, np.mean), (0.25, metrics.iqm)])
@cases("count", [16, 400])
def test_interval_of_a_normal_sample(trim, statistic, count):
    values = np.random.default_rng(1).normal(5.0, 2.0, count)
    low, high = metrics.bootstrap(values, trim=trim)
    assert low < statistic(values) < high
    # the interquartile mean of a normal sample has about 1.1 times the mean's deviation
    assert high - low == pytest.approx(2 * 1.96 * 2.0 / np.sqrt(count), rel=0.45)
    assert metrics.bootstrap(values, trim=trim) == (low, high)


def test_interval_leans_to_the_side_of_the_tail():
    values = np.random.default_rng(2).exponential(1.0, 60)
    low, high = metrics.bootstrap(values)
    assert high - values.mean() > 1.15 * (values.mean() - low)


def test_interval_of_few_episodes_is_students():
    values = np.array([0.01, 0.02, 0.04])
    # t of two degrees of freedom at 97.5 %: 4.302653
    half = 4.302653 * values.std(ddof=1) / np.sqrt(3)
    assert metrics.bootstrap(values) == pytest.approx((values.mean() - half, values.mean() + half))


def test_interval_of_a_few_trimmed_episodes_by_hand():
    """Five values, one cut at either end: winsorised (2, 2, 3, 7, 7), t of the two degrees of freedom that are left."""
    values = np.array([7.0, 1.0, 100.0, 3.0, 2.0])
    half = 4.302653 * np.std([2.0, 2.0, 3.0, 7.0, 7.0], ddof=1) / (0.5 * np.sqrt(5))
    assert metrics.bootstrap(values, trim=0.25) == pytest.approx((4.0 - half, 4.0 + half))


def test_twenty_episodes_are_enough_to_resample():
    """Student's interval is symmetric about the mean; that of resamples leans to the tail."""
    values = np.random.default_rng(2).exponential(1.0, 20)
    for count, symmetric in ((19, True), (20, False)):
        low, high = metrics.bootstrap(values[:count])
        assert (low + high == pytest.approx(2.0 * values[:count].mean(), rel=1e-9)) == symmetric


def test_resamples_of_equal_values_are_left_out():
    low, high = metrics.bootstrap(np.array([0.0] * 29 + [1.0]))
    assert np.isfinite([low, high]).all()
    assert low < 1.0 / 30.0 <= high * (1.0 + 1e-9)


def test_interval_of_equal_values():
    assert metrics.bootstrap(np.full(10, 0.25)) == (0.25, 0.25)
    assert metrics.bootstrap(np.array([3.0])) == (3.0, 3.0)
    assert metrics.bootstrap(np.array([0.0] * 30 + [1.0]), trim=0.25) == (0.0, 0.0)


def test_interval_of_shares():
    low, high = metrics.proportion_interval(np.array([1.0] * 8 + [0.0] * 2))
    # where 8 or more, and 8 or fewer, of 10 have a chance of 2.5 %
    assert 45 * low**8 * (1 - low) ** 2 + 10 * low**9 * (1 - low) + low**10 == pytest.approx(0.025)
    assert 1.0 - 10 * high**9 * (1 - high) - high**10 == pytest.approx(0.025)
    assert metrics.proportion_interval(np.ones(100)) == (pytest.approx(0.025**0.01), 1.0)
    assert metrics.proportion_interval(np.zeros(100)) == (0.0, pytest.approx(1.0 - 0.025**0.01))
    assert metrics.proportion_interval(np.full(10, 0.5)) == metrics.proportion_interval(np.repeat([0.0, 1.0], 5))


@cases("truth", [0.0, 0.001, 0.03, 0.5, 0.9455, 0.999, 1.0])
def test_interval_of_shares_covers_whatever_the_truth(truth):
    """By the binomial distribution of the wins, not by simulation; Wilson's would have 92.9 % at 0.9455."""
    wins = np.arange(101)
    ends = np.array([metrics.proportion_interval(np.repeat([1.0, 0.0], [k, 100 - k])) for k in wins])
    covered = (ends[:, 0] <= truth) & (truth <= ends[:, 1])
    assert scipy.stats.binom.pmf(wins, 100, truth)[covered].sum() >= 0.95


# seeds and scenarios


def test_splits_of_seeds_never_meet():
    first = {split: seeds(split, 1)[0] for split in ("training", "tuning", "validation", "test")}
    assert len(set(first.values())) == 4
    last = {split: seeds(split, 1, 999_999_999)[0] for split in first}
    ranges = sorted((first[split], last[split]) for split in first)
    assert all(before[1] < after[0] for before, after in itertools.pairwise(ranges))
    assert seeds("test", 3, 5) == [first["test"] + 5, first["test"] + 6, first["test"] + 7]


def test_seeds_that_do_not_exist():
    with pytest.raises(ValueError, match=r"unknown split of seeds 'tests'.*Did you mean 'test'"):
        seeds("tests", 3)
    with pytest.raises(ValueError, match="a split has 1000000000 seeds, asked for 2 from 999999999"):
        seeds("test", 2, 999_999_999)


@cases(("mode", "expected"), [("static", 1.0), ("step", 1.1), ("drift", 1.05), ("periodic", 1.0)])
@pytest.mark.compiled
def test_benchmark_flies_the_laws_of_the_paper(mode, expected):
    env = satid_gym.SatInertiaIDEnv("microsat", mode, benchmark_scenario())
    _, info = env.reset(seed=7)
    start = info["inertia_true"]
    largest = 0.0
    for _ in range(300):
        _, _, _, truncated, info = env.step(np.zeros(3, np.float32))
        largest = max(largest, float(np.trace(info["inertia_true"]) / np.trace(start)))
    assert truncated
    assert np.trace(info["inertia_true"]) / np.trace(start) == pytest.approx(expected, abs=1e-9)
    if mode == "periodic":  # 3 % at 0.02 Hz, seen each second: a sample lies within half a second of the crest
        assert largest == pytest.approx(1.03, abs=0.03 * (1 - np.cos(2 * np.pi * 0.02 * 0.5)) + 1e-9)


# flights


def test_flight_equals_the_single_environment():
    chosen = seeds("validation", 3)
    world = benchmark_scenario().replace(horizon=20.0)
    flight = fly(Constant(0.02, -0.01, 0.0), satellite="microsat", inertia="drift", seeds=chosen, scenario=world)
    assert flight.error.shape == (20, 3)
    np.testing.assert_array_equal(flight.time, np.arange(1.0, 21.0))
    env = satid_gym.SatInertiaIDEnv("microsat", "drift", world)
    for i, seed in enumerate(chosen):
        env.reset(seed=seed)
        for t in range(20):
            _, reward, _, _, info = env.step(np.array([0.02, -0.01, 0.0], np.float32))
            assert flight.error[t, i] == pytest.approx(info["relative_error"], rel=1e-9)
            assert flight.nees[t, i] == pytest.approx(info["nees"], rel=1e-9)
            assert flight.information[t, i] == pytest.approx(info["information_gain"], rel=1e-9)
            assert flight.outside[t, i] == pytest.approx(info["outside"])
            assert flight.reward[t, i] == pytest.approx(reward, rel=1e-9)
        assert flight.effort[-1, i] == pytest.approx((0.02**2 + 0.01**2) / 3.0, rel=1e-6)


@pytest.mark.compiled
def test_policies_of_a_cell_fly_the_same_episodes():
    cell = {"satellite": "cubesat", "inertia": "random", "seeds": seeds("test", 4), "scenario": "default"}
    one, other = Constant(0.1, 0.0, 0.0), Constant(0.0, 0.0, -0.1)
    fly(one, **cell), fly(other, **cell)
    np.testing.assert_array_equal(one.first, other.first)
    assert len(np.unique(one.first, axis=0)) == 4


def test_a_policy_that_asks_is_given_the_covariance():
    cell = {"satellite": "cubesat", "inertia": "random", "seeds": seeds("test", 2), "scenario": {"horizon": 5.0}}
    asking, other = Asking(0.1, 0.0, 0.0), Constant(0.1, 0.0, 0.0)
    np.testing.assert_array_equal(fly(asking, **cell).error, fly(other, **cell).error)
    assert asking.mission.layout == problem(include_covariance=True).layout
    assert other.mission.layout == problem().layout
    assert asking.first.shape == (2, 70)
    np.testing.assert_array_equal(asking.first[:, :37], other.first)
    asking.include_covariance = False
    fly(asking, **cell)
    assert asking.mission.layout == problem().layout


@pytest.mark.compiled
def test_termination_is_not_forgiven():
    flight = fly(Constant(1.0, 1.0, 1.0), satellite="cubesat", inertia="static", seeds=seeds("test", 5))
    last = flight.alive.sum(axis=0) - 1  # decision that ended it: 0.01 N m on 0.26 kg m^2 takes 4 s to 0.15 rad/s
    assert np.all((last >= 1) & (last <= 10))
    for i, t in enumerate(last):
        assert flight.outside[t, i] > 0.0
        np.testing.assert_array_equal(flight.outside[t + 1 :, i], 1.0)
        np.testing.assert_array_equal(flight.cost[t + 1 :, i], 1.0)
        np.testing.assert_array_equal(flight.error[t + 1 :, i], flight.error[t, i])
        for series in (flight.information, flight.effort, flight.reward, flight.nees, flight.saturated):
            np.testing.assert_array_equal(series[t + 1 :, i], 0.0)
    scores = flight.scores()
    assert scores["terminated"].all()
    np.testing.assert_allclose(scores["effort"], 1.0)
    np.testing.assert_allclose(scores["nees"], [flight.nees[: t + 1, i].mean() for i, t in enumerate(last)])


@pytest.mark.compiled
def test_an_end_in_the_last_decision_is_early_too():
    cell = {"satellite": "cubesat", "inertia": "static", "seeds": seeds("test", 5)}
    last = fly(Constant(1.0, 1.0, 1.0), **cell).alive.sum(axis=0)
    flight = fly(Constant(1.0, 1.0, 1.0), scenario={"horizon": float(last.min())}, **cell)
    assert flight.alive.all()
    np.testing.assert_array_equal(flight.scores()["terminated"], last == last.min())


def test_scores_by_hand():
    ones, zeros = np.ones((10, 2)), np.zeros((10, 2))
    error = np.linspace(0.10, 0.01, 10)[:, None] * np.array([1.0, 0.5])
    alive = np.ones((10, 2), bool)
    alive[5:, 1] = False
    flight = Flight(
        time=np.arange(1.0, 11.0), error=error, outside=0.25 * ones, nees=2.0 * ones, information=3.0 * ones,
        effort=np.where(alive, 0.5, 0.0), reward=ones, saturated=zeros, alive=alive, settled=np.ones((10, 2), bool),
        cost=0.3 * ones, terminated=~alive[-1],
    )  # fmt: skip
    expected = {
        "final_error": [0.015, 0.0075],
        "mean_error": [0.055, 0.0275],
        "time_to_1pct_s": [10.0, 9.0],
        "outside_fraction": [0.25, 0.25],
        "information_nats": [30.0, 30.0],
        "nees": [2.0, 2.0],
        "effort": [0.5, 0.5],
        "saturated_fraction": [0.0, 0.0],
        "reward": [10.0, 10.0],
        "terminated": [False, True],
        "cost": [0.3, 0.3],
    }
    scores = flight.scores()
    assert scores.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_allclose(scores[name], values, err_msg=name)


@pytest.mark.compiled
def test_the_cost_tells_of_limits_that_rates_and_wheels_do_not():
    """A tank's: slosh by commands back and forth that stay inside the limits of rates and wheels."""
    square = build("rate_square", {"period": 24.0, "margin": 2.5})
    cell = {"satellite": "microsat", "inertia": "static", "scenario": "slosh"}
    scores = fly(square, seeds=seeds("validation", 3), **cell).scores()
    assert (scores["cost"] > scores["outside_fraction"] + scores["saturated_fraction"] + 0.05).any()


@cases("policy", ["generalist", Constant, None])
def test_what_is_no_policy_is_refused_with_what_is(policy):
    with pytest.raises(ValueError, match=r"policy must be an object .*find\(\"generalist\"\) or make_baseline"):
        fly(policy, satellite="microsat", inertia="static", seeds=[0])


@cases("inertia", ["step", "release"])
@pytest.mark.compiled
def test_a_body_that_turns_is_settled_again_ten_seconds_after_its_step(inertia):
    """Each episode with a step time of its own."""
    flight = fly(Constant(0.5, 0.5, -0.5), satellite="smallsat", inertia=inertia, seeds=[0, 1], control="rate")
    unsettled = [flight.time[~own] for own in flight.settled.T]
    assert [np.ptp(own) for own in unsettled] == [9.0, 9.0]  # ten decisions
    assert unsettled[0][0] != unsettled[1][0]
    assert all(90.0 < own[0] < 212.0 for own in unsettled)  # step_time of LawRanges: 0.3 to 0.7 of 300 s


@pytest.mark.compiled
def test_a_decision_that_ends_with_the_step_is_not_settled():
    law = InertiaLaw("step", size=0.05, time=100.0)
    flight = fly(Constant(0.5, 0.5, -0.5), satellite="smallsat", inertia=law, seeds=[0], control="rate")
    assert list(flight.time[~flight.settled[:, 0]]) == list(np.arange(100.0, 110.0))


@cases("inertia", ["static", "drift", InertiaLaw("step", size=0.05, time=0.0)])
@pytest.mark.compiled
def test_a_body_that_rests_is_settled_where_nothing_steps_in_flight(inertia):
    assert fly(Constant(0.0, 0.0, 0.0), satellite="smallsat", inertia=inertia, seeds=[0]).settled.all()


def test_a_mission_holds_what_is_known_before_the_flight():
    full = problem(["cubesat", "smallsat"], scenario="paper", estimator={"name": "rate", "parameters": "full"})
    cubesat, smallsat = missions(full)
    np.testing.assert_allclose(np.diag(cubesat.prior.inertia), [0.208, 0.208, 0.128])  # 0.80 of nominal
    np.testing.assert_allclose(np.diag(smallsat.prior.inertia), [9.01, 12.07, 13.005])  # 0.85 of nominal
    assert cubesat.satellite.rate_limit == 0.5
    assert cubesat.layout["inertia"].stop - cubesat.layout["inertia"].start == 6
    tight = missions(problem("cubesat", scenario="tight"))[0]
    np.testing.assert_allclose(tight.satellite.wheels.max_speed, 46.0)
