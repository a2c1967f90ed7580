"""Identification from recorded flights: truth, coverage, slips, and a clear no where there is nothing to tell."""

import dataclasses
import functools
import re

import numpy as np
import pytest

import satid_gym
from baselines.identification.coverage import KINDS, coverage, distances
from baselines.identification.recorded import CUBESAT, clean_log, drawn, motion, write_downlink
from satid_gym.estimators.inertia import inertia_parameters
from satid_gym.identification import NotIdentifiedError, SlipError, identify
from satid_gym.identification.bad_readings.saturation import without_saturated
from satid_gym.identification.bad_readings.spikes import without_spikes
from satid_gym.identification.record import lines, record
from satid_gym.identification.rotors import rotor_inertias
from satid_gym.identification.variation.steps_and_drift import Step, is_of_a_satellite
from satid_gym.telemetry import Log, read_log, read_logs
from satid_gym.telemetry.units import RPM
from tests.cases import cases


@functools.cache
def flight(seed=0, seconds=200.0, satellite="threeu"):
    """Truth and motion."""
    nominal = CUBESAT if satellite == "threeu" else satid_gym.SATELLITES[satellite]
    rng = np.random.default_rng([seed, 7])
    truth = drawn(nominal, rng)
    return truth, motion(truth, rng, seconds)


@functools.cache
def clean(seed=0, delay=0):
    truth, flown = flight(seed)
    return truth, clean_log(flown, CUBESAT, np.random.default_rng([seed, 8]), delay)


def downlink(folder, seed=0, flights=1, seconds=300.0):
    rng = np.random.default_rng([seed, 9])
    truth = drawn(CUBESAT, rng)
    for number in range(flights):
        write_downlink(folder / f"flight{number}", motion(truth, rng, seconds), truth, rng)
    return truth, read_logs(folder)


def test_the_truth_is_found_to_a_thousandth_and_within_the_claim():
    truth, log = clean()
    found = satid_gym.identify(log, CUBESAT)
    assert np.abs(distances(found, truth)[0]).max() < 3.5
    assert np.linalg.norm(found.inertia - truth.inertia) < 1e-3 * np.linalg.norm(truth.inertia)
    np.testing.assert_allclose(found.over_rotor * 5.7e-5, found.inertia)
    np.testing.assert_allclose(found.over_rotor_covariance * 5.7e-5**2, found.covariance)
    assert [p.name for p in found.parameters] == ["Jxx", "Jyy", "Jzz", "Jxy", "Jxz", "Jyz", "delay of wheel speeds"]
    assert [p.value for p in found.parameters[:6]] == inertia_parameters(found.inertia, "full").tolist()
    assert [p.std for p in found.parameters[:6]] == np.sqrt(np.diag(found.covariance)).tolist()
    assert found.flights[0].told.shape == (len(found.flights[0].time), 6)
    np.testing.assert_allclose(found.flights[0].told.sum(axis=0), 1.0)
    assert 0.05 < found.flights[0].predicted < 0.3  # a tachometer's noise of 0.1 rad/s, and the gyro's


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_the_claim_covers_the_truth_in_twelve_draws(kind):
    """Of 72 numbers, of which 0.68, 0.95 and 0.997 are nominal; standard errors 0.055, 0.026 and 0.007."""
    found = coverage(kind, 12)
    assert 0.5 < found.one < 0.9
    assert found.two > 0.87
    assert found.three > 0.975
    assert 0.3 < found.nees < 2.0


def test_slow_telemetry_in_whole_seconds_with_gaps_and_stale_rows(tmp_path):
    truth, logs = downlink(tmp_path, flights=2)
    found = identify(logs, CUBESAT)
    assert np.abs(distances(found, truth)[0]).max() < 3.5
    assert np.abs(np.diag(found.inertia) / np.diag(truth.inertia) - 1.0).max() < 0.01
    assert max(told.predicted for told in found.flights) < 0.7
    delay = found.parameters[6]
    assert delay.value == pytest.approx(0.2, abs=0.1)
    assert any("stamps of wheel speeds are" in note for note in found.notes)
    assert any("gaps" in note for note in found.notes)


