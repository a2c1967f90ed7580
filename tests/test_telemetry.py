"""Telemetry: files of many habits read into one log."""

import re
import sys
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from satid_gym.telemetry import Log, read_log, read_logs
from satid_gym.telemetry.units import factor, split_header
from tests.cases import cases

RNG = np.random.default_rng(0)
TIME = 100.0 + np.arange(20.0)
RATE, SPEED, QUATERNION = RNG.normal(size=(20, 3)), RNG.normal(size=(20, 3)), RNG.normal(size=(20, 4))
QUATERNION /= np.linalg.norm(QUATERNION, axis=1, keepdims=True)
ROUND = np.column_stack([TIME, RATE, SPEED])


def write(path, head, rows, delimiter=",", comma=False):
    lines = [delimiter.join(head)]
    for row in rows:
        cells = [cell if isinstance(cell, str) else repr(float(cell)) for cell in row]
        lines.append(delimiter.join(cell.replace(".", ",") if comma else cell for cell in cells))
    path.write_text("\n".join(lines) + "\n")
    return path


@cases(
    ("head", "scale"),
    [
        (["t", "gx", "gy", "gz", "w1", "w2", "w3"], (1.0, 1.0)),
        (["timestamp", "gyro_x", "gyro_y", "gyro_z", "wheel_speed_0", "wheel_speed_1", "wheel_speed_2"], (1.0, 1.0)),
        (["time [s]", "gx [deg/s]", "gy [deg/s]", "gz [deg/s]", "rw1 (rpm)", "rw2 (rpm)", "rw3 (rpm)"], (57.3, 9.55)),
        (["unix_s", "rate_x_dps", "rate_y_dps", "rate_z_dps", "rwX_rpm", "rwY_rpm", "rwZ_rpm"], (57.3, 9.55)),
        (["Time", "omegaX", "omegaY", "omegaZ", "RW.1", "RW.2", "RW.3"], (1.0, 1.0)),
        (["t", "w_x", "w_y", "w_z", "wheel[0]", "wheel[1]", "wheel[2]"], (1.0, 1.0)),
        (
            ["time [s]", "gx [dps]", "gy [dps]", "gz [dps]", "RW1_SPEED_RPM", "RW2_SPEED_RPM", "RW3_SPEED_RPM"],
            (57.3, 9.55),
        ),
        (
            ["time [s]", *(f"gyro_dps[{k}]" for k in range(3)), *(f"wheel{k}_speed [rpm]" for k in (1, 2, 3))],
            (57.3, 9.55),
        ),
    ],
)
def test_common_names_and_units_are_found(head, scale, tmp_path):
    rate, wheel = np.degrees(1.0) if scale[0] > 1 else 1.0, 30.0 / np.pi if scale[1] > 1 else 1.0
    log = read_log(write(tmp_path / "a.csv", head, np.column_stack([TIME, rate * RATE, wheel * SPEED])))
    np.testing.assert_allclose(log.time, TIME)
    np.testing.assert_allclose(log.rate, RATE, rtol=1e-12)
    np.testing.assert_allclose(log.wheel_speed, SPEED, rtol=1e-12)
    assert log.attitude is None
    assert any("deg/s" in note for note in log.notes) == (scale[0] > 1)
    assert any("because the files give no unit" in note for note in log.notes) == (scale == (1.0, 1.0))


