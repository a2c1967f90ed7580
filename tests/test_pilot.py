"""Pilot: the environment's own flight from its readings alone, and what it makes of readings that fail."""

import numpy as np
import pytest

from satid_gym import Pilot
from satid_gym.core import kernels
from satid_gym.fleet import Fleet
from satid_gym.policies import build, find, make_baseline
from satid_gym.policy import missions, observation_settings
from satid_gym.problem import problem
from tests.cases import cases
from tests.tolerances import ALL


class Flight:
    """An episode of the environment, and a second one from the same seed whose readings a pilot is given."""

    def __init__(self, satellite, policy, scenario, seed=5, control="torque"):
        self.policy = policy
        self.problem = problem(satellite, "static", scenario, control=control, **observation_settings(policy))
        self.fleets = [Fleet(self.problem, 1, log=True) for _ in range(2)]
        for fleet in self.fleets:
            fleet.rows.plants["stream"][0] = np.random.default_rng(seed).integers(1, 2**64, 4, dtype=np.uint64)
            fleet.begin()
        (mission,) = missions(self.problem)
        policy.reset(mission, [0])

    def decisions(self, count):
        """For each decision: torque on the motors at its end, readings of each of its samples, belief."""
        flown, read = self.fleets
        for _ in range(count):
            action = np.asarray(self.policy(flown.rows.observations.copy()), np.float32)
            flown.step(action)
            samples = []
            if self.problem.control == "rate":  # the second episode has no filter to follow a rate by
                samples = [(log["gyro"].copy(), log["tachometer"].copy()) for log in flown.rows.logs[0]]
            else:
                kernels.command(read.rows, read.work, action[0])
                for _ in range(self.problem.scenario.samples):
                    kernels.sample(read.rows, read.work)
                    plant = read.rows.plants[0]
                    gyro = None if plant["gyro_flagged"] else plant["gyro"].copy()
                    samples.append((gyro, plant["tachometer"].copy()))
            belief = flown.rows.beliefs[0]
            yield flown.work["torque"][0].copy(), samples, belief["mean"].copy(), belief["covariance"].copy()


def readings(plant):
    return plant["gyro"].copy(), plant["tachometer"].copy()


class BodyDamper:
    """Stops the body, as fast as what it observes in the body frame tells it."""

    name, kind, observation = "body_damper", "closed_loop", "body"

    def reset(self, mission, seeds):
        wheels = mission.satellite.wheels
        self.places, self.allocation = mission.layout, np.linalg.pinv(wheels.axes) / wheels.max_torque[:, None]

    def __call__(self, observation):
        part = {name: observation[:, place] for name, place in self.places.items()}
        haste = 0.02 * (1.0 + part["nis"] + part["fastest_wheel"][:, 1:] + part["modes"].sum(axis=1, keepdims=True))
        return np.clip(haste * (part["rate"] + 0.1 * part["wheel_momentum"]) @ self.allocation.T, -1.0, 1.0)


def rate_square(satellite):
    return build("rate_square", {"period": 36.0, "margin": 2.5})