def test_four_wheels_and_another_satellite(pyramid):
    nominal = pyramid.replace(rate_limit=0.05)
    rng = np.random.default_rng(4)
    truth = nominal.replace(inertia=1.1 * nominal.inertia)
    found = identify(clean_log(motion(truth, rng, 200.0), truth, rng), nominal)
    assert np.abs(distances(found, truth)[0]).max() < 3.5
    assert found.over_rotor[0, 0] == pytest.approx(found.inertia[0, 0] / 2e-3)


def changed(log, **roles):
    return dataclasses.replace(log, **{role: change(getattr(log, role)) for role, change in roles.items()})


def first(log, count):
    return changed(log, **dict.fromkeys(("time", "rate", "wheel_speed"), lambda values: values[:count]))


@cases(
    ("roles", "message"),
    [
        (
            {"wheel_speed": lambda v: v / RPM},
            "wheel speeds in rpm that were read as rad/s explains it: give --units wheel_speed=rpm",
        ),
        ({"wheel_speed": lambda v: v * RPM}, "wheel speeds in rad/s that were read as rpm explains it"),
        ({"rate": np.degrees}, "gyro rates in deg/s that were read as rad/s explains it: give --units rate=deg/s"),
        ({"rate": np.radians}, "gyro rates in rad/s that were read as deg/s explains it"),
        ({"rate": np.degrees, "wheel_speed": lambda v: v / RPM}, "deg/s and wheel speeds in rpm, both read as rad/s"),
        ({"wheel_speed": lambda v: v * [1.0, -1.0, 1.0]}, "wheel 2 with the opposite sign explains it"),
        ({"wheel_speed": lambda v: -v}, "all wheel speeds with the opposite sign explains it"),
        ({"rate": lambda v: v[:, [0, 2, 1]]}, "gyro axes in the order x, z, y explains it"),
        ({"wheel_speed": lambda v: v[:, [2, 1, 0]]}, "wheels in the order 3, 2, 1 explains it"),
    ],
)
def test_a_slip_is_named_in_one_line(roles, message):
    with pytest.raises(SlipError) as caught:
        identify(changed(first(clean()[1], 800), **roles), CUBESAT)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@cases(
    ("change", "message"),
    [
        (lambda log: changed(log, attitude=lambda q: np.roll(q, 1, axis=1)), "give --units 'attitude=scalar first' ("),
        (lambda log: changed(log, attitude=lambda q: q * [-1, -1, -1, 1]), "inertial to body"),
        (lambda log: changed(log, rate=np.degrees), "gyro rates in deg/s that were read as rad/s"),
        (lambda log: changed(log, rate=lambda v: v[:, [1, 0, 2]]), "gyro axes in the order y, x, z"),
        (lambda log: changed(log, rate=lambda v: v * [1, 1, -1]), "gyro axis z with the opposite sign"),
        (lambda log: changed(log, wheel_speed=lambda v: v * [1, 1, -1]), "row z of the wheels' axes with the opposite"),
        (lambda log: changed(log, wheel_speed=lambda v: -v), "give --units wheel_speed=-rpm"),
    ],
)
def test_a_slip_that_attitude_contradicts_is_named(change, message, tmp_path):
    _, (log,) = downlink(tmp_path)
    with pytest.raises(SlipError) as caught:
        identify(change(log), CUBESAT)
    assert message in str(caught.value)


def test_fifty_milliseconds_between_the_channels_are_found_and_taken_into_account():
    """Wheel speeds are stamped half a sample late: every second reading at 20 Hz is the gyro's."""
    truth, flown = flight(3)
    rng = np.random.default_rng(5)
    half = 0.5 * (flown.wheel_speed[1:] + flown.wheel_speed[:-1])  # 50 ms before each reading
    rate, speed = flown.omega[1:] + 1e-4 * rng.normal(size=half.shape), half + 0.1 * rng.normal(size=half.shape)
    found = identify(Log(time=flown.time[1:], rate=rate, wheel_speed=speed), CUBESAT)
    assert found.parameters[6].value == pytest.approx(0.05, abs=0.005)
    assert any(note.startswith("stamps of wheel speeds are 0.05") and "late" in note for note in found.notes)
    assert np.abs(distances(found, truth)[0]).max() < 3.5


