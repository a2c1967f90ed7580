"""Flight code: compiled with every warning an error, it flies what Pilot flies, whatever the readings are."""

import ctypes
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from satid_gym import SATELLITES, SCENARIOS, Pilot, Sensors, SloshMass, StarTracker, draw_satellites
from satid_gym.commands.main import main
from satid_gym.control.corners.features import features_of
from satid_gym.flightcode.c_types import DOUBLE, Array, TranslationError
from satid_gym.flightcode.measure import compiled
from satid_gym.flightcode.policy_files import template
from satid_gym.flightcode.translator import Translator
from satid_gym.flightcode.vectors import expected, flight
from satid_gym.flightcode.writer import texts, write
from satid_gym.policies import build
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.policies.shaped_square import ShapedSquarePolicy
from satid_gym.problem import problem
from tests.cases import cases
from tests.tolerances import ALL

ROOT = Path(__file__).parents[1]
SLOW = draw_satellites([2_000_000_014], wheels=4)[0]
SQUARE = {"period": 36.0, "margin": 2.5}
TANK = SloshMass(
    mass=2.8, position=[0.2, 0, 0.1], direction=[0, 0.6, 0.8], frequency=0.05, damping=0.05, deflection_limit=0.02
)


@pytest.fixture(scope="module", autouse=True)
def gcc():
    """A C compiler; if it is missing, a user's tests skip, and those of CI fail."""
    if shutil.which(compiler_name := os.environ.get("CC", "cc")) is None:
        reason = f"no C compiler {compiler_name!r}; for these tests: apt-get install gcc libc6-dev"
        (pytest.fail if os.environ.get("CI") else pytest.skip)(reason)


def built(folder, pilot):
    """Program that replays vectors, of the pilot's code in a folder; it stops where C says nothing of what happens."""
    for name, text in texts(pilot).items():
        (folder / name).write_text(text)
    return compiled(folder, "-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all", "-O1")


def replayed(check, folder, vectors):
    (folder / "flown.csv").write_text(vectors)
    run = subprocess.run([check, folder / "flown.csv"], capture_output=True, text=True)
    return run.returncode, run.stdout + run.stderr


def toured(kind):
    """A policy whose score takes all features of corners, those of modes where there are any."""
    is_shaped, rigid = kind.startswith("tour"), features_of(SCENARIOS["default"])
    features = features_of(SCENARIOS["flex"], is_shaped) if "tank" in kind else rigid
    weights = np.random.default_rng(7).normal(size=(1, len(features))).astype(np.float32)
    weights[0, [name not in rigid for name in features]] *= 3.0  # that of each tells
    if kind == "corners_rate":  # or a lost reading leads to other reversals than those of the flight that is replayed
        weights[0, features.index("waited")] = 10.0
    network = Network((weights,), (np.zeros(1, np.float32),))
    given = {"observation": "body", "include_covariance": kind != "corners_rate", "include_walk": True}
    given |= {"corner_features": features, "is_shaped": is_shaped}
    return LearnedPolicy("toured", network, "rate", 3.5, **given)


def tracked(scenario, delay=0.0, **sensors):
    """Pilot of a microsat with a star tracker that the Sun blinds, an unknown gyro bias, and what else sensors have."""
    tracker = StarTracker(boresight=[0.6, 0.0, 0.8], rate_limit=0.05, reacquire=2.0, sun_exclusion=0.5)
    tolerances = {"gyro_bias": 1e-4, "tachometer_delay": delay}
    world = {"name": scenario, "sensors": Sensors(star_tracker=tracker, **sensors), "tolerances": tolerances}
    return Pilot("microsat", build("rate_square", SQUARE), scenario=world, control="rate")


def panelled(name):
    """A data sheet with slow panels: those of cubesat are pulled to 1.8 times their limit where nothing spares them."""
    return SCENARIOS["flex"].appendages.equip(SATELLITES[name])[25]