@cases(
    ("name", "wheels", "scenario", "count", "control"),
    [
        ("generalist", 3, "default", 300, "torque"),
        ("generalist", 3, "faults", 120, "torque"),
        ("rate_square", 3, "default", 60, "torque"),
        ("mpc", 3, "default", 40, "torque"),
        ("multi_step", 3, "tight", 60, "torque"),
        ("rate_square", 4, "default", 60, "torque"),
        ("mpc", 4, "default", 20, "torque"),
        ("multi_step", 4, "default", 60, "torque"),
        ("body_damper", 4, "default", 20, "torque"),
        ("rate_square", 3, "paper", 40, "torque"),
        ("rate_square", 3, {"tolerances": ALL}, 40, "torque"),
        ("rate_square", 3, {"friction": {"coulomb": 5e-3}}, 60, "rate"),
        ("rate_square", 4, "default", 40, "rate"),
    ],
)
def test_it_commands_and_believes_what_the_environment_does(name, wheels, scenario, count, control, pyramid):
    satellite = "microsat" if wheels == 3 else pyramid
    settings = {"rate_square": {"period": 36.0, "margin": 2.5}, "mpc": {}, "multi_step": {"amplitude": 0.02}}
    own = {"generalist": lambda: find(name), "body_damper": BodyDamper}
    make = own.get(name, lambda: build(name, settings[name]))
    flight = Flight(satellite, make(), scenario, control=control)
    pilot = Pilot(satellite, make(), scenario=scenario, control=control, patience=1e3)
    world = flight.problem.scenario
    torque = pilot.start(0.0, *readings(flight.fleets[1].rows.plants[0]))
    limit, sample = pilot.mission.satellite.wheels.max_torque, 0
    for expected, samples, mean, covariance in flight.decisions(count):
        for gyro, speed in samples:
            sample, last = sample + 1, torque
            torque = pilot.step(sample * world.sample_period, gyro, speed)
        np.testing.assert_allclose(last, expected, rtol=0.0, atol=1e-9 * limit.max())
        found = pilot.estimate
        np.testing.assert_allclose(found.mean, mean, rtol=1e-9, atol=1e-12)
        scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
        assert np.abs(found.state_covariance - covariance).max() <= 1e-9 * scale.max()
    assert pilot.status.state == ("over" if count == world.decisions else "flying")
    assert found.nis > 0.0 or not found.accepted


def flown(pilot, flight, spoil, seconds=40):
    """Torque (N, n) that a pilot commands on a flight's readings, of which `spoil(k, time, gyro, speed)` makes others.

    The episode is the environment's own, so the torque does not reach it: what counts is what the pilot says.
    """
    torques = [pilot.start(0.0, *readings(flight.fleets[1].rows.plants[0]))]
    k = 0
    for _, samples, _, _ in flight.decisions(seconds):
        for gyro, speed in samples:
            k += 1
            for given in spoil(k, 0.1 * k, gyro, speed):
                torques.append(pilot.step(*given))
                assert np.isfinite(torques[-1]).all()
                assert (np.abs(torques[-1]) <= pilot.mission.satellite.wheels.max_torque).all()
    return np.array(torques)


def untouched(k, time, gyro, speed):
    return [(time, gyro, speed)]


def repeated(k, time, gyro, speed):
    return [(time, gyro, speed), (time, 2.0 * gyro, speed), (time - 0.05, gyro, speed)]


def leaping(k, time, gyro, speed):
    return [(time, gyro, speed), (time + 10.0 ** (k % 9 + 1), 2.0 * gyro, speed)]


@cases(("readings", "given", "counted"), [(repeated, 3, ("repeated", "late")), (leaping, 2, ("ahead",))])
def test_stamps_that_are_left_out_change_nothing(readings, given, counted):
    """Repeated and late ones, and single ones from far ahead."""
    one, two = Pilot("microsat", make_baseline("rate_square", "microsat")), Pilot("microsat", "rate_square")
    plain = flown(one, Flight("microsat", rate_square("microsat"), "default"), untouched)
    again = flown(two, Flight("microsat", rate_square("microsat"), "default"), readings)
    np.testing.assert_array_equal(plain[1:], again[1::given])
    np.testing.assert_array_equal(one.estimate.mean, two.estimate.mean)
    assert {kind for kind, count in two.status.counts.items() if count} == set(counted)
    assert all(two.status.counts[kind] == 400 for kind in counted)
    assert one.status.counts == dict.fromkeys(one.status.counts, 0)


def test_a_clock_that_stands_still_gives_no_torque():
    pilot = Pilot("microsat", "rate_square")
    assert pilot.start(0.0, np.zeros(3), np.zeros(3)).any()
    held = [pilot.step(0.0, np.zeros(3), np.zeros(3)) for _ in range(35)]
    assert all(torque.any() for torque in held[:30])
    assert not any(torque.any() for torque in held[30:])
    assert pilot.status.state == "coasting"
    assert "start again" in pilot.status.message
    for k in range(1, 12):
        torque = pilot.step(0.1 * k, np.zeros(3), np.zeros(3))
    assert torque.any(), "the next decision flies"