def test_a_gap_and_repeated_stamps_do_no_harm_and_are_said(tmp_path):
    truth, log = clean(1)
    rows = np.column_stack([log.time, log.rate, log.wheel_speed])
    rows = np.concatenate([rows[:700], rows[780:1200], rows[1195:]])
    path = tmp_path / "a.csv"
    np.savetxt(path, rows, delimiter=",", header="t,gx,gy,gz,w1,w2,w3", comments="", fmt="%.17g")
    found = identify(read_log(path), CUBESAT)
    assert np.abs(distances(found, truth)[0]).max() < 3.5
    assert any("1 gaps, the longest of 8.1 s" in note for note in found.notes)
    assert any("5 rows repeat a stamp" in note for note in found.notes)


def test_tachometer_faults_are_left_out_and_named():
    truth, log = clean(2)
    speed = log.wheel_speed.copy()
    speed[[500, 900]] += [0.0, 0.0, 25.0]
    found = identify(dataclasses.replace(log, wheel_speed=speed), CUBESAT)
    assert np.abs(distances(found, truth)[0]).max() < 3.5
    faults = found.flights[0].faults
    assert [(round(fault.time, 6), fault.wheel) for fault in faults] == [(50.0, 3), (90.0, 3)]
    assert [fault.excess for fault in faults] == pytest.approx([25.0, 25.0], abs=1.0)
    (note,) = [note for note in found.notes if "at 50 s" in note]
    assert note.startswith("log: wheel 3 reads +2")
    assert "tachometer fault" in note


def test_the_same_flight_twice_is_refused():
    _, log = clean()
    with pytest.raises(ValueError, match="hold the same readings: give each flight once"):
        identify([log, dataclasses.replace(log, name="copy")], CUBESAT)


def test_spikes_are_left_out_before_the_fit_and_said():
    """A tachometer's 1e4 rad/s for what was lost, on up to three rows, and a gyro's spikes."""
    truth, log = clean(2)
    rng = np.random.default_rng(0)
    rate, speed = log.rate.copy(), log.wheel_speed.copy()
    rows = rng.choice(np.arange(100, 1900, 10), 40, replace=False)
    speed[rows[:20], rng.integers(0, 3, 20)] = 1e4
    speed[1950:1953, 1] = -1e4
    rate[rows[20:], rng.integers(0, 3, 20)] += 0.3
    rate[50], speed[50] = 10.0, 1e4  # a row that is lost altogether
    found = identify(dataclasses.replace(log, rate=rate, wheel_speed=speed), CUBESAT)
    assert np.abs(distances(found, truth)[0]).max() < 3.5
    assert "log: 23 spikes of the gyro left out, the largest of 10 rad/s" in found.notes
    assert len(found.flights[0].faults) == 26
    assert {fault.wheel for fault in found.flights[0].faults} == {1, 2, 3}
    assert sum("tachometer faults or stale readings, left out" in note for note in found.notes) == 3


def test_a_motion_of_one_reading_is_no_spike():
    """A jerk between two readings shows in gyro and wheels; in the gyro alone no motor of the satellite made it."""
    time = 0.1 * np.arange(2000)
    rate, speed = np.zeros((2000, 3)), np.zeros((2000, 3))
    rate[:, 0], speed[:, 0] = 0.02 * np.sin(time), -15.0 * np.sin(time)
    rate[1000, 0], speed[1000, 0] = 0.1, -75.0
    jerk = Log(time=time, rate=rate, wheel_speed=speed)
    assert without_spikes([jerk], CUBESAT) == ([jerk], [])
    speed[1000, 0] = 15.0
    (cleaned,), faults = without_spikes([Log(time=time, rate=rate, wheel_speed=speed)], CUBESAT)
    assert cleaned.notes == ("1 spikes of the gyro left out, the largest of 0.1 rad/s",)
    assert np.isnan(cleaned.rate).sum() == 1
    assert faults == []


