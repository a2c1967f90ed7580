"""Videos of two policies side by side, and the rollouts that fly them."""

from __future__ import annotations

import sys
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from agents.viewer import record
from agents.viewer.rollout import Pairing, Rollout
from baselines.command.cli import exit_code
from baselines.scenarios.flights import Cell, flown
from baselines.scenarios.tune import tuned_rival
from satid_gym import SatInertiaIDEnv
from satid_gym.evaluation import benchmark_scenario, fly
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.policies.learned.shipped import PRETRAINED, find
from satid_gym.policy import Mission
from satid_gym.rendering import video
from tests.cases import cases

PAIRING = Pairing(policy="generalist", horizon=10.0)


class FullTorque:
    """Leaves the envelope as fast as it can."""

    name, kind = "full_torque", "reference"

    def reset(self, mission: Mission, seeds) -> None:
        self.wheels = mission.satellite.wheels.count

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        return np.ones((len(observation), self.wheels))


def run(monkeypatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["record", *arguments])
    return exit_code(record.main)


def decode(path: Path) -> list[np.ndarray]:
    """Every frame of an mp4."""
    reader = imageio_ffmpeg.read_frames(str(path))
    width, height = next(reader)["size"]
    return [np.frombuffer(data, np.uint8).reshape(height, width, 3) for data in reader]


# rollouts


def test_pilots_meet_the_same_truth_as_the_comparison_does():
    rollouts = PAIRING.rollouts()
    for rollout in rollouts:
        while not rollout.over:
            rollout.step()
    np.testing.assert_array_equal(*(rollout.info["inertia_true"] for rollout in rollouts))
    world = benchmark_scenario().replace(horizon=10.0)
    for rollout in rollouts:
        flight = fly(rollout.policy, satellite="microsat", inertia="step", seeds=[PAIRING.seed], scenario=world)
        np.testing.assert_allclose(rollout.history["relative_error"][1:], flight.error[:, 0], rtol=1e-12)
        assert rollout.outside == flight.outside.mean()
        assert rollout.mean_error == pytest.approx(flight.error.mean())
        assert rollout.history["information"][-1] == pytest.approx(flight.information.sum())


def test_by_body_rates_baselines_have_the_settings_of_the_standing_table():
    """Error at the end as in a flight of the gate, in units of the rotors' inertia, not in kg m^2."""
    pairing = Pairing(
        policy="stargazer", against="swing_and_stop", scenario="calibration", inertia="static", control="rate"
    )
    cell = Cell(scenario="calibration", satellite="microsat", inertia="static")
    settings, tuned = tuned_rival("calibration", "microsat", "swing_and_stop")
    learned, law = pairing.rollouts()
    assert {name: getattr(law.policy, name) for name in settings} == settings
    for rollout, policy in ((learned, find("stargazer")), (law, tuned)):
        while not rollout.over:
            rollout.step()
        assert rollout.error == pytest.approx(flown(cell, policy, [pairing.seed]).error[0], rel=1e-9)
        assert abs(rollout.error / rollout.info["relative_error"] - 1.0) > 0.1


@cases(
    ("policy", "given", "message"),
    [
        ("shaped_square", {"scenario": "flex"}, "shaped_square commands body rates: add --control rate"),
        ("sine", {"scenario": "paper", "control": "rate"}, "no settings by body rates for satellite 'microsat'"),
        (
            "sine",
            {"scenario": "flex", "satellite": "innocube", "control": "rate"},
            "not tuned for .* run python",
        ),
    ],
)
def test_what_cannot_be_flown_is_refused_with_what_to_do(policy, given, message):
    with pytest.raises(ValueError, match=message):
        Pairing(policy=policy, **given).rollouts()


@pytest.mark.interpreted
def test_a_law_that_is_not_tuned_for_the_satellite_flies_and_says_so(capsys):
    pairing = Pairing(policy="corner_tour", scenario="slosh", satellite="innocube", control="rate", against="zero")
    assert pairing.rollouts()[0].policy.name == "corner_tour"
    said = capsys.readouterr().err
    assert "note: corner_tour is not tuned for satellite 'innocube'" in said
    assert "run python -m baselines.scenarios.tune" in said


def test_a_pilot_far_outside_its_limits_stops():
    rollout = Rollout(FullTorque(), SatInertiaIDEnv("microsat", scenario={"horizon": 20.0}), seed=0)
    for _ in range(20):
        rollout.step()
    assert rollout.over
    assert rollout.terminated
    assert len(rollout.history["outside"]) < 20
    assert np.abs(rollout.history["rate"][-1]).max() > 3.0
    assert rollout.outside > 0.3


def test_a_policy_by_the_path_of_its_files():
    assert Pairing(policy=str(PRETRAINED / "generalist"), horizon=10.0).rollouts()[0].name == "generalist"


def test_pilots_see_what_their_policies_ask_for(tmp_path):
    rng = np.random.default_rng(0)
    layer = Network((rng.standard_normal((3, 70)).astype(np.float32),), (np.zeros(3, np.float32),))
    LearnedPolicy("wide", layer, "rate", 2.4, include_covariance=True).save(tmp_path / "wide")
    wide, zero = Pairing(policy=str(tmp_path / "wide"), against="zero", horizon=10.0).rollouts()
    for rollout, size in ((wide, 70), (zero, 37)):
        rollout.step()
        assert rollout.env.observation_space.shape == (size,)
    np.testing.assert_array_equal(wide.info["inertia_true"], zero.info["inertia_true"])