def test_columns_and_units_by_mapping(tmp_path):
    head = ["a", "clock", "c", "d", "e", "f", "g", "h", "q4", "q1", "q2", "q3"]
    first = np.roll(QUATERNION, 1, axis=1)
    table = np.column_stack([TIME, 1e3 * TIME, np.degrees(RATE), -30.0 / np.pi * SPEED, first])
    columns = {"time": "clock", "rate": ["c", "d", "e"], "wheel_speed": ["f", "g", "h"]}
    columns["attitude"] = ["q4", "q1", "q2", "q3"]
    units = {"time": "ms", "rate": "deg/s", "wheel_speed": "-rpm", "attitude": "scalar first"}
    log = read_log([write(tmp_path / "a.csv", head, table)], columns, units)
    for found, expected in ((log.time, TIME), (log.rate, RATE), (log.wheel_speed, SPEED), (log.attitude, QUATERNION)):
        np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_the_order_of_a_quaternion_is_taken_from_its_names(tmp_path):
    head = ["t", "gx", "gy", "gz", "w1", "w2", "w3"]
    for names, table in (
        (["q0", "q1", "q2", "q3"], np.roll(QUATERNION, 1, axis=1)),
        (["q1", "q2", "q3", "q4"], QUATERNION),
        (["qx", "qy", "qz", "qw"], QUATERNION),
        (["q_w", "q_x", "q_y", "q_z"], np.roll(QUATERNION, 1, axis=1)),
    ):
        log = read_log(write(tmp_path / "a.csv", head + names, np.column_stack([ROUND, table])))
        np.testing.assert_allclose(log.attitude, QUATERNION, rtol=1e-12, err_msg=str(names))


def test_files_of_one_flight_with_units_in_cells_and_roles_in_file_names(tmp_path):
    """As a Grafana dashboard exports them: dates, byte order mark, quoted heads; the commands are not wheel speeds."""
    start = datetime(2025, 12, 15, 21, 50, 8, tzinfo=UTC)
    stamps = [(start + timedelta(seconds=2 * k)).strftime("%Y-%m-%d %H:%M:%S") for k in range(20)]
    folder = tmp_path / "flights" / "one"
    folder.mkdir(parents=True)
    for stem, values, unit in (
        ("Rates-data", np.degrees(RATE), " °/s"),
        ("RW Speeds-data", 30.0 / np.pi * SPEED, " rpm"),
        ("RW CMDs-data", SPEED, " RPM/s"),
    ):
        rows = [
            [stamp, *(f"{value!r}{unit}" for value in row.tolist())] for stamp, row in zip(stamps, values, strict=True)
        ]
        path = write(folder / f"{stem}.csv", ['"Time"', '"X"', '"Y"', '"Z"'], rows)
        path.write_text(path.read_text(), encoding="utf-8-sig")
    rows = [[stamp, *row] for stamp, row in zip(stamps, np.roll(QUATERNION, 1, axis=1).tolist(), strict=True)]
    write(folder / "Attitude quaternion.csv", ["Time", "q0", "q1", "q2", "q3"], rows)
    (log,) = read_logs(tmp_path)
    np.testing.assert_allclose(log.time, start.timestamp() + 2.0 * np.arange(20))
    for found, expected in ((log.rate, RATE), (log.wheel_speed, SPEED), (log.attitude, QUATERNION)):
        np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert log.name == "one"


def test_what_is_assumed_of_time_is_said_once_and_other_quantities_are_passed_over(tmp_path):
    head = ["t", "gx", "gy", "gz", "w1", "w2", "w3", "wheel_momentum_1", "gyro_status_1", "gyro_angle_x"]
    table = np.column_stack([ROUND, RATE])
    log = read_log(write(tmp_path / "a.csv", head, table))
    np.testing.assert_array_equal(log.wheel_speed, SPEED)
    assert log.notes.count("time taken as s, because the files give no unit") == 1
    named = {"rate": ["gx", "gy", "gz"], "wheel_speed": ["w1", "w2", "w3"]}
    twice = write(tmp_path / "b.csv", [*head, "utc"], np.column_stack([table, TIME + 1.0]))
    with pytest.raises(ValueError, match="both 't' and 'utc' may be time"):
        read_log(twice, named)
    np.testing.assert_array_equal(read_log(twice, {"time": "utc", **named}).time, TIME + 1.0)
    dates = [[datetime.fromtimestamp(row[0], UTC).isoformat(), *row[1:]] for row in table]
    assert "time taken as s, as files say" in read_log(write(tmp_path / "c.csv", head, dates)).notes


