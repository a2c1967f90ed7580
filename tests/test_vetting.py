"""The gate of the MomentumEKF, reading by reading: filterpy's version of it, and steps worked out by hand."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.stats import chi2

from satid_gym import ReactionWheels, simulate
from satid_gym.estimators import FilterPrior, FilterpyMomentumEKF, MomentumEKF
from satid_gym.scenario import prior_of
from satid_gym.scenario_catalogue import SCENARIOS
from tests.cases import cases

DT, GATE = 0.1, 1e-6

# what happens to the readings of some seconds, by the sample: gyro repeats (g), is far out on one axis (o), the
# tachometer of wheel 0 or 1 repeats (0, 1), nothing (.); every rule of the gate has its edge in one of these
STORIES = {
    "repeated gyro": "g.g.gg..",
    "one outlier and two": "..o.oo..o.",
    "outlier that repeats": "..o..o.g.o.",
    "more than two are accepted": "..ooo....ooooo..",
    "tachometers": "0.00..1.00000000000000..",
    "one wheel after the other": ".0011.0(01)(01)1.",
    "outage for ten samples": ".(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)..",
    "outage for eleven": ".(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)..",
    "outage for twelve": ".(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)..",
    "outage, wheel back first": ".(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)gg..",
    "outage, gyro back first": ".(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)00..",
    "outage in two parts": ".(0g)(0g)(0g)(0g)(0g)(0g)0(0g)(0g)(0g)(0g)(0g)(0g)..",
    "outage for ten samples, and again": ".(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)(0g)00(0g)(0g)..",
    "outliers of a stuck wheel": ".00(0o)0(0o)(0o)(0o)0..",
    "outliers before an outage and after": ".oo" + 13 * "(0g)" + "..o.oo.o..",
}
SHAPES = [("microsat", "principal", 1), ("skewed", "full", 3), ("pyramid", "full", 1)]
TOLD = [  # every story with one of the shapes by turns, and what most depends on the shape with each
    *((story, SHAPES[i % 3]) for i, story in enumerate(STORIES)),
    *((story, shape) for story in ("more than two are accepted", "one wheel after the other") for shape in SHAPES),
]


def events(story: str) -> list[str]:
    """What happens in each sample."""
    parts = story.replace("(", " (").replace(")", ") ").split()
    return [event for part in parts for event in ([part.strip("()")] if part.startswith("(") else part)]


def readings(satellite, story: str, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gyro (N, 3), tachometers (N, n) and commanded torque (N - 1, n) of a flight to which a story happens."""
    what = events(story)
    rng, n = np.random.default_rng(seed), satellite.wheels.count
    torque = satellite.wheels.max_torque * rng.uniform(-0.5, 0.5, (len(what), n))
    speed = 0.1 * satellite.wheels.max_speed * rng.uniform(-1.0, 1.0, n)
    flight = simulate(satellite, torque, DT, omega0=np.array([0.01, -0.006, 0.008]), wheel_speed0=speed)
    gyro = flight.omega + satellite.gyro_noise_std * rng.normal(size=flight.omega.shape)
    tachometer = flight.wheel_speed + satellite.tachometer_noise_std * rng.normal(size=flight.wheel_speed.shape)
    for i, event in enumerate(what, start=1):
        if "g" in event:
            gyro[i] = gyro[i - 1]
        if "o" in event:
            gyro[i, i % 3] += 30.0 * satellite.gyro_noise_std * (-1.0) ** i
        for k in (0, 1):
            if str(k) in event:
                tachometer[i, k] = tachometer[i - 1, k]
    return gyro, tachometer, torque