def pilot_of(kind, pyramid):
    if kind == "tracker_gate":
        return tracked("faults")
    if kind == "gate_late":
        return tracked("faults", 0.1, gyro_integrates=True, encoder_pulses=64, tachometer_delay=0.9)
    if kind == "tracker_late":
        return tracked("default", 0.1, gyro_integrates=True, encoder_pulses=64, tachometer_delay=0.9)
    if kind == "panels":
        sheet = problem("microsat", scenario="flex").satellites[3]
        return Pilot(sheet, ShapedSquarePolicy(), scenario="flex", control="rate")
    if kind == "tour_rigid":
        return Pilot("microsat", "panel_tour", control="rate")
    if kind == "stargazer":
        return Pilot("microsat", kind, scenario="calibration", control="rate")
    if kind in ("tank_tour", "corner_tour"):
        policy = kind if kind == "tank_tour" else build(kind, {"hold": 10.0, "share": 0.8, "caution": 0.5})
        return Pilot(problem("microsat", scenario="slosh").satellites[3], policy, scenario="slosh", control="rate")
    if kind in ("tour_panels_tank", "corners_panels_tank"):
        sheet = panelled("microsat")
        panels = sheet.oscillators[0].replace(axis=[0.0, 0.6, 0.8])  # so that corners drive and bend it differently
        return Pilot(sheet.replace(oscillators=(panels, TANK)), toured(kind), control="rate")
    if kind == "tour_panels":
        return Pilot(panelled("cubesat"), "panel_tour", scenario="flex", control="rate")
    if kind.startswith("corners"):
        return Pilot("microsat" if kind == "corners_rate" else SLOW, toured(kind), control="rate")
    satellite = pyramid if kind.startswith("pyramid") else "microsat"
    if kind == "pyramid_band_rate":  # whose null motion keeps them out of it
        satellite = satellite.replace(wheels=satellite.wheels.replace(avoided_speed=(0.0, 20.0)))
    scenario = {"paper": "paper", "faults": "faults", "tolerances": {"tolerances": ALL}}.get(kind, "default")
    policy = kind if kind in ("generalist", "multi_step") else build("rate_square", SQUARE)
    return Pilot(satellite, policy, scenario=scenario, control="rate" if kind.endswith("rate") else "torque")


SLOW_KINDS = ("tracker_late", "gate_late", "tour_panels_tank", "corners_panels_tank", "stargazer")
KINDS = [
    "generalist",
    "multi_step",
    "pyramid",
    "pyramid_rate",
    "pyramid_band_rate",
    "paper",
    "faults",
    "tolerances",
    "panels",
    "corners_rate",
    "corners_pyramid_rate",
    "tracker_gate",
    "tour_panels",
    "tour_rigid",
    "tank_tour",
    "corner_tour",
    *(pytest.param(kind, marks=pytest.mark.slow) for kind in SLOW_KINDS),
]


@pytest.mark.parametrize("kind", KINDS)
def test_it_flies_a_whole_flight_as_python_does(kind, pyramid, tmp_path):
    """Torque, estimate and its standard deviations to 1e-6, with lost and repeated readings: check.c compares."""
    pilot = pilot_of(kind, pyramid)
    rows = flight(pilot, pilot.problem.scenario.decisions)
    assert sum(np.isnan(gyro).all() for _, gyro, *_ in rows) > 0.005 * len(rows)
    code, said = replayed(built(tmp_path, pilot), tmp_path, expected(pilot, rows))
    assert code == 0, said
    assert said.startswith(f"{len(rows)} readings")
    assert pilot.status.state == "over"


class Status(ctypes.Structure):
    _fields_ = (
        ("state", ctypes.c_int),
        ("flags", ctypes.c_uint32),
        *(
            (name, ctypes.c_uint32)
            for name in ("missing", "refused", "rejected", "repeated", "late", "ahead", "missed")
        ),
        *((name, ctypes.c_double) for name in ("nis", "nis_mean", "colour", "rate_max", "bend_max")),
    )


class Flown:
    """A pilot's C in this process. The struct begins with its status."""

    STATES = ("waiting", "flying", "coasting", "over")

    def __init__(self, folder, pilot):
        for name, text in texts(pilot).items():
            if name != "check.c":
                (folder / name).write_text(text)
        (folder / "test.c").write_text(
            '#include "satid_pilot.h"\nunsigned state_size(void);\nvoid spoil(satid_pilot *pilot);\n'
            "unsigned state_size(void) { return sizeof(satid_pilot); }\n"
            "const float *observed(const satid_pilot *pilot);\n"
            "const float *observed(const satid_pilot *pilot) { return pilot->observation[0]; }\n"
            "void spoil(satid_pilot *pilot) { pilot->belief.mean[3] = NAN; }\n"
        )
        library = ctypes.CDLL(str(compiled(folder, "-shared", "-fPIC").rename(folder / "pilot.so")))
        library.observed.restype = ctypes.POINTER(ctypes.c_float)
        self.size = max(place.stop for place in pilot.problem.layout.values())
        self.library, self.state = library, ctypes.create_string_buffer(library.state_size())
        self.limit = pilot.mission.satellite.wheels.max_torque

    @property
    def observation(self):
        return np.array(self.library.observed(self.state)[: self.size])

    @property
    def status(self):
        return Status.from_buffer(self.state)

    def _call(self, name, time, gyro, speed):
        torque = (ctypes.c_double * len(self.limit))()
        given = [None if r is None else (ctypes.c_double * len(r))(*r) for r in (gyro, speed)]
        getattr(self.library, name)(self.state, ctypes.c_double(time), *given, torque)
        assert np.isfinite(torque).all()
        assert (np.abs(torque) <= self.limit).all()
        return np.array(torque)

    def see(self, attitude):
        self.library.satid_see(self.state, (ctypes.c_double * 4)(*attitude))

    def sun(self, direction):
        self.library.satid_set_sun(self.state, (ctypes.c_double * 3)(*direction))

    def start(self, time, gyro, speed):
        return self._call("satid_start", time, gyro, speed)

    def step(self, time, gyro=None, speed=None):
        return self._call("satid_step", time, gyro, speed)


