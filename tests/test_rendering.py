"""Rendering: it shows the state, changes nothing, and works with Gymnasium's wrappers."""

from __future__ import annotations

import copy
import itertools
import pickle
import subprocess
import sys
import time
import warnings
from types import SimpleNamespace

import gymnasium
import imageio_ffmpeg
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RecordVideo
from scipy.spatial.transform import Rotation

from satid_gym import SATELLITES, SatInertiaIDEnv
from satid_gym.core.belief.records import belief_dtype
from satid_gym.core.records import report_dtype
from satid_gym.core.truth.records import plant_dtype
from satid_gym.estimators import FilterpyMomentumEKF
from satid_gym.rendering import History, draw
from satid_gym.rendering.appendages import Appendages
from satid_gym.rendering.canvas import ALARM, PANEL, SERIES, TEXT, Canvas, shade
from satid_gym.rendering.payload import Payload
from satid_gym.rendering.scene import MOMENTUM_COLOUR, RATE_COLOUR, Scene, box
from satid_gym.rendering.sky import Sky
from satid_gym.rendering.strip import Strip
from tests.cases import cases

SHORT = {"horizon": 20.0}
SCENE = (slice(36, 256), slice(0, 270))  # rows and columns of a frame of 480
STRIPS = (slice(280, 460), slice(44, 394))
RATES, WHEELS = (slice(58, 138), slice(294, 470)), (slice(168, 248), slice(294, 470))


def wave(decision: int) -> np.ndarray:
    """Excites all axes within the limits."""
    return 0.2 * np.sign(np.sin(decision + np.arange(1, 4))).astype(np.float32)


def flown(steps: int = 12, **settings) -> SatInertiaIDEnv:
    env = SatInertiaIDEnv(scenario=SHORT, render_mode="rgb_array", **settings)
    env.reset(seed=1)
    for i in range(steps):
        env.step(wave(i))
    return env


def where(frame: np.ndarray, colour: tuple[int, int, int], tolerance: int = 40) -> np.ndarray:
    """(N, 2) rows and columns of the pixels of about this colour."""
    return np.argwhere(np.abs(frame.astype(int) - colour).max(axis=2) <= tolerance)


def changed(one: np.ndarray, other: np.ndarray, part: tuple[slice, slice]) -> bool:
    return bool((one[part] != other[part]).any())


# what a frame shows


def test_every_part_changes_as_the_episode_goes_on():
    env = flown(5)
    before = env.render()
    np.testing.assert_array_equal(env.render(), before)
    env.step(wave(5))
    after = env.render()
    for part in (SCENE, RATES, WHEELS, STRIPS):
        assert changed(before, after, part)


def test_history_is_what_info_says():
    env = flown(0, inertia="step")
    _, info = env.reset(seed=2)
    infos = [info, *(env.step(wave(i))[4] for i in range(20))]
    history = env._history
    assert history.mode == "step"
    for name, key in (("truth", "inertia_true"), ("estimate", "inertia_estimate")):
        np.testing.assert_array_equal(getattr(history, name), [np.diag(info[key]) for info in infos])
    for name in ("time", "relative_error"):
        np.testing.assert_array_equal(getattr(history, name), [info[name] for info in infos])
    assert history.outside == pytest.approx(np.mean([info["outside"] for info in infos[1:]]))
    scale = env.fleet.rows.beliefs["theta_scale"][0]
    shown = np.log10(history.std[-1] / scale) + 2.0
    np.testing.assert_allclose(shown, env.fleet.rows.observations[0][env.layout["uncertainty"]], rtol=1e-5)


def test_a_foreign_estimators_belief_is_shown():
    estimator = FilterpyMomentumEKF()
    env = flown(3, estimator=estimator)
    np.testing.assert_allclose(env._history.estimate[-1], estimator.mean[3:6], rtol=0, atol=0)
    np.testing.assert_allclose(env._history.std[-1], np.sqrt(np.diag(estimator.covariance)[3:6]))