def assert_same(fast, slow) -> None:
    std = np.sqrt(np.diag(slow.covariance))
    np.testing.assert_allclose(fast.mean / std, slow.mean / std, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(fast.covariance / np.outer(std, std), slow.covariance / np.outer(std, std), atol=1e-7)


@cases(("story", "shape"), list(dict.fromkeys(TOLD)))
def test_every_step_is_filterpys(story, shape, request):
    name, parameters, substeps = shape
    satellite = request.getfixturevalue(name)
    prior = prior_of(satellite, SCENARIOS["default"])
    settings = {"parameters": parameters, "substeps": substeps, "gate": GATE}
    fast, slow = MomentumEKF(**settings), FilterpyMomentumEKF(**settings)
    gyro, tachometer, torque = readings(satellite, STORIES[story])
    for filter in (fast, slow):
        filter.reset(prior, gyro[0], tachometer[0])
    for i, commanded in enumerate(torque, start=1):
        for filter in (fast, slow):
            filter.command(commanded)
            filter.predict(tachometer[i], DT)
        assert_same(fast, slow)
        assert fast.update(gyro[i], tachometer[i]) == pytest.approx(slow.update(gyro[i], tachometer[i]), rel=1e-6)
        assert_same(fast, slow)
    assert fast.constrained_updates == 0  # which filterpy's does not know


# by hand: a ball of known inertia with three wheels along its axes, whose M - a is 6 kg m^2 times its rate

BALL, SIGMA, SPIN = 6.0, 5e-5, 2e-3
WHEELS = ReactionWheels(inertia=SPIN, max_torque=0.1, max_speed=900.0)
EDGE = float(chi2.isf(GATE, 3))


def rejected(filter: MomentumEKF) -> int:
    """What `info["rejected"]` counts."""
    return int(filter.records["rejected"][0])


def resting(gyro=(0.0, 0.0, 0.0), tachometer_noise_std: float = 1e-12) -> MomentumEKF:
    """The filter after its first reading, with the wheels at rest and no torque from outside."""
    filter = MomentumEKF(gate=GATE, inertia_walk=0.0, disturbance_walk=0.0)
    prior = FilterPrior(
        wheels=WHEELS,
        inertia=BALL * np.eye(3),
        prior_std=0.0,
        product_std=0.0,
        gyro_noise_std=SIGMA,
        tachometer_noise_std=tachometer_noise_std,
        disturbance_std=0.0,
    )
    filter.reset(prior, np.array(gyro), np.zeros(3))
    return filter


SPEEDS = itertools.count(1)  # 1e-12 rad/s, of wheels that hardly turn: no two readings are the same


def read(filter: MomentumEKF, *gyro: float) -> float:
    """Normalised innovation squared of one more sample of new readings."""
    speed = np.full(3, 1e-12 * next(SPEEDS))
    filter.predict(speed, DT)
    return 3.0 * filter.update(np.array(gyro), speed)


@cases(("share", "accepted"), [(0.9999, True), (1.0001, False)])
def test_a_reading_is_rejected_beyond_the_quantile_of_its_distance(share, accepted):
    """Two readings of M have a difference of variance 2 sigma^2, so x is at a distance of x^2 / 2 sigma^2."""
    filter = resting()
    x = share * np.sqrt(2.0 * EDGE) * SIGMA
    assert read(filter, 0.6 * x, -0.8 * x, 1e-20) == pytest.approx(share**2 * EDGE, rel=1e-6)
    moved = 0.5 * BALL * x if accepted else 0.0
    np.testing.assert_allclose(filter.mean[:3], [0.6 * moved, -0.8 * moved, 0.0], rtol=1e-6, atol=1e-10)
    variance = (BALL * SIGMA) ** 2 * (0.5 if accepted else 1.0)
    np.testing.assert_allclose(np.diag(filter.covariance)[:3], variance, rtol=1e-6)


def test_the_third_rejection_in_a_row_is_accepted_and_inflates_the_inertia():
    """By a tenth of each moment; it would have moved M by nothing, for the body was at rest."""
    filter = resting()
    read(filter, 1e-6, 2e-6, -1e-6)
    before = filter.mean
    for count, x in enumerate((0.01, 0.0101), start=1):
        assert read(filter, x, 0.0, 0.0) > EDGE
        assert rejected(filter) == count
        np.testing.assert_allclose(filter.mean, before, atol=1e-9)
        assert np.diag(filter.covariance)[3:6].max() == 0.0
    read(filter, 0.01, 1e-7, 0.0)
    assert np.abs(filter.mean - before).max() > 1e-6
    np.testing.assert_allclose(np.sqrt(np.diag(filter.covariance)[4:6]), 0.1 * BALL, rtol=0.01)
    assert rejected(filter) == 2


def test_a_reading_that_is_accepted_ends_a_run_of_rejections():
    filter = resting()
    for x, rejects in ((1e-6, False), (0.01, True), (0.011, True), (2e-6, False), (0.01, True), (0.011, True)):
        before = filter.mean[0]
        assert (read(filter, x, 0.0, 0.0) > EDGE) == rejects
        assert (abs(filter.mean[0] - before) < 1e-9) == rejects


def test_where_the_first_reading_was_the_outlier_momentum_is_reinitialised():
    filter = resting((0.02, -0.01, 0.03))
    for x in (1e-6, 2e-6):
        assert read(filter, x, 0.0, 0.0) > EDGE
    assert read(filter, 3e-6, 4e-6, -5e-6) == 0.0
    np.testing.assert_allclose(filter.mean[:3], BALL * np.array([3e-6, 4e-6, -5e-6]), atol=1e-9)
    np.testing.assert_allclose(np.diag(filter.covariance)[:3], (BALL * SIGMA) ** 2, rtol=1e-6)
    assert read(filter, 0.01, 0.0, 0.0) > EDGE  # and the new start is no more accepted than the first was
    assert read(filter, 0.011, 0.0, 0.0) > EDGE
    assert read(filter, 0.01, 0.0, 0.0) == 0.0
    assert filter.mean[0] == pytest.approx(BALL * 0.01, rel=1e-6)


def test_a_wheel_without_tachometer_follows_its_command_or_does_ten_times_its_motor():
    filter = resting()
    filter.command(np.array([0.05, 0.02, -0.03]))
    filter.predict(np.array([0.0, 1e-9, 1e-9]), DT)
    std = 10.0 * 0.1 * DT  # N m s
    np.testing.assert_allclose(
        np.diag(filter.covariance)[:3] - (BALL * SIGMA) ** 2, [std**2, 0.0, 0.0], rtol=1e-6, atol=1e-12
    )
    turned = -0.05 * DT / BALL  # what the body does when the wheel obeys
    assert 3.0 * filter.update(np.array([turned, 0.0, 0.0]), np.zeros(3)) == pytest.approx(0.0, abs=1e-9)
    filter.predict(np.array([0.05 * DT / SPIN, 2e-9, 2e-9]), DT)  # back, and it has obeyed
    np.testing.assert_allclose(filter.mean[:3], 0.0, atol=1e-9)
    assert filter.covariance[0, 0] > std**2  # once more, for what it did until it was back
    filter.update(np.array([turned, 1e-9, 0.0]), np.zeros(3))
    before = filter.covariance[0, 0]
    filter.predict(np.array([0.05 * DT / SPIN + 1e-9, 3e-9, 3e-9]), DT)
    assert filter.covariance[0, 0] == pytest.approx(before, rel=1e-6)


def test_a_noiseless_tachometer_may_repeat_itself():
    filter = resting(tachometer_noise_std=0.0)
    filter.command(np.array([0.05, 0.02, -0.03]))
    filter.predict(np.zeros(3), DT)
    np.testing.assert_allclose(np.diag(filter.covariance)[:3], (BALL * SIGMA) ** 2, rtol=1e-9)
    assert filter.update(np.array([0.0, 1e-20, 0.0]), np.zeros(3)) == pytest.approx(0.0, abs=1e-9)


def test_a_gyro_reading_that_repeats_the_first_is_none():
    filter = resting((1e-6, 2e-6, 3e-6))
    read(filter, 1e-6, 2e-6, 3e-6)
    assert rejected(filter) == 1
    np.testing.assert_allclose(np.diag(filter.covariance)[:3], (BALL * SIGMA) ** 2, rtol=1e-6)
    read(filter, 1e-6, 2e-6, 4e-6)
    assert rejected(filter) == 1
    np.testing.assert_allclose(np.diag(filter.covariance)[:3], 0.5 * (BALL * SIGMA) ** 2, rtol=1e-6)


def test_what_the_gyro_sees_of_an_unmeasured_wheel_is_the_wheels_doing():
    """Nothing was commanded, the body turns by x about z: the wheel has taken up -6 x, and momentum is what it was."""
    filter = resting()
    x = 1e-3
    filter.predict(np.array([1e-9, 1e-9, 0.0]), DT)
    filter.update(np.array([0.0, 0.0, x]), np.zeros(3))
    np.testing.assert_allclose(filter.mean[:3], 0.0, atol=1e-9)
    filter.predict(np.array([2e-9, 2e-9, -BALL * x / SPIN]), DT)  # the tachometer is back and says so
    np.testing.assert_allclose(filter.mean[:3], 0.0, atol=2e-6)
    assert 3.0 * filter.update(np.array([1e-9, 0.0, x]), np.zeros(3)) < 1.0


@pytest.mark.parametrize(("outage", "lost"), [(10, False), (11, True)])
def test_momentum_is_reinitialised_after_more_than_ten_samples_without_gyro_and_a_tachometer(outage, lost):
    """Then M has the variance of the one reading; else the bound on what the wheel may have done leaves it less."""
    filter = resting()
    read(filter, 0.0, 1e-9, 0.0)
    speed = np.array([1e-9, 1e-9, 5e-9])
    for _ in range(outage + 1):
        speed[:2] += 1e-9
        filter.predict(speed, DT)
        filter.update(np.array([0.0, 1e-9, 0.0]), speed)  # as before: no new reading
    filter.predict(speed + 1e-9, DT)
    assert (filter.update(np.array([1e-7, 2e-7, 3e-7]), speed) == 0.0) == lost
    left = 1.0 - np.diag(filter.covariance)[:3] / (BALL * SIGMA) ** 2
    assert (np.abs(left) < 1e-9).all() == lost
    assert (left > -1e-9).all()


def test_a_run_of_rejections_ends_with_a_reinitialisation():
    """Two before an outage do not make the first outlier after it the third."""
    filter = resting()
    read(filter, 0.0, 1e-9, 0.0)
    for x in (0.01, 0.0101):
        assert read(filter, x, 0.0, 0.0) > EDGE
    speed = np.array([1e-9, 1e-9, 5e-9])
    for _ in range(13):
        speed[:2] += 1e-9
        filter.predict(speed, DT)
        filter.update(np.array([0.0101, 0.0, 0.0]), speed)
    assert read(filter, 1e-7, 2e-7, 3e-7) == 0.0  # reinitialised
    assert read(filter, 0.02, 0.0, 0.0) > EDGE
    assert np.abs(filter.mean[:3]).max() < 1e-5