# pictures


def test_pictures_show_both_and_change():
    rollouts = PAIRING.rollouts("rgb_array", 240)
    first, *_, last = record.frames(rollouts, every=4)
    assert first.shape == last.shape == (23 + 240 + 64, 240 + 4 + 240, 3)
    for part in (first[:23], first[23:263, :240], first[23:263, 244:], first[263:]):
        assert len(np.unique(part.reshape(-1, 3), axis=0)) > 10
    for rows in (slice(0, 23), slice(23, 263), slice(263, None)):
        for columns in (slice(0, 240), slice(244, None)):
            assert (first[rows, columns] != last[rows, columns]).any()
    np.testing.assert_array_equal(last[23:263, :240], rollouts[0].env.render())


def test_the_chart_of_errors_has_a_curve_for_each():
    """Errors of 1 % and 10 % all along, at the heights of 1 % and 10 %."""
    rollouts = PAIRING.rollouts("rgb_array", 480)
    for rollout, error in zip(rollouts, (0.01, 0.1), strict=True):
        rollout.history["relative_error"][:] = [error] * 11
    chart = record.compose(rollouts)[526:, 60:900]
    heights = []
    for colour in record.COLOURS:
        near = np.abs(chart.astype(int) - colour).max(axis=2) < 40
        heights.append(np.flatnonzero(near.sum(axis=1) > 700).mean())
    np.testing.assert_allclose(heights, [24.0 + 84.0 * 1.5 / 4.5, 24.0 + 84.0 * 0.5 / 4.5], atol=1.5)


def test_a_picture_says_when_an_episode_ended_early():
    rollouts = [
        Rollout(
            FullTorque(), SatInertiaIDEnv(scenario={"horizon": 12.0}, render_mode="rgb_array", render_size=240), seed
        )
        for seed in (0, 1)
    ]
    pictures = list(record.frames(rollouts, every=1))
    assert all(rollout.terminated for rollout in rollouts)
    assert len(pictures) == max(len(rollout.history["outside"]) for rollout in rollouts)


# files


def test_an_mp4_holds_every_frame(tmp_path, monkeypatch, capsys):
    path = tmp_path / "new" / "flight.mp4"
    arguments = ("generalist", "--horizon", "10", "--every", "3", "--fps", "5", "--size", "240")
    assert run(monkeypatch, *arguments, "--output", str(path)) == 0
    assert str(path) in capsys.readouterr().out
    found = decode(path)
    expected = list(record.frames(PAIRING.rollouts("rgb_array", 240), every=3))
    assert len(found) == len(expected) == 5
    for one, other in zip(found, expected, strict=True):
        height, width = one.shape[:2]
        assert np.abs(one.astype(float) - other[:height, :width]).mean() < 6.0
    assert imageio_ffmpeg.count_frames_and_secs(str(path))[1] == pytest.approx(1.0, abs=0.05)
    assert [p.name for p in path.parent.iterdir()] == ["flight.mp4"]


def test_a_gif_holds_every_frame_and_rests_on_the_last(tmp_path, monkeypatch):
    path = tmp_path / "flight.gif"
    arguments = ("multi_step", "--against", "zero", "--inertia", "static", "--horizon", "6", "--every", "1")
    assert run(monkeypatch, *arguments, "--fps", "10", "--size", "240", "--output", str(path)) == 0
    with Image.open(path) as gif:
        assert gif.n_frames == 7
        durations = []
        for i in range(gif.n_frames):
            gif.seek(i)
            durations.append(gif.info["duration"])
        shown = np.asarray(gif.convert("RGB")).astype(float)
    assert durations == [100] * 6 + [2100]
    pairing = Pairing(policy="multi_step", against="zero", inertia="static", horizon=6.0)
    *_, last = record.frames(pairing.rollouts("rgb_array", 240), every=1)
    assert np.abs(shown - last).mean() < 3.0


@cases(
    ("arguments", "message"),
    [
        (("generalst",), "unknown policy (no such file either) 'generalst'"),
        (("generalist", "--against", "multistep"), "Did you mean 'multi_step'?"),
        (("generalist", "--satellite", "microsatt"), "unknown satellite"),
        (("generalist", "--inertia", "stepp"), "unknown inertia mode"),
        (("generalist", "--scenario", "windy"), "unknown scenario"),
        (("generalist", "--horizon", "10.5"), "must be an integer"),
        (("generalist", "--seed", "-1"), "seed must be"),
        (("generalist", "--every", "0"), "every must be at least 1"),
        (("generalist", "--size", "20"), "render_size must be"),
        (("generalist", "--output", "flight.avi"), "must end in .mp4 or .gif"),
        (("generalist", "--output", "file/flight.mp4"), "file: "),
        (("generalist", "--output", "folder.gif"), "is a folder"),
    ],
)
def test_what_cannot_be_recorded_is_refused_at_once(tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    Path("folder.gif").mkdir()
    assert run(monkeypatch, *arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert message in error
    assert not [path for path in tmp_path.rglob("*") if path.is_file() and path.name != "file"]


@pytest.mark.parametrize("ending", video.FORMATS)
def test_a_failure_leaves_the_old_video(tmp_path, ending):
    path = tmp_path / f"flight{ending}"
    path.write_bytes(b"old")

    def broken():
        yield np.zeros((64, 64, 3), np.uint8)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        video.write(path, broken(), fps=10)
    with pytest.raises(ValueError, match="at least one frame"):
        video.write(path, iter(()), fps=10)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() == b"old"