def test_a_gyro_at_the_end_of_its_range_is_named_and_its_readings_are_left_out(tmp_path):
    truth, log = clean()
    end = 0.6 * np.abs(log.rate).max(axis=0)
    found = identify(dataclasses.replace(log, rate=np.clip(log.rate, -end, end)), CUBESAT)
    assert np.abs(distances(found, truth)[0]).max() < 3.5
    wider = np.sqrt(np.diag(found.covariance) / np.diag(identify(log, CUBESAT).covariance))
    print(f"the intervals are {wider.min():.1f} to {wider.max():.1f} times as wide as with the whole log")
    assert wider.max() < 4.0
    named = [note for note in found.notes if "at the end of its range" in note]
    assert len(named) == 3
    assert not any("wheel" in note for note in found.notes)
    for axis, limit, note in zip("xyz", end, named, strict=True):
        left_out = rf"\d+ readings of gyro {axis} left out: they are at the end of its range, {limit:.3g} rad/s"
        assert re.search(left_out, note)
    table = np.column_stack([log.time, np.clip(log.rate, -end, end), log.wheel_speed])
    header = "time,rate_x,rate_y,rate_z,wheel_1,wheel_2,wheel_3"
    np.savetxt(tmp_path / "flight.csv", table, "%.9g", ",", header=header, comments="")
    read = read_log(tmp_path / "flight.csv")  # which takes none of these readings for a stuck sensor
    assert np.isfinite(read.rate).all()
    assert [note for note in identify(read, CUBESAT).notes if "range" in note] == [
        note.replace("log:", "flight.csv:") for note in named
    ]
    with pytest.raises(NotIdentifiedError, match=r"turn more; log: \d+ readings of gyro x left out: they are at the"):
        identify(dataclasses.replace(log, rate=np.clip(log.rate, -end / 6.0, end / 6.0)), CUBESAT)


def test_a_range_of_the_data_sheet_is_taken_as_it_is_and_a_gyro_with_coarse_steps_is_let_be():
    _, log = clean()
    ranged = CUBESAT.replace(sensors={"gyro_range": 0.5})
    fast = dataclasses.replace(log, rate=log.rate.copy())
    fast.rate[[5, 70], 1] = 0.5, -0.5
    (cleaned,) = without_saturated([fast], ranged)
    np.testing.assert_array_equal(np.argwhere(np.isnan(cleaned.rate)), [[5, 1], [70, 1]])
    assert cleaned.notes == ("2 readings of gyro y left out: they are at the end of its range, 0.5 rad/s",)
    degrees = dataclasses.replace(log, rate=np.degrees(log.rate))
    for other in (log, degrees):  # a slip of the unit is left for the checks to name
        assert without_saturated([other], ranged) == [other]
    steps = np.abs(log.rate).max(axis=0) / 6.0
    coarse = dataclasses.replace(log, rate=steps * np.round(log.rate / steps))
    resting = dataclasses.replace(log, rate=np.minimum(log.rate, 0.0))
    still = dataclasses.replace(log, rate=np.full_like(log.rate, 0.1))
    for other in (coarse, resting, still):
        assert without_saturated([other], CUBESAT) == [other]