def test_a_strip_puts_values_where_they_belong():
    canvas = Canvas(480, 480)
    strip = Strip(canvas=canvas, x=100.0, y=200.0, width=200.0, height=100.0, horizon=10.0, low=-1.0, high=1.0)
    strip.ground()
    strip.band(np.array([0.0, 5.0]), np.array([-0.5, -0.5]), np.array([0.5, 0.5]), SERIES[2], 0.5)
    strip.curve(np.array([0.0, 10.0]), np.array([0.8, 0.8]), SERIES[0])
    strip.curve(np.array([0.0, 10.0]), np.array([5.0, 5.0]), SERIES[1])
    frame = canvas.pixels()
    rows, columns = where(frame, SERIES[0]).T
    assert rows.mean() == pytest.approx(210.0, abs=1.0)
    assert (columns.min(), columns.max()) == (pytest.approx(100, abs=2), pytest.approx(299, abs=2))
    assert where(frame, SERIES[1]).size == 0  # beyond the upper edge
    inside, outside = frame[250, 150], frame[250, 250]
    np.testing.assert_array_equal(outside, PANEL)
    assert 0.4 < (inside[2] - PANEL[2]) / (SERIES[2][2] - PANEL[2]) < 0.6
    assert {tuple(frame[row, 150]) for row in (222, 278)} == {PANEL}


def test_strips_follow_estimate_and_truth():
    """The estimate 1 % up moves its curve by 1 % of the moment; the white truth stays."""
    env = flown(20, satellite="smallsat", inertia="static")
    one, other = env._history, copy.deepcopy(env._history)
    for history in (one, other):
        history._series["std"][:] = 0.0
        history._series["estimate"][:] = 1.01 * history.truth
    other._series["estimate"][:] = 1.02 * other.truth
    places = []
    for history in (one, other):
        strips = draw(history, 480)[STRIPS]
        tracks = [where(strips[60 * i : 60 * i + 56], SERIES[i]) for i in range(3)]
        white = [where(strips[60 * i : 60 * i + 56], shade(PANEL, TEXT, 0.75), 60) for i in range(3)]
        places.append(([np.median(t[:, 0]) for t in tracks], [np.median(t[:, 0]) for t in white]))
    (up, still), (higher, truth) = places
    np.testing.assert_allclose(np.subtract(up, higher), 55.0 / 6.0, atol=1.01)  # 6 % fill a strip of 55
    np.testing.assert_array_equal(still, truth)


def test_a_strip_reaches_to_the_present_estimate():
    env = flown(5, inertia="static")
    env._history._series["std"][:] = 0.0
    for off in (1.01, 1.25, 0.6):
        env._history._series["estimate"][5] = off * env._history.truth[5]
        strips = env.render()[STRIPS]
        for i in range(3):
            ends = where(strips[60 * i : 60 * i + 56, 80:92], SERIES[i])
            assert len(ends) > 0, (off, i)


def test_momentum_stays_in_space_while_the_body_turns():
    env = flown(0, satellite="cubesat", inertia="static")
    centres = []
    for i in range(20):
        env.step(np.full(3, 0.5 if i < 3 else 0.0, np.float32))
        if i in (3, 19):
            env._history._series["rate"][i + 1] = 0.0  # its arrow would hide part of the other
            centres.append(where(env.render()[SCENE], MOMENTUM_COLOUR).mean(axis=0))
    np.testing.assert_allclose(*centres, atol=1.5)
    attitude = env._history.attitude
    assert np.abs(attitude[20] @ attitude[4]) < np.cos(np.radians(10.0))  # by more than 20 degrees


def test_the_rate_arrow_grows_with_the_rate():
    env = flown(3, inertia="static")
    reach = []
    for share in (0.5, 1.0):
        env._history._series["rate"][3] = [0.0, 0.0, share * env._history.satellite.rate_limit]
        reach.append(np.ptp(where(env.render()[SCENE], RATE_COLOUR), axis=0).max())
    assert reach[1] > 1.4 * reach[0]