def test_attitudes_are_taken_once_and_refused_as_pilot_does(pyramid, tmp_path):
    pilot = pilot_of("tracker_gate", pyramid)
    rows = [row for row in flight(pilot, 30) if not any(np.isnan(reading).any() for reading in row[1:3])]
    sun = [0.36, 0.48, -0.8]
    flown = Flown(tmp_path, pilot)
    flown.sun(3.0 * np.array(sun))
    flown.see(rows[0][3])
    np.testing.assert_allclose(flown.start(*rows[0][:3]), pilot.start(*rows[0], sun=sun), rtol=0.0, atol=1e-9)
    refused = taken = 0
    for k, (time, gyro, speed, attitude) in enumerate(rows[1:]):
        taken += np.isfinite(attitude).all()
        if k % 7 == 0:
            attitude = [90.0, 0.0, 0.0, 1.0]
            refused += 1
        if np.isfinite(attitude).all():  # else nothing is said: the last one must not be taken again
            flown.see(attitude)
        torque = flown.step(time, gyro, speed)
        np.testing.assert_allclose(torque, pilot.step(time, gyro, speed, attitude), rtol=0.0, atol=1e-9)
        assert bool(flown.status.flags & 8192) == (k % 7 == 0)
        np.testing.assert_allclose(flown.observation, pilot._observation[0], rtol=1e-5, atol=1e-5)
        assert flown.status.nis == pytest.approx(pilot.estimate.nis, rel=1e-6)
    assert np.linalg.norm(flown.observation[pilot.problem.layout["sun"]]) == pytest.approx(1.0, abs=1e-5)
    assert flown.status.refused == pilot.status.counts["refused"] == refused
    assert taken > 30
    assert pilot.estimate.state_covariance[9, 9] < 1e-8


@cases("kind", ["generalist", "pyramid_rate"])
def test_readings_that_fail_are_handled_as_pilot_handles_them(kind, pyramid, tmp_path):
    pilot = pilot_of(kind, pyramid)
    rows = [row for row in flight(pilot, 40) if not np.isnan(row[1]).any()]
    flown, n = Flown(tmp_path, pilot), pilot.problem.wheels
    np.testing.assert_allclose(flown.start(*rows[0][:3]), pilot.start(*rows[0][:3]), rtol=0.0, atol=1e-9)
    stamped = [*rows[1:300], *[rows[250]] * 40, *rows[300:]]  # a clock that is set back and stands still for 4 s
    for k, (time, gyro, speed, _) in enumerate(stamped):
        if 60 < k < 100:
            gyro = None
        elif 150 < k < 180 or np.isnan(speed).any():
            speed = None
        elif k % 17 == 0:
            gyro = [0.0, np.nan, 0.0] if k % 2 else [0.0, np.inf, 0.0]
        elif k % 19 == 0:
            speed = np.full(n, 1e4)
        elif k % 23 == 0:
            time -= 0.25
        elif k % 29 == 0:
            time += 1e3
        elif 200 < k < 230:
            continue
        np.testing.assert_allclose(flown.step(time, gyro, speed), pilot.step(time, gyro, speed), rtol=0.0, atol=1e-9)
        assert flown.STATES[flown.status.state] == pilot.status.state
        assert {name: getattr(flown.status, name) for name in pilot.status.counts} == pilot.status.counts
        if pilot.estimate.nis == pilot.estimate.nis:  # NaN before the first
            assert flown.status.nis == pytest.approx(pilot.estimate.nis, rel=1e-6, abs=1e-9)
    assert all(count > 0 for kind, count in pilot.status.counts.items() if kind != "rejected")
    assert flown.status.rate_max > 0.3