def test_torque_from_outside_that_is_known_is_taken_into_account():
    """Magnetorquers a hundred times the data sheet's disturbance, turned on and off."""
    truth, rng = CUBESAT.replace(inertia=[0.05, 0.04, 0.011]), np.random.default_rng(2)
    pushed = 1e-4 * np.sign(np.sin(np.arange(1000)[:, None] / [31.0, 47.0, 71.0]))
    torque = 3e-4 * np.repeat(rng.choice([-1.0, 1.0], (20, 3)), 50, axis=0)
    flown, parts, state = satid_gym.simulate(truth, torque[:1], 0.1, disturbance=pushed[0]), [], {}
    parts.append((flown.omega[0], flown.wheel_speed[0]))
    for k in range(1000):
        flown = satid_gym.simulate(truth, torque[k : k + 1], 0.1, disturbance=pushed[k], **state)
        state = {"omega0": flown.omega[-1], "wheel_speed0": flown.wheel_speed[-1], "attitude0": flown.attitude[-1]}
        parts.append((flown.omega[-1], flown.wheel_speed[-1]))
    rate, speed = (np.array(part) for part in zip(*parts, strict=True))
    held = (np.arange(1001) + 0.5).clip(0, 999).astype(int)
    log = Log(
        time=0.1 * np.arange(1001),
        rate=rate + 1e-4 * rng.normal(size=rate.shape),
        wheel_speed=speed + 0.1 * rng.normal(size=speed.shape),
        torque=0.5 * (pushed[held] + pushed[np.maximum(held - 1, 0)]),
        motor_torque=torque[held],
    )
    found = identify(log, CUBESAT)
    assert np.abs(distances(found, truth)[0]).max() < 3.5
    blind = identify(dataclasses.replace(log, torque=None), CUBESAT)
    assert found.flights[0].predicted < 0.3 * blind.flights[0].predicted
    rotors = [p for p in found.parameters if p.name.startswith("rotor inertia of wheel")]
    assert [p.value for p in rotors] == pytest.approx([5.7e-5] * 3, rel=0.02)
    assert not any("by its motor's torque" in note for note in found.notes)
    assert sum(line.startswith("rotor inertia of wheel") for line in lines(found)) == 3
    other = CUBESAT.replace(wheels=CUBESAT.wheels.replace(inertia=5e-5))
    notes = identify(log, other).notes
    assert any(
        note.startswith("rotor inertia of wheel 2 is 5.") and "5e-05 in the data sheet" in note for note in notes
    )
    with pytest.raises(SlipError, match="motor_torque=-Nm"):
        identify(dataclasses.replace(log, motor_torque=-torque[held]), CUBESAT)


def tolerant(seed):
    """Distances of an estimate from the truth, by its claim with the data sheet's tolerances, and by that without."""
    sheet = CUBESAT.replace(tolerances={"gyro_scale": 2e-3, "gyro_alignment": 3e-3, "wheel_alignment": 5e-3})
    rng = np.random.default_rng([seed, 10])
    truth, log = clean(seed)
    gain = np.eye(3) + np.where(np.eye(3) > 0.0, 2e-3, 3e-3) * rng.normal(size=(3, 3))
    axes = CUBESAT.wheels.axes + 5e-3 * rng.normal(size=(3, 3)) * (1.0 - np.eye(3))
    axes /= np.linalg.norm(axes, axis=0)  # as built, with which the log is consistent
    built = np.linalg.solve(axes, CUBESAT.wheels.axes)  # speeds of wheels along these axes, for the same momentum
    off = changed(log, rate=lambda values: values @ gain.T, wheel_speed=lambda values: values @ built.T)
    return (distances(identify(off, own), truth)[0] for own in (sheet, CUBESAT))


def test_tolerances_of_gyro_and_wheels_are_in_the_claim():
    """Errors drawn from them; without them the claim of the same logs is several times too small."""
    within, without = (np.sqrt(np.mean(np.square(all_of))) for all_of in zip(*map(tolerant, range(2)), strict=True))
    assert 0.3 < within < 1.6
    assert without > 3.0


def test_the_claim_without_tolerances_of_alignment_is_as_it_was():
    _, log = clean()
    rotors = CUBESAT.replace(tolerances={"wheel_inertia": 0.01})
    np.testing.assert_array_equal(
        identify(log, rotors).over_rotor_covariance, identify(log, CUBESAT).over_rotor_covariance
    )


def test_what_the_data_sheet_says_and_the_fit_lacks_is_said():
    mass = {"mass": 0.2, "direction": [1, 0, 0], "position": [0, 0, 0.1], "frequency": 0.1, "damping": 0.05}
    own = CUBESAT.replace(oscillators=[satid_gym.SloshMass(**mass)], tolerances={"gyro_bias": 1e-5})
    notes = identify(clean()[1], own).notes
    assert any(note.startswith("oscillator 1: taken as the data sheet has it, exactly") for note in notes)
    assert any("times the data sheet's tolerance" in note for note in notes)