def test_a_second_stamp_from_far_ahead_ends_the_flight():
    for stamp in (1e6, 1e300):
        pilot = Pilot("microsat", "rate_square")
        held = pilot.start(0.0, np.zeros(3), np.zeros(3))
        believed = pilot.estimate.mean
        np.testing.assert_array_equal(pilot.step(stamp, np.zeros(3), np.zeros(3)), held)
        assert pilot.status.state == "flying"
        assert not pilot.step(np.nextafter(stamp + 1.0, np.inf), np.zeros(3), np.zeros(3)).any()
        assert pilot.status.state == "over"
        np.testing.assert_array_equal(pilot.estimate.mean, believed)


@cases(("patience", "every"), [(0.0, 0.1), (0.1, 0.1), (None, 4.0), (3.0, 7.0)])
def test_readings_that_come_rarely_or_with_little_patience_are_taken(patience, every):
    """All of them but the first that is late: a stamp further ahead than usual has to be confirmed once."""
    pilot = Pilot("microsat", "rate_square", patience=patience)
    pilot.start(0.0, np.zeros(3), np.zeros(3))
    for k in range(1, 30):
        pilot.step(k * every, np.zeros(3), np.zeros(3))
    assert pilot.estimate.time == pytest.approx(29 * every)
    assert pilot.status.counts["ahead"] == (1 if every > 1.0 else 0)


def error_over_std(pilot, flight):
    truth = np.diag(flight.fleets[0].rows.reports[0]["inertia_true"])
    return np.abs(pilot.estimate.theta - truth) / pilot.estimate.std


@cases("kind", ["jitter", "missing gyro", "missing wheels", "gap", "NaN"])
def test_irregular_and_missing_readings_leave_the_estimate_consistent(kind):
    """Error within 4 standard deviations of what the pilot claims, on the readings that came through."""
    rng = np.random.default_rng(3)

    def spoil(k, time, gyro, speed):
        if kind == "jitter":  # the reading is of the true instant; only its stamp is read late, by 20 us
            return [(time + 2e-5 * rng.random(), gyro, speed)]
        if kind == "gap" and 100 < k < 180:
            return []
        lost = rng.random() < 0.3
        nothing = np.full(3, np.nan)
        if kind == "missing gyro":
            return [(time, None if lost else gyro, speed)]
        if kind == "missing wheels":
            return [(time, gyro, None if lost else speed)]
        if kind == "NaN":
            return [(time, np.append(gyro[:2], np.nan) if lost else gyro, nothing if rng.random() < 0.1 else speed)]
        return [(time, gyro, speed)]

    pilot, flight = Pilot("microsat", "rate_square"), Flight("microsat", rate_square("microsat"), "default")
    flown(pilot, flight, spoil, 60)
    assert error_over_std(pilot, flight).max() < 4.0
    assert pilot.estimate.std.max() < 0.02
    expected = {"missing gyro": "missing", "missing wheels": "missing", "NaN": "refused", "gap": "missed"}
    assert kind == "jitter" or pilot.status.counts[expected[kind]] > 6


def test_without_sensors_it_coasts_and_says_so_and_goes_on_when_they_are_back():
    seen = {}

    def spoil(k, time, gyro, speed):
        blind, deaf = 100 < k <= 160, 200 < k <= 230
        seen[k - 1] = pilot.status.state, pilot.status.message
        return [(time, None if blind else gyro, None if deaf else speed)]

    pilot, flight = Pilot("microsat", "generalist"), Flight("microsat", find("generalist"), "default")
    torque = flown(pilot, flight, spoil)
    assert seen[129] == ("flying", "no gyro")  # for three seconds the filter is trusted
    assert torque[129].any()
    assert seen[140] == ("coasting", "no gyro; no gyro reading for 4 s")
    assert not torque[140].any()
    assert seen[160][0] == "coasting"
    assert seen[161] == ("flying", "")
    assert torque[161].any()
    assert seen[209] == ("flying", "no wheel speed")  # held until the decision's end
    assert torque[209].any()
    assert seen[210] == ("coasting", "no wheel speed; no torque: a decision is due and there are no wheel speeds")
    assert not torque[210:231].any()  # a decision that waits is taken with the first reading
    assert torque[231].any()
    assert pilot.status.counts["missed"] == 2 + 2