def test_semicolons_and_decimal_commas(tmp_path):
    head = ["t", "gx", "gy", "gz", "w1", "w2", "w3"]
    log = read_log(write(tmp_path / "a.csv", head, ROUND, delimiter=";", comma=True))
    np.testing.assert_array_equal(log.wheel_speed, SPEED)


def test_gaps_lost_cells_and_repeated_stamps_are_kept_apart_and_said(tmp_path):
    table = [list(row) for row in ROUND[[0, 1, 2, 2, 3, 4, 5, 6, 7, 17, 16, 18, 19]]]
    table[1][2], table[4][5], table[5][0] = "NaN", "", "not a time"
    table[10][1:] = table[9][1:] = table[11][1:]  # sorted by time: 16, 17, 18
    head = ["t", "gx", "gy", "gz", "w1", "w2", "w3"]
    log = read_log(write(tmp_path / "a.csv", head, table))
    expected = [0, 1, 2, 3, 5, 6, 7, 16, 19]
    np.testing.assert_array_equal(log.time, TIME[expected])
    lost = np.isnan(np.hstack([log.rate, log.wheel_speed]))
    assert np.argwhere(lost).tolist() == [[1, 1], [3, 4]]
    assert log.gaps == [(107.0, 9.0), (116.0, 3.0)]
    for note in (
        "1 rows without a stamp left out",
        "stamps went back 1 times; rows sorted by time",
        "1 rows repeat a stamp and are left out",
        "2 rows repeat the readings of the row before and are left out",
        "2 of 9 rows have cells without a number",
        "2 gaps, the longest of 9 s",
    ):
        assert note in log.notes


def test_a_sensor_that_is_stuck_is_left_out_there_and_one_that_is_coarse_is_not(tmp_path):
    rng, time = np.random.default_rng(1), np.arange(200.0)
    rate, speed = rng.normal(size=(200, 3)), rng.normal(size=(200, 3))
    speed[80:140, 2] = speed[80, 2]
    head = ["t", "gx", "gy", "gz", "w1", "w2", "w3"]
    log = read_log(write(tmp_path / "stuck.csv", head, np.column_stack([time, rate, speed])))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(log.wheel_speed[:, 2])), np.arange(80, 140))
    assert np.isfinite(log.wheel_speed[:, :2]).all()
    assert any("column 3 of wheel_speed repeats" in note and "for 59 s, from row 81 on" in note for note in log.notes)
    speed[80:140] = 0.0  # wheels at rest
    log = read_log(write(tmp_path / "rest.csv", head, np.column_stack([time, rate, speed])))
    assert np.isfinite(log.wheel_speed).all()
    speed = rng.normal(size=(200, 3))
    speed[:, 2] = 7.0
    log = read_log(write(tmp_path / "always.csv", head, np.column_stack([time, rate, speed])))
    assert np.isfinite(log.wheel_speed).all()
    assert any("the whole flight: is that sensor stuck?" in note for note in log.notes)
    coarse = np.repeat(rng.normal(size=(40, 3)), 5, axis=0)
    coarse[80:140] = coarse[80]
    log = read_log(write(tmp_path / "coarse.csv", head, np.column_stack([time, rate, coarse])))
    assert np.isfinite(log.wheel_speed).all()