def test_viscous_friction_does_not_enter_the_inertia_of_a_rotor():
    """Torque that is held for 0.1 s, and a speed that friction slows in between: both in closed form."""
    inertia, viscous, dt = 5.7e-5, 3e-6, 0.1
    torque = 3e-4 * np.repeat(np.random.default_rng(3).choice([-1.0, 1.0], 40), 50)
    speed, fall = np.zeros(len(torque)), np.exp(-viscous * dt / inertia)
    for k in range(len(torque) - 1):
        speed[k + 1] = fall * speed[k] + (1.0 - fall) * torque[k] / viscous
    three = np.repeat(speed[:, None], 3, axis=1)
    time = dt * np.arange(len(torque))
    log = Log(
        time=time, rate=np.zeros_like(three), wheel_speed=three, motor_torque=np.repeat(torque[:, None], 3, axis=1)
    )
    for found in rotor_inertias([log], CUBESAT, 40.0):
        assert found.value == pytest.approx(inertia, rel=1e-4)


def test_rotors_a_hundred_times_too_heavy_are_asked_about():
    own = CUBESAT.replace(wheels=CUBESAT.wheels.replace(inertia=5.7e-3))
    notes = identify(clean()[1], own).notes
    assert any(
        "times nominal" in note and "its rotors' inertia, with which the result scales" in note for note in notes
    )


def test_a_wrong_number_of_wheels_is_refused(pyramid):
    with pytest.raises(ValueError, match="log has 3 wheel speeds where satellite pyramid has 4 wheels"):
        identify(clean()[1], pyramid)


def test_a_log_that_tells_nothing_gives_a_no():
    rng = np.random.default_rng(0)
    rate, speed = 1e-4 * rng.normal(size=(2000, 3)), rng.normal(size=(2000, 3))
    still = Log(time=0.1 * np.arange(2000), rate=rate, wheel_speed=speed)
    with pytest.raises(NotIdentifiedError, match=r"rate changes by .* nothing moves"):
        identify(still, CUBESAT)
    _, log = clean()
    with pytest.raises(NotIdentifiedError, match=r"nothing to identify from|no stretch"):
        identify(Log(time=log.time[:5], rate=log.rate[:5], wheel_speed=log.wheel_speed[:5]), CUBESAT)


def about_x(truth):
    torque = np.zeros((2000, 3))
    torque[:, 0] = 3e-4 * np.sign(np.sin(2.0 * np.pi * np.arange(2000) / 400.0 + 1.57))
    return satid_gym.simulate(truth, torque, 0.1)


def test_motion_about_one_axis_tells_its_moment_and_no_other():
    rng = np.random.default_rng(1)
    truth = CUBESAT.replace(inertia=[0.04, 0.05, 0.012])
    flown = about_x(truth)
    found = identify(clean_log(flown, CUBESAT, rng), CUBESAT)
    assert found.inertia[0, 0] == pytest.approx(0.04, rel=0.01)
    assert np.isnan(found.inertia[[1, 2], [1, 2]]).all()
    assert np.isnan(found.covariance[1]).all()
    assert found.notes[0].startswith("the data do not identify Jyy, Jzz")


def test_axes_that_read_exactly_zero_tell_nothing():
    """Coarse telemetry of a turn about one axis: it tells that axis's moment, and that its products are small."""
    truth = CUBESAT.replace(inertia=[0.04, 0.05, 0.012])
    flown = about_x(truth)
    log = Log(time=flown.time, rate=flown.omega.round(4), wheel_speed=flown.wheel_speed.round(1))
    assert not log.rate[:, 1:].any()
    found = identify(log, CUBESAT)
    assert abs(found.inertia[0, 0] - 0.04) < 4.0 * found.parameters[0].std
    assert [parameter.determined for parameter in found.parameters[:6]] == [True, False, False, True, True, False]


def test_one_window_alone_is_said_and_a_delay_that_was_not_estimated_is_no_zero():
    found = identify(first(clean()[1], 350), CUBESAT)
    assert any(note.startswith("only one window: the interval is that of") for note in found.notes)
    assert np.isfinite(found.flights[0].delays).tolist() == [True, False]
    assert record(found)["flights"][0]["delays_s"][1] is None