def test_wheels_turn():
    env = flown(4)
    other = copy.deepcopy(env._history)
    other._series["wheel_speed"][1] *= 3.0
    assert changed(env.render(), draw(other, 480), SCENE)


def test_equivalent_box_has_the_inertia():
    """Of a uniform box 1 x 2 x 3 m, turned."""
    edges = np.array([1.0, 2.0, 3.0])
    moments = (np.sum(edges**2) - edges**2) / 12.0 * 60.0
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    satellite = SATELLITES["smallsat"].replace(inertia=turn @ np.diag(moments) @ turn.T, size=None)
    found, axes = box(satellite)
    found, axes = found[::-1], axes[:, ::-1]  # the longest edge has the least moment, and comes first
    np.testing.assert_allclose(found / found[0], edges / edges[0], rtol=1e-9)
    np.testing.assert_allclose(np.abs(axes.T @ turn), np.eye(3), atol=1e-9)
    np.testing.assert_array_equal(box(SATELLITES["microsat"])[0], [0.5, 0.6, 0.8])


def test_four_wheels_without_a_known_size(pyramid):
    history = History(pyramid, decisions=10, decision_period=1.0, law=0)
    plant, belief = np.zeros(1, plant_dtype(4))[0], np.zeros(1, belief_dtype(4, 6, 12))[0]
    report = np.zeros(1, report_dtype(4))[0]
    plant["attitude"] = [0.0, 0.0, 0.0, 1.0]
    plant["wheel_speed"] = [100.0, -200.0, 300.0, 400.0]
    report["inertia_true"] = pyramid.inertia
    belief["mean"][3:6], belief["covariance"] = np.diag(pyramid.inertia), 1e-4 * np.eye(12)
    history.note(plant, belief, report)
    frame = draw(history, 480)
    for k in range(4):
        assert len(where(frame[SCENE], SERIES[k])) > 10


def test_sizes():
    for size in (240, 961):
        frame = flown(2, render_size=size).render()
        assert frame.shape == (size, size, 3)
        assert frame.dtype == np.uint8
    for size in (239, 2161, 480.0, "480"):
        with pytest.raises(ValueError, match="render_size must be"):
            SatInertiaIDEnv(render_mode="rgb_array", render_size=size)


# it changes nothing


def test_a_rendered_rollout_is_the_same_bit_for_bit():
    settings = {"scenario": SHORT, "estimator": "adaptive"}
    plain, rendered = SatInertiaIDEnv(**settings), SatInertiaIDEnv(**settings, render_mode="rgb_array")
    for episode in range(2):
        pair = [env.reset(seed=5 if episode == 0 else None) for env in (plain, rendered)]
        np.testing.assert_array_equal(pair[0][0], pair[1][0])
        for i in range(20):
            rendered.render()
            (a, ra, *_), (b, rb, *_) = plain.step(wave(i)), rendered.step(wave(i))
            assert (a.tobytes(), ra) == (b.tobytes(), rb)
        for records in ("plants", "beliefs", "tasks", "reports", "observations"):
            assert getattr(plain.fleet.rows, records).tobytes() == getattr(rendered.fleet.rows, records).tobytes()
    assert plain.np_random.bit_generator.state == rendered.np_random.bit_generator.state


def test_a_frame_is_the_callers_own():
    env = flown(2)
    frame = env.render()
    kept = frame.copy()
    frame[:] = 0
    np.testing.assert_array_equal(env.render(), kept)


def test_copies_and_pickles_draw_the_same():
    env = flown(3)
    for other in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        np.testing.assert_array_equal(other.render(), env.render())


# Gymnasium


def test_gymnasiums_checker_has_nothing_to_say():
    env = gymnasium.make("SatInertiaID-v0", render_mode="rgb_array", disable_env_checker=True).unwrapped
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env)