@cases("kind", ["generalist", "pyramid_rate", "panels", "tour_panels"])
def test_no_reading_makes_it_command_what_is_not_finite_or_beyond_a_limit(kind, pyramid, tmp_path):
    pilot = pilot_of(kind, pyramid)
    flown, rng, n = Flown(tmp_path, pilot), np.random.default_rng(4), pilot.problem.wheels
    rate, speed = pilot.mission.satellite.rate_limit, pilot.mission.satellite.wheels.max_speed
    seen = set()
    for episode in range(20):
        flown.start(0.0, np.zeros(3), np.zeros(n))
        for k in range(1, 250):
            garbage = np.frombuffer(rng.bytes(8 * (3 + n)))
            wild = np.concatenate([rng.uniform(-10.0, 10.0, 3) * rate, rng.uniform(-1.5, 1.5, n) * speed])
            what = rng.integers(3) if episode % 2 else 1
            values = (garbage, wild, np.where(rng.random(3 + n) < 0.3, np.nan, 0.0))[what]
            time = garbage[0] if k % 100 == 99 and episode % 4 == 3 else 0.1 * k
            flown.step(time, values[:3], values[3:])
            seen.add(flown.STATES[flown.status.state])
    assert {"flying", "coasting"} <= seen


def test_a_filter_that_broke_down_gives_no_torque_until_it_is_started_again(pyramid, tmp_path):
    flown = Flown(tmp_path, pilot_of("generalist", pyramid))
    rest = np.zeros(3)
    assert not flown.step(0.0).any(), "it waits for readings"
    assert flown.STATES[flown.status.state] == "waiting"
    assert flown.status.flags == 1 + 2
    assert flown.step(0.1, rest, rest).any()
    assert flown.step(0.2, rest, rest).any()
    flown.library.spoil(flown.state)
    for k in range(3, 30):
        assert not flown.step(0.1 * k, rest, rest).any()
        assert flown.STATES[flown.status.state] == "coasting"
        assert flown.status.flags & 256
    assert flown.start(3.0, rest, rest).any()
    assert flown.status.flags == 0