def test_readings_that_are_not_there():
    """A channel that is all NaN is a no; an attitude that is hardly there is left out; an infinity is no reading."""
    truth, log = clean()
    with pytest.raises(NotIdentifiedError, match="readings are missing"):
        identify(changed(log, rate=lambda values: np.nan * values), CUBESAT)
    plain = identify(log, CUBESAT)
    without = identify(dataclasses.replace(log, attitude=np.full((len(log), 4), np.nan)), CUBESAT)
    np.testing.assert_array_equal(without.inertia, plain.inertia)
    assert "log: attitude is there in 0% of the rows and is left out" in without.notes
    rate = log.rate.copy()
    rate[7, 0] = np.inf
    assert np.abs(distances(identify(dataclasses.replace(log, rate=rate), CUBESAT), truth)[0]).max() < 3.5


def test_a_nominal_inertia_twice_off_changes_nothing_and_one_five_times_off_is_asked_about():
    _, log = clean()
    twice = identify(log, CUBESAT.replace(inertia=2.0 * CUBESAT.inertia))
    np.testing.assert_allclose(twice.inertia, identify(log, CUBESAT).inertia, atol=1e-6)
    with pytest.raises(SlipError, match="or is nominal so far off"):
        identify(log, CUBESAT.replace(inertia=5.0 * CUBESAT.inertia))


@functools.cache
def varied(size):
    """Variation of a flight whose inertia steps by a share at 60.05 s, and the truth."""
    rng = np.random.default_rng(3)
    truth = drawn(CUBESAT, rng)
    law = satid_gym.InertiaLaw("step", size=size, time=60.0) if size else None
    flown = motion(truth, rng, 120.0, law=law)
    return identify(clean_log(flown, CUBESAT, rng), CUBESAT, varying=True), flown


def test_a_constant_inertia_is_said_to_be_constant():
    found, _ = varied(0.0)
    assert found.variation.kind == "constant"
    assert found.variation.p > 0.01
    assert not found.variation.steps
    assert 0.0 < found.variation.detectable < 0.05
    np.testing.assert_allclose(found.variation.covariance[0], found.covariance)


def test_a_step_is_found_with_its_instant_and_both_inertias():
    found, flown = varied(0.1)
    (step,) = found.variation.steps
    assert found.variation.kind == "steps"
    assert found.variation.p < 0.01
    assert abs(step.time - 60.05) < max(3.5 * step.time_std, 0.1)
    change = inertia_parameters(flown.inertia[-1], "full") - inertia_parameters(flown.inertia[0], "full")
    assert np.abs((step.change - change) / step.change_std).max() < 4.0
    assert record(found)["variation"]["steps"][0]["time_s"] == step.time


def test_what_was_not_asked_for_is_not_there():
    found = identify(first(clean()[1], 1500), CUBESAT)
    assert found.variation is None
    assert "variation" not in record(found)


def test_a_step_that_no_satellite_makes_is_not_given():
    """A moment that changes fourfold is taken for a failure of the balance, and so is a step that is told in part."""
    whole = np.array([6.0, 5.0, 4.0, 0.1, 0.0, 0.1])
    told, known = np.diag(np.full(6, 1e-6)), np.full(6, 1e-3)

    def step(before, change_std=known):
        change = whole - before
        return Step(
            flight=0,
            time=1.0,
            time_std=0.1,
            jumped=False,
            before=before,
            after=whole,
            change=change,
            change_std=change_std,
        )

    assert is_of_a_satellite(step(0.8 * whole), whole, told)
    assert not is_of_a_satellite(step(0.0 * whole), whole, told)
    assert not is_of_a_satellite(step(5.0 * whole), whole, told)
    half = np.where(np.arange(6) == 0, np.nan, known)
    assert not is_of_a_satellite(step(0.8 * whole, half), whole, told)
    untold = told.copy()
    untold[0, 0] = np.nan
    assert is_of_a_satellite(step(0.8 * whole, half), whole, untold)