def test_reset_comes_before_render():
    env = SatInertiaIDEnv(render_mode="rgb_array")
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        env.render()


def test_without_a_render_mode_render_warns_and_shows_nothing():
    env = SatInertiaIDEnv(scenario=SHORT)
    env.reset(seed=0)
    with pytest.warns(UserWarning, match='make it with render_mode="rgb_array"'):
        assert env.render() is None


def test_record_video_writes_every_frame(tmp_path):
    env = gymnasium.make("SatInertiaID-v0", render_mode="rgb_array", scenario=SHORT)
    with RecordVideo(env, str(tmp_path / "videos"), disable_logger=True) as recorder:
        recorder.reset(seed=0)
        for i in range(20):
            recorder.step(wave(i))
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "videos" / "rl-video-episode-0.mp4"))
    assert frames == 21
    assert seconds == pytest.approx(21 / SatInertiaIDEnv.metadata["render_fps"], abs=0.06)


def test_human_mode_opens_a_window_and_closes_it(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*HumanRendering wrapper is being applied")
        env = gymnasium.make("SatInertiaID-v0", render_mode="human", scenario=SHORT)
    env.reset(seed=0)
    env.step(wave(0))
    assert env.get_wrapper_attr("window").get_size() == (480, 480)
    env.close()
    assert flown(1).render().any()  # pygame has been shut down in between


def test_make_vec_renders_single_environments_alone():
    with pytest.raises(ValueError, match='vectorization_mode="sync"'):
        gymnasium.make_vec("SatInertiaID-v0", num_envs=2, render_mode="rgb_array")
    envs = gymnasium.make_vec(
        "SatInertiaID-v0", num_envs=2, render_mode="rgb_array", vectorization_mode="sync", scenario=SHORT
    )
    envs.reset(seed=0)
    assert [frame.shape for frame in envs.render()] == [(480, 480, 3)] * 2


def test_the_drawing_library_is_imported_for_rendering_alone():
    code = """
import sys
sys.modules["pygame"] = None  # as if it were not installed
import gymnasium, numpy as np, satid_gym
env = gymnasium.make("SatInertiaID-v0")
env.reset(seed=0)
env.step(np.zeros(3, np.float32))
try:
    gymnasium.make("SatInertiaID-v0", render_mode="rgb_array")
except gymnasium.error.DependencyNotInstalled as error:
    assert "pip install" in str(error), error
else:
    raise AssertionError("no error")
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_speed():
    """The benchmark says how many; this floor is for busy machines."""
    env = flown(20)
    times = []
    for _ in range(10):
        start = time.perf_counter()
        env.render()
        times.append(time.perf_counter() - start)
    assert 1.0 / min(times) > 10.0


# panels and tanks


@cases("scenario", ["flex", "slosh"])
def test_appendages_are_drawn_as_they_bend(scenario):
    """The words say how far, the colour when too far, and the picture moves with the deflection alone."""
    env = SatInertiaIDEnv("microsat", "static", scenario, render_mode="rgb_array", render_size=480)
    env.reset(seed=3)
    env.step(np.zeros(3, np.float32))
    history, frames = env._history, []
    limit = env.problem.satellites[0].oscillators[0].deflection_limit
    for share in (0.0, 0.5, 0.99, 1.01):
        history._series["deflection"][history.count - 1] = share * limit
        frames.append(env.render())
    for before, after in itertools.pairwise(frames):
        assert changed(before, after, SCENE)
        np.testing.assert_array_equal(before[RATES], after[RATES])
    red = [len(where(frame[SCENE], ALARM)) for frame in frames]
    assert max(red[:3]) < 20 < red[3]


def test_a_panel_is_drawn_at_its_hinge_and_along_its_arm():
    """Seen in the body's own frame: a panel of a metre at half a metre, turned by 20 degrees at its limit."""
    env = SatInertiaIDEnv("microsat", "static", "flex", render_mode="rgb_array")
    env.reset(seed=3)
    satellite = env._history.satellite
    (panel,) = satellite.oscillators
    canvas = Canvas(480, 480)
    scene = Scene(canvas, (240.0, 240.0), 100.0, env._history)
    drawn = []
    scene.canvas = SimpleNamespace(
        polygon=lambda points, *_: drawn.append(np.asarray(points)), line=lambda *_, **__: None
    )
    for q in (0.0, panel.deflection_limit):
        env._history._series["deflection"][0] = q
        appendages = Appendages(scene)
        appendages.panels(front=True)
        appendages.panels(front=False)
    assert len(drawn) == 4  # a pair, twice
    for points, angle in zip(drawn, (0.0, 0.0, 20.0, 20.0), strict=True):
        turned = Rotation.from_rotvec(np.radians(angle) * panel.axis).as_matrix() @ panel.arm
        middles = [scene.place(scene.scale * scene.to_view @ (side * (panel.hinge + turned))) for side in (1.0, -1.0)]
        assert min(np.linalg.norm(points.mean(axis=0) - middle) for middle in middles) < 1e-6


def test_panels_stay_in_the_view_and_clear_of_the_words_below_whatever_the_attitude():
    env = SatInertiaIDEnv("microsat", "static", "flex", render_mode="rgb_array")
    env.reset(seed=3)
    env.step(np.zeros(3, np.float32))
    history, drawn = env._history, []
    canvas = SimpleNamespace(polygon=lambda points, *_: drawn.append(np.asarray(points)), line=lambda *_, **__: None)
    for attitude in Rotation.random(200, random_state=0).as_quat():
        history._series["attitude"][history.count - 1] = attitude
        appendages = Appendages(Scene(canvas, (136.0, 144.0), 82.0, history))
        for front in (True, False):
            appendages.panels(front=front)
    x, y = np.concatenate(drawn).T
    assert (x.min(), x.max()) > (0.0, 0.0)
    assert x.max() < 272.0
    assert y.min() > 36.0
    assert y.max() < 244.0  # words are from 245 to 255
    assert y.max() > 230.0  # and no room is wasted


def test_the_name_of_an_axis_is_next_to_the_cone_along_it():
    env = SatInertiaIDEnv("microsat", "static", "operations", render_mode="rgb_array")
    env.reset(seed=3)
    scene, places = Scene(Canvas(480, 480), (240.0, 240.0), 100.0, env._history), {}
    payload = Payload(env._history, env._history.operations)
    axis = int(np.argmax(payload._axis))
    for cones in ([], [payload]):
        scene.canvas = SimpleNamespace(
            text=lambda place, name, *_: places.setdefault(name, []).append(np.array(place)), line=lambda *_, **__: None
        )
        scene.body_axes(cones)
    moved = {name: np.linalg.norm(both[1] - both[0]) for name, both in places.items()}
    shift = 30.0 * np.tan(payload._half) + 9.0
    assert moved == pytest.approx({name: shift if i == axis else 0.0 for i, name in enumerate("xyz")})


# a star tracker


@pytest.fixture(scope="module")
def tracked():
    env = SatInertiaIDEnv("microsat", "static", "calibration", render_mode="rgb_array", render_size=480)
    env.reset(seed=3)
    return env


def sky_of(env, sun, earth=(0.0, 0.0, -1.0), tracks=False, rate=0.0):
    """Sky with Sun and Earth at places of the body frame."""
    history = env._history
    history._series["tracks"][0], history._series["rate"][0] = tracks, [rate, 0.0, 0.0]
    sky = Sky(history, history.satellite.sensors.star_tracker)
    sky.sun, sky.earth = (np.array(v) / np.linalg.norm(v) for v in (sun, earth))
    return sky


def test_the_frame_says_what_blinds_the_tracker(tracked):
    boresight = tracked._history.satellite.sensors.star_tracker.boresight
    limit = tracked._history.satellite.sensors.star_tracker.rate_limit
    away = -boresight
    for words, sun, earth, settings in [
        ("tracks", away, away, {"tracks": True}),
        ("blind: Sun", boresight, away, {}),
        ("blind: Earth", away, boresight, {}),
        ("blind: too fast", away, away, {"rate": 1.01 * limit}),
        ("finds its stars", away, away, {}),
    ]:
        assert sky_of(tracked, sun, earth, **settings).state()[0] == words


@cases("size", [0.2, 1.2])
@cases("angle", [0.1, 1.5, 3.0])
def test_the_map_covers_what_the_sky_hides(tracked, size, angle):
    """By directions drawn on the sphere: those within an angle are filled, wherever it lies, also round the rim."""
    sky = sky_of(tracked, [0.0, 0.0, 1.0])
    axis = sky._tracker.boresight
    aside = np.cross(axis, [0.0, 1.0, 0.0]) / np.linalg.norm(np.cross(axis, [0.0, 1.0, 0.0]))
    towards = np.cos(angle) * axis + np.sin(angle) * aside
    canvas, middle, radius = Canvas(400, 400), np.array([200.0, 200.0]), 180.0
    sky._disc(canvas, middle, radius, towards, size, 0.0, (255, 255, 255))
    picture = canvas.pixels()[:, :, 0]
    rng = np.random.default_rng(0)
    directions = rng.standard_normal((400, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    apart = np.arccos(np.clip(directions @ towards, -1.0, 1.0))
    clear = (np.abs(apart - size) > 0.08) & (directions @ axis > np.cos(3.0))
    x, y = np.round(sky._place(middle, radius, directions[clear])).astype(int).T
    np.testing.assert_array_equal(picture[y, x] > 128, apart[clear] < size)


def test_only_satellites_with_a_tracker_show_one(tracked):
    plain = SatInertiaIDEnv("microsat", "static", render_mode="rgb_array", render_size=480)
    plain.reset(seed=3)
    corner = np.s_[60:140, 10:90]
    assert changed(plain.render(), tracked.render(), corner)


# a payload


def test_the_frame_says_what_the_payload_does():
    env = SatInertiaIDEnv("microsat", "static", "operations", render_mode="rgb_array")
    env.reset(seed=3)
    history, operations = env._history, env.problem.scenario.operations
    axis, away = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    history._series["windows"][0] = 10.0, 30.0
    near = Rotation.from_rotvec([0.5 * operations.pointing, 0.0, 0.0]).apply(axis)
    for words, at, sun, target, rate in [
        ("window in 10 s", 0.0, away, away, 0.0),
        ("too near the Sun", 0.0, axis, away, 0.0),
        ("images, 18 s left", 12.0, away, near, 0.0),
        ("off its target", 12.0, away, away, 0.0),
        ("not steady", 12.0, away, near, 2.0 * operations.steadiness),
    ]:
        history._series["time"][0], history._series["rate"][0] = at, [rate, 0.0, 0.0]
        payload = Payload(history, operations)
        payload.sun, payload.target = sun, target
        assert payload.state()[0] == words


def test_windows_are_bands_and_missed_ones_are_red():
    """A band from opening to closing over the rates; what was missed of it, and nothing else, in red."""
    pictures = []
    for share in (0.0, 1.0):
        env = SatInertiaIDEnv("microsat", "static", "operations", render_mode="rgb_array")
        env.reset(seed=3)
        for _ in range(80):
            env.step(np.zeros(3, np.float32))
        env._history._series["missed"][:] = share * (env._history._series["missed"] > 0.0)
        pictures.append(env.render().astype(int))
    changed = np.argwhere((pictures[0] != pictures[1]).any(axis=2))
    at = 294.0 + 176.0 * env._history.windows[0] / env._history.horizon
    assert len(changed) > 100
    assert changed[:, 1].min() > at[0] - 3.0
    assert changed[:, 1].max() < at[1] + 3.0