def test_the_same_pilot_gives_the_same_bytes_and_no_static_data(tmp_path, capsys):
    for name in ("one", "two"):
        assert main(["export", "--policy", "rate_square", "--seed", "3", "--output", str(tmp_path / name)]) == 0
    names = sorted(path.name for path in (tmp_path / "one").iterdir())
    assert "satid_core.c" in names
    for name in names:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    run = subprocess.run(["make", "-s", "-C", tmp_path / "two"], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert "601 readings" in run.stdout
    (block,) = re.findall(r"^```c\n(.*?)^```", (ROOT / "docs" / "flightcode.md").read_text(), flags=re.DOTALL | re.M)
    own = "int read_gyro(double *);\nvoid read_wheels(double *);\nvoid command_motors(const double *);\n"
    (tmp_path / "two" / "loop.c").write_text(f"{own}void every_sample(double);\n{block}")
    compiled(tmp_path / "two", "-fsyntax-only")
    capsys.readouterr()
    assert main(["export", "--policy", "rate_square", "--measure", "--output", str(tmp_path / "one")]) == 0
    said = capsys.readouterr().out
    sizes = re.search(r"(\d+) bytes of code, (\d+) of constants, 0 of static data", said)
    assert sizes
    assert 10_000 < int(sizes[1]) < 60_000
    operations = re.search(r"(\d+) operations a reading, at most (\d+)", said)
    assert operations
    assert 2_000 < int(operations[1]) < int(operations[2])
    sources = texts(Pilot("microsat", "rate_square"))
    library = " ".join(text for name, text in sources.items() if name != "check.c")
    assert not re.search(r"\b(malloc|calloc|realloc|free|printf)\(", library)


def test_what_has_no_c_is_refused_in_one_line(tmp_path, capsys):
    assert main(["export", "--policy", "mpc", "--output", str(tmp_path)]) == 2
    network = Network((np.ones((1, 2), np.float32),), (np.zeros(1, np.float32),))
    starry = LearnedPolicy("starry", network, "rate", 3.5, observation="body", corner_features=["waited", "stars"])
    with pytest.raises(ValueError, match=r"starry has no C: its score takes stars; give a policy of agents.evolution"):
        texts(Pilot("microsat", starry, scenario="calibration", control="rate"))
    assert capsys.readouterr().err.startswith("error: policy mpc has no C: give a learned policy, rate_square")


def looping(x):
    while x > 0.0:
        x -= 1.0
    return x


def after_loop(x):
    for i in range(3):
        x += i
    return x + i


def mixed(x):
    y = x if x > 0.0 else (x, x)
    return y


@cases(
    ("function", "message"),
    [
        (looping, r"test_flightcode\.py:\d+: no C for a While"),
        (after_loop, "a variable that is read before it is assigned"),
        (mixed, "is of two types"),
    ],
)
def test_what_is_outside_the_subset_is_refused_with_file_and_line(function, message):
    with pytest.raises(TranslationError, match=message):
        Translator().call(function, [DOUBLE])


_TABLE = (0.5, 2.0, 4.0)


def swapped(x, y, a):
    a[0], a[1] = a[1], a[0]
    x, y = y, x
    first = second = a[2] = a[0] + a[1]
    return x - 2.0 * y + first * second + a[2]


def floored(x, y, a):
    total = 0
    for i in range(-5, 6):
        total += (i // 3) * 7 + i % 3
    for i in range(4, -1, -1):
        total += i * i
        if i == 2:
            continue
        total -= 1
    return total + np.int64(x) / 2 + min(np.int64(y), 3)


def compared(x, y, a):
    best = max(x, y, a[0])
    inside = x > y and not a[1] < 0.0
    inside = inside or x == y
    return best + (1.0 if inside else -1.0) * min(a[1], abs(y)) + np.sign(x - y) * _TABLE[np.int64(min(abs(x), 2.0))]


def branching(x, y, a):
    known, (least, most) = 2, (min(x, y), max(x, y))
    if known > 3:
        return a[7]
    for i in range(a.shape[0]):
        if a[i] > most:
            return a[i] ** 2
        elif a[i] < least:
            break
        least += 0.5**2
    else_where = -((x - y) ** 2) / (1.0 + abs(y)) ** 0.5
    return else_where if least > 0 else -least


@cases("function", [swapped, floored, compared, branching])
def test_the_translation_computes_what_python_does(function, tmp_path):
    translator = Translator()
    name, _ = translator.call(function, [DOUBLE, DOUBLE, Array("double", (3,))])
    text = "\n".join([*translator.structs.values(), *translator.definitions])
    head = '#include <stdbool.h>\n#include "satid_math.h"\n'
    entry = "double entry(double, double, double *);\ndouble entry(double x, double y, double *a)\n"
    (tmp_path / "part.c").write_text(f"{head}{text}{entry}{{\n    return {name}(x, y, a);\n}}\n")
    (tmp_path / "satid_math.h").write_text(template("satid_math.h"))
    entry = ctypes.CDLL(str(compiled(tmp_path, "-shared", "-fPIC"))).entry
    entry.restype = ctypes.c_double
    rng = np.random.default_rng(0)
    for _ in range(300):
        x, y, *a = rng.choice([-2.5, -1.0, 0.0, 0.25, 1.0, 3.5], 5).tolist()
        mine, own = list(a), (ctypes.c_double * 3)(*a)
        expected_value = function(x, y, np.array(mine))
        assert entry(ctypes.c_double(x), ctypes.c_double(y), own) == pytest.approx(expected_value, rel=1e-14)


def test_another_policy_in_the_same_folder_leaves_nothing_of_the_first(tmp_path):
    write(tmp_path, Pilot("microsat", "rate_square", control="rate"))
    names = write(tmp_path, Pilot("microsat", "multi_step"))
    assert sorted(path.name for path in tmp_path.iterdir()) == names


def test_a_pilot_that_flies_flies_on_while_it_is_written(tmp_path):
    pilots = [Pilot("microsat", "multi_step") for _ in range(2)]
    for pilot in pilots:
        pilot.start(0.0, np.zeros(3), np.zeros(3))
    write(tmp_path, pilots[0])
    after = [pilot.step(0.1 * k, np.zeros(3), np.zeros(3)) for pilot in pilots for k in range(1, 80)]
    np.testing.assert_array_equal(after[:79], after[79:])


def test_a_policy_of_ones_own_is_not_taken_for_its_parent(tmp_path):
    class Half(RateSquarePolicy):
        def __call__(self, observation):
            return 0.5 * super().__call__(observation)

    with pytest.raises(ValueError, match="rate_square is a Half of its own, and has no C"):
        write(tmp_path, Pilot("microsat", Half(12.0, 3.0)))
