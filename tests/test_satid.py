"""Command `satid`: what it writes and prints, its exit codes, and that its page needs no network."""

import functools
import itertools
import json
import operator
import re

import gymnasium
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.identification.recorded import CUBESAT, clean_log, motion
from satid_gym.commands import lead
from satid_gym.commands.main import main
from satid_gym.telemetry import read_log
from tests.cases import cases


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """A folder with a log in deg/s and rpm, and the satellite's file."""
    folder = tmp_path_factory.mktemp("flight")
    rng = np.random.default_rng(0)
    truth = CUBESAT.replace(inertia=[0.05, 0.04, 0.011])
    log = clean_log(motion(truth, rng, 120.0), CUBESAT, rng)
    table = np.column_stack([log.time, np.degrees(log.rate), 30.0 / np.pi * log.wheel_speed])
    names = "t,gx [deg/s],gy [deg/s],gz [deg/s],rw1 (rpm),rw2 (rpm),rw3 (rpm)"
    np.savetxt(folder / "log.csv", table, delimiter=",", header=names, comments="", fmt="%.10g")
    (folder / "sat.json").write_text(json.dumps(CUBESAT.to_dict()))
    return folder


def test_identify_writes_json_picture_and_page(flight, tmp_path, capsys):
    pytest.importorskip("matplotlib")
    out = tmp_path / "out"
    code = main(["identify", str(flight / "log.csv"), "--satellite", str(flight / "sat.json"), "--output", str(out)])
    assert code == 0
    found = json.loads((out / "identification.json").read_text())
    assert found["inertia"][0][0] == pytest.approx(0.05, rel=1e-3)
    std = np.sqrt(np.diag(found["covariance"]))
    assert abs(found["inertia"][2][2] - 0.011) < 4.0 * std[2]
    assert (out / "identification.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    page = (out / "identification.html").read_text()
    assert "data:image/png;base64," in page
    assert not re.findall(r'(?:src|href)="(?!data:)', page)
    assert str(flight) not in page + json.dumps(found)  # no path of this machine
    shown = capsys.readouterr()
    assert re.search(r"^Jxx +0\.0[45]", shown.out, flags=re.M)
    assert "rate taken as deg/s, as files say" in shown.err


def test_units_on_the_command_line_and_a_slip_that_is_named(flight, tmp_path, capsys):
    arguments = [
        "identify",
        str(flight / "log.csv"),
        "--satellite",
        str(flight / "sat.json"),
        "--output",
        str(tmp_path),
    ]
    assert main([*arguments, "--units", "wheel_speed=rad/s"]) == 1
    assert "wheel speeds in rpm that were read as rad/s explains it" in capsys.readouterr().err
    assert not (tmp_path / "identification.json").exists()


@cases(
    ("arguments", "message"),
    [
        (["identify", "none.csv", "--satellite", "microsat"], "none.csv: there is no such file"),
        (
            ["identify", "none.csv", "--satellite", "microsat", "--units", "rate"],
            "--units takes ROLE=VALUE, got 'rate'",
        ),
        (["fly", "--policy", "nobody"], "unknown policy"),
        (["export", "--policy", "rate-square"], "Did you mean 'rate_square'"),
        (["fly", "--satellite", "nothing"], "unknown satellite 'nothing'"),
        (["fly", "--seed", "-3"], "--seed must be an integer of at least 0, got -3"),
        (["fly", "--policy", "rigid_tuor"], "Did you mean 'rigid_tour'?"),
        (["fly", "--policy", "rigid_tour"], "rigid_tour commands body rates: add --control rate"),
        (["fly", "--policy", "shaped_square"], "shaped_square commands body rates: add --control rate"),
        (["fly", "--picture", "a.gif"], "--picture takes a file that ends in .png"),
        (["fly", "--video", "a.avi"], "--video takes a file that ends in .mp4 or .gif"),
    ],
)
def test_mistakes_end_with_one_line(arguments, message, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


@cases(
    "arguments",
    [
        ["design", "nosat", "--output", "new/design"],
        ["identify", "nofile.csv", "--satellite", "microsat", "--output", "new"],
        ["export", "--policy", "mpc", "--output", "new"],
        ["fly", "--satellite", "nosat", "--log", "new/flight.csv"],
    ],
)
def test_a_command_that_fails_leaves_no_folder(arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    assert not list(tmp_path.iterdir())
    (tmp_path / "new").mkdir()
    assert main(arguments) == 2
    assert [one.name for one in tmp_path.rglob("*")] == ["new"]


def test_fly_prints_a_flight(capsys):
    assert main(["fly", "--satellite", "cubesat", "--policy", "rate_square", "--inertia", "static", "--seed", "1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "cubesat, rate_square, seed 1"
    assert len(lines) == 12
    assert float(lines[-1].split()[2].rstrip("%")) < 0.1


def test_identify_reads_the_log_of_a_flight(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    flown = ["fly", "--satellite", "cubesat", "--policy", "rate_square", "--inertia", "static", "--log", "flight.csv"]
    assert main(flown) == 0
    shown = capsys.readouterr().out.splitlines()
    assert shown[-1] == "written to flight.csv"
    assert main(["identify", "flight.csv", "--satellite", "cubesat", "--output", "found"]) == 0
    assert "rad/s" in (tmp_path / "flight.csv").read_text().splitlines()[0]
    found = json.loads((tmp_path / "found" / "identification.json").read_text())
    env = gymnasium.make("SatInertiaID-v0", satellite="cubesat", inertia="static")
    _, info = env.reset(seed=0)
    std = np.sqrt(np.diag(found["covariance"]))[:3]
    away = np.abs(np.diag(found["inertia"]) - np.diag(info["inertia_true"]))
    assert (away < 4.0 * std).all()
    assert (std < 0.01 * np.diag(info["inertia_true"])).all()
    plain = [*flown[:-2], "--seed", "0"]
    assert main(plain) == 0
    assert capsys.readouterr().out.splitlines()[-12:] == shown[:-1]  # the log changes nothing


def test_a_log_has_the_star_trackers_readings(tmp_path, monkeypatch, capsys):
    """From one to the next the attitude turns as the gyro says."""
    monkeypatch.chdir(tmp_path)
    flown = ["fly", "--satellite", "microsat", "--scenario", "operations", "--policy", "window_tour"]
    assert main([*flown, "--control", "rate", "--inertia", "static", "--log", "flight.csv"]) == 0
    log = read_log("flight.csv")
    steps = Rotation.from_rotvec(0.05 * (log.rate[1:] + log.rate[:-1]))
    seen = np.flatnonzero(np.isfinite(log.attitude).all(axis=1))
    assert len(seen) > 400
    widest = 0.0
    for first, last in itertools.pairwise(seen):
        turned = Rotation.concatenate(steps[first:last])
        by_gyro = functools.reduce(operator.mul, turned)
        by_stars = Rotation.from_quat(log.attitude[first]).inv() * Rotation.from_quat(log.attitude[last])
        assert (by_stars.inv() * by_gyro).magnitude() < 0.02
        widest = max(widest, by_stars.magnitude())
    assert widest > 0.3


@cases(
    ("arguments", "limit"),
    [
        (["--policy", "random"], "a body rate beyond 3"),
        (["--scenario", "flex", "--policy", "random"], "a deflection beyond 4"),
    ],
)
def test_fly_says_when_and_why_an_episode_ends_early(arguments, limit, capsys):
    assert main(["fly", "--inertia", "static", *arguments]) == 0
    *_, row, said = capsys.readouterr().out.splitlines()
    assert said == f"ended at {row.split()[0]} s: {limit} times its limit"


def test_a_network_that_does_not_fit_is_refused_with_what_can_add_numbers(tmp_path, capsys):
    path = tmp_path / "uncertain.json"
    path.write_text(json.dumps(CUBESAT.replace(tolerances={"gyro_bias": 1e-4, "gyro_scale": 1e-3}).to_dict()))
    assert main(["fly", "--satellite", str(path), "--policy", "universal", "--control", "rate"]) == 2
    error = capsys.readouterr().err
    assert "tolerances, panels, tanks and a star tracker in the data sheet add numbers too" in error
    assert error.endswith("rate_square, with --control rate, flies any satellite\n")


def test_rate_square_flies_a_satellite_that_it_was_not_tuned_for(flight, capsys):
    assert main(["fly", "--satellite", str(flight / "sat.json"), "--policy", "rate_square", "--inertia", "static"]) == 0
    shown = capsys.readouterr().out.splitlines()
    assert shown[0] == "threeu, rate_square, seed 0"
    assert float(shown[-1].split()[2].rstrip("%")) < 1.0
    assert main(["fly", "--satellite", str(flight / "sat.json"), "--policy", "sine"]) == 2
    assert "--control rate), flies any satellite" in capsys.readouterr().err


def test_fly_writes_picture_video_and_page(tmp_path, monkeypatch, capsys):
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    monkeypatch.chdir(tmp_path)
    short = tmp_path / "short.json"
    short.write_text(json.dumps({"base": "default", "horizon": 12.0}))
    files = ["--picture", "a.png", "--video", "a.mp4", "--page", "a.html"]
    assert main(["fly", "--scenario", str(short), "--seed", "3", *files]) == 0
    assert (tmp_path / "a.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    frames, _ = imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "a.mp4"))
    assert frames == 13  # before each decision, and at the end
    page = (tmp_path / "a.html").read_text()
    assert "data:video/mp4;base64," in page
    assert not re.findall(r'(?:src|href)="(?!data:)', page)
    last = capsys.readouterr().out.splitlines()
    assert last[-3:] == ["written to a.png", "written to a.mp4", "written to a.html"]
    assert last[0] in page


def test_compare_and_train_lead_to_the_checkout(monkeypatch, capsys):
    """Here they parse the checkout's options; outside of one they say where it is."""
    with pytest.raises(SystemExit) as caught:
        main(["train", "--help"])
    assert caught.value.code == 0
    assert "--satellite" in capsys.readouterr().out
    monkeypatch.setattr(lead.importlib.util, "find_spec", lambda name: None)
    assert main(["compare", "--episodes", "2"]) == 2
    assert "part of the checkout and not of the library" in capsys.readouterr().err


@cases("command", ["design", "identify", "fly", "export"])
def test_help_has_examples_and_fits_a_terminal(command, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit) as caught:
        main([command, "--help"])
    assert caught.value.code == 0
    shown = capsys.readouterr().out
    assert f"examples:\n  satid {command}" in shown
    assert max(map(len, shown.splitlines())) <= 80