def test_channels_with_stamps_of_their_own_are_brought_to_the_gyros_and_not_across_gaps(tmp_path):
    """Rates at 10 Hz; wheel speeds at 4 Hz, linear in time, that pause for 3 s."""
    fast, slow = np.arange(0.0, 10.0, 0.1), np.arange(0.05, 10.0, 0.25)
    slow = slow[(slow < 4.0) | (slow > 7.0)]
    gyro = np.column_stack([fast, RNG.normal(size=(100, 3))])
    wheels = np.column_stack([slow, slow, -2.0 * slow, 3.0 + slow])
    files = [
        write(tmp_path / "imu.csv", ["t", "gx", "gy", "gz"], gyro),
        write(tmp_path / "wheels.csv", ["t", "rw1", "rw2", "rw3"], wheels),
    ]
    log = read_log(files)
    there = np.isfinite(log.wheel_speed[:, 0])
    assert not there[(log.time > 4.0) & (log.time < 7.0)].any()
    assert there[(log.time > 0.1) & (log.time < 3.5)].all()
    np.testing.assert_allclose(log.wheel_speed[there, 1], -2.0 * log.time[there], atol=1e-12)


def test_parquet(tmp_path):
    arrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    head = ["time", "gx [deg/s]", "gy [deg/s]", "gz [deg/s]", "rw1_rpm", "rw2_rpm", "rw3_rpm"]
    stamps = arrow.array((1e9 * TIME).astype("datetime64[ns]"))
    columns = np.column_stack([np.degrees(RATE), 30.0 / np.pi * SPEED]).T
    path = tmp_path / "a.parquet"
    parquet.write_table(arrow.table([stamps, *map(arrow.array, columns)], names=head), path)
    log = read_log(path)
    for found, expected in ((log.time, TIME), (log.rate, RATE), (log.wheel_speed, SPEED)):
        np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_parquet_without_its_library_is_said(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    (tmp_path / "a.parquet").write_bytes(b"PAR1")
    with pytest.raises(ValueError, match=r'to read Parquet, pip install "\.\[telemetry\]" in the checkout'):
        read_log(tmp_path / "a.parquet")


GOOD = ["t", "gx", "gy", "gz", "w1", "w2", "w3"]


@cases(
    ("head", "arguments", "message"),
    [
        (
            ["t", "a", "b", "c", "w1", "w2", "w3"],
            {},
            "found no columns for rate among a.csv: t, a, b, c, w1, w2, w3; say which",
        ),
        (["k", "gx", "gy", "gz", "w1", "w2", "w3"], {}, "found no columns for time among a.csv: k, gx"),
        (["t", "gx", "gy", "rate_x", "w1", "w2", "w3"], {}, "both 'gx' and 'rate_x' may be rate x"),
        (["t", "gx", "gy", "gz", "w1", "w2", "w3", "utc"], {}, "both 't' and 'utc' may be time; the files hold a.csv"),
        (
            ["k", "gx", "gy", "gz", "w1", "w2", "w3"],
            {},
            "say which: --columns time=unix_s rate=gx,gy,gz wheel_speed=w1,w2,w3 (Python: columns={",
        ),
        (
            GOOD,
            {"columns": {"rate": ["gx", "gy", "gw"]}},
            "column 'gw' for rate is not there; the files hold a.csv: t, gx",
        ),
        (GOOD, {"columns": {"rates": ["gx"]}}, "unknown role of columns 'rates'"),
        (GOOD, {"units": {"rate": "degrees"}}, "unknown unit of rate 'degrees'"),
        (GOOD, {"units": {"wheel_speed": "s"}}, "unknown unit of wheel_speed 's'"),
        (GOOD, {"columns": {"rate": ["gx", "gy"]}}, "rate takes 3 columns, found 2, ['gx', 'gy'], among a.csv"),
        ([*GOOD[:4], "w1 [kdeg/s]", "w2 [kdeg/s]", "w3 [kdeg/s]"], {}, "unknown unit of wheel_speed 'kdeg/s'"),
    ],
)
def test_what_cannot_be_guessed_is_refused_in_one_line(head, arguments, message, tmp_path):
    with pytest.raises(ValueError, match=re.escape(message)) as caught:
        read_log(write(tmp_path / "a.csv", head, np.column_stack([ROUND, TIME])[:, : len(head)]), **arguments)
    assert "\n" not in str(caught.value)


@cases(
    ("text", "message"),
    [
        (None, "there is no such file"),
        ("", "holds no table"),
        ("t,gx\n1,2\n1\n2\n", "line 3 has 1 cells where the table's first line names 2"),
        ("# of a downlink\n\nt,gx\n1,2\n1,2,3\n", "line 5 has 3 cells where the table's first line names 2"),
    ],
)
def test_damaged_files_are_refused(text, message, tmp_path):
    if text is not None:
        (tmp_path / "a.csv").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_log(tmp_path / "a.csv")


def test_a_row_that_was_cut_off_and_a_comment_do_no_harm(tmp_path):
    path = write(tmp_path / "a.csv", GOOD, np.column_stack([TIME, RATE, SPEED]), delimiter="\t")
    whole = path.read_text()
    path.write_text("# a, b, c, d\n" + whole[: whole.rstrip().rindex("\t")] + "\n")
    log = read_log(path)
    assert np.isnan(log.wheel_speed[-1, 2])
    np.testing.assert_array_equal(log.rate, RATE)
    assert f"1 of {len(TIME)} rows have cells without a number" in log.notes


def test_what_is_not_named_is_found_by_its_name(tmp_path):
    table = np.column_stack([TIME, RATE, SPEED, SPEED])
    log = read_log(
        write(tmp_path / "a.csv", [*GOOD, "u1 [mNm]", "u2 [mNm]", "u3 [mNm]"], table),
        {"motor_torque": ["u1 [mNm]", "u2 [mNm]", "u3 [mNm]"]},
    )
    np.testing.assert_array_equal(log.rate, RATE)
    np.testing.assert_allclose(log.motor_torque, 1e-3 * SPEED)
    assert log.units == {"time": "s", "rate": "rad/s", "wheel_speed": "rad/s", "motor_torque": "mNm"}
    assert log.stated == {"motor_torque"}


def test_units_by_their_many_names():
    for text in ("deg/s", "°/s", "dps", "deg_s", "degrees per second", "deg/sec"):
        assert factor("rate", text) == pytest.approx(np.pi / 180.0), text
    assert factor("wheel_speed", "-RPM") == pytest.approx(-np.pi / 30.0)
    assert split_header("gx [deg/s]") == ("gx", "deg/s")
    assert split_header("speed_ratio") == ("speed_ratio", None)


def test_a_log_checks_itself():
    with pytest.raises(ValueError, match=r"wheel_speed of a log must have shape \(20, n\) with n >= 3, got \(20, 2\)"):
        Log(time=TIME, rate=RATE, wheel_speed=SPEED[:, :2])
    with pytest.raises(ValueError, match="increase from row to row"):
        Log(time=TIME[::-1], rate=RATE, wheel_speed=SPEED)


def test_torques_are_read_where_they_are_named_and_never_guessed(tmp_path):
    path = tmp_path / "a.csv"
    head = "t,gx,gy,gz,w1,w2,w3,mx [mNm],my [mNm],mz [mNm],tau_1_Nm,tau_2_Nm,tau_3_Nm"
    np.savetxt(path, np.arange(52.0).reshape(4, 13), delimiter=",", header=head, comments="")
    assert read_log(path).torque is None
    named = {"torque": ["mx", "my", "mz"], "motor_torque": ["tau_1", "tau_2", "tau_3"]}
    named |= {"rate": ["gx", "gy", "gz"], "wheel_speed": ["w1", "w2", "w3"], "time": "t"}
    log = read_log(path, columns=named)
    np.testing.assert_allclose(log.torque[0], [7e-3, 8e-3, 9e-3])
    np.testing.assert_allclose(log.motor_torque[:, 2], [12.0, 25.0, 38.0, 51.0])
    np.testing.assert_allclose(read_log(path, named, {"motor_torque": "-mNm"}).motor_torque[0], [-0.01, -0.011, -0.012])
    with pytest.raises(ValueError, match="unit of torque 'rpm'"):
        read_log(path, named, {"torque": "rpm"})