def test_a_wrong_unit_is_refused_in_one_line():
    pilot = Pilot("microsat")
    with pytest.raises(ValueError, match=r"^gyro reads 1 rad/s where the rate limit is 0.03: is it in deg/s\?$"):
        pilot.start(0.0, [1.0, 0.0, 0.0], np.zeros(3))
    with pytest.raises(ValueError, match=r"^wheel speed reads 5000 rad/s where the limit is 900: is it in rpm\?$"):
        pilot.start(0.0, np.zeros(3), [5000.0, 0.0, 0.0])
    with pytest.raises(RuntimeError, match=r"call start\(time, gyro, wheel_speed\) first"):
        pilot.step(0.0, np.zeros(3), np.zeros(3))
    pilot.start(0.0, np.zeros(3), np.zeros(3))
    pilot.step(0.1, [1.0, 0.0, 0.0], [5000.0, 0.0, 0.0])
    assert pilot.status.counts["refused"] == 2
    assert "deg/s" in pilot.status.message
    assert "rpm" in pilot.status.message
    with pytest.raises(ValueError, match=r"gyro must have shape \(3,\), got \(2,\)"):
        pilot.step(0.2, np.zeros(2), np.zeros(3))
    for use in (pilot.step, pilot.start):
        with pytest.raises(ValueError, match=r"^time must be finite, got nan: give the stamp of the readings"):
            use(np.nan, np.zeros(3), np.zeros(3))


class Mad:
    """A policy that commands no number after its third decision."""

    name, kind = "mad", "closed_loop"

    def reset(self, mission, seeds):
        self.left = 3

    def __call__(self, observation):
        self.left -= 1
        return np.full((1, 3), 0.1 if self.left >= 0 else np.nan)


def test_a_policy_without_a_number_gives_no_torque():
    pilot, flight = Pilot("microsat", Mad()), Flight("microsat", Mad(), {"horizon": 6.0})
    flight.policy = rate_square("microsat")
    flight.policy.reset(pilot.mission, [0])
    torque = flown(pilot, flight, untouched, 5)
    assert torque[:30].all()
    assert not torque[30:].any()
    assert pilot.status.state == "coasting"
    assert "policy mad gave no action" in pilot.status.message or not pilot.status.message


@cases("kind", ["tachometer", "gyro"])
def test_a_wrong_reading_that_is_possible_ruins_the_estimate_unless_the_filter_has_a_gate(kind):
    def spoil(k, time, gyro, speed):
        if k == 505:
            return [(time, gyro, 0.0 * speed)] if kind == "tachometer" else [(time, gyro + 0.1, speed)]
        return [(time, gyro, speed)]

    worst = np.zeros(2)
    for seed in (5, 6, 7):
        for i, estimator in enumerate((None, {"name": "adaptive", "gate": 1e-6})):
            pilot = Pilot("microsat", "rate_square", estimator=estimator)
            flight = Flight("microsat", rate_square("microsat"), "default", seed=seed)
            flown(pilot, flight, spoil, 100)
            truth = np.diag(flight.fleets[0].rows.reports[0]["inertia_true"])
            worst[i] += np.abs(pilot.estimate.theta / truth - 1.0).max() / 3.0
            seen = {name: count for name, count in pilot.status.counts.items() if count > 0}
            assert seen.keys() <= ({"rejected"} if estimator else set()), "it may be true"
    assert worst[0] > 0.01, "50 s later"
    assert worst[1] < 0.2 * worst[0]
