"""Manoeuvres: their waves against the equations of motion, their trials against the evaluation, what is refused."""

import contextlib
import dataclasses
import io
import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from satid_gym import SATELLITES, KeepOut, Panel, Pilot, design, simulate
from satid_gym.commands.main import main
from satid_gym.evaluation import fly, seeds
from satid_gym.manoeuvres import Effort, ManoeuvrePolicy, NotPossibleError, Request
from satid_gym.manoeuvres.feasibility import least_std
from satid_gym.manoeuvres.notes import remarks
from satid_gym.manoeuvres.page import page
from satid_gym.manoeuvres.pointing import attitudes, separations, turned
from satid_gym.manoeuvres.rivals import rivals
from satid_gym.manoeuvres.search import manoeuvres, settling
from satid_gym.manoeuvres.trial import fly_side_by_side
from satid_gym.manoeuvres.waves import SIZE, Authority, Waves
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.policies.scripted import ScriptedPolicy
from satid_gym.policy import only_mission
from satid_gym.problem import problem
from satid_gym.profiles import PROFILES
from tests.cases import cases
from tests.tolerances import ALL

QUICK = Effort(population=16, rounds=3, episodes=4, flights=24)
MICROSAT = SATELLITES["microsat"]
AXES = np.array([[1, -1, -1, 1], [1, 1, -1, -1], [1, 1, 1, 1]]) / np.sqrt(3.0)
PYRAMID = MICROSAT.replace(
    inertia=MICROSAT.inertia + np.array([[0.0, 0.5, -0.2], [0.5, 0.0, 0.3], [-0.2, 0.3, 0.0]]),
    wheels=MICROSAT.wheels.replace(axes=AXES, inertia=2e-3, max_torque=0.1, max_speed=900.0),
)


def drawn(authority, count=20, seed=0):
    """Waves with periods of 20 to 80 s and windows of 3 to 12 s."""
    rng = np.random.default_rng(seed)
    code = np.empty((count, SIZE))
    code[:, 0], code[:, 1] = np.log(rng.uniform(20.0, 80.0, count)), np.log(rng.uniform(3.0, 12.0, count))
    code[:, 2:5], code[:, 5:] = rng.uniform(-1.5, 0.0, (count, 3)), rng.uniform(0.0, 1.0, (count, 3))
    return Waves.decoded(code, authority)


@pytest.mark.parametrize("returns", [False, True])
def test_waves_are_at_rest_at_both_ends_and_within_what_the_wheels_give(returns):
    authority, fine = Authority.of(MICROSAT), np.linspace(0.0, 300.0, 30_001)
    rates = drawn(authority).rates(fine, 300.0, returns)
    np.testing.assert_allclose(rates[:, [0, -1]], 0.0, atol=1e-15)
    assert (np.abs(rates) <= authority.rate * (1.0 + 1e-9)).all()
    assert np.abs(rates).max() > 0.5 * authority.rate.min()
    assert (np.abs(np.diff(rates, axis=1)) / 0.01 <= authority.acceleration * (1.0 + 1e-6)).all()
    assert bool(np.abs(rates + rates[:, ::-1]).max() < 1e-12) is returns  # the reverse of itself


@pytest.mark.parametrize("satellite", [MICROSAT, PYRAMID], ids=["three wheels", "four and a full tensor"])
def test_torque_gives_the_nominal_satellite_the_rates_and_brings_it_back(satellite):
    posed = problem(satellite, "static", control="rate")
    waves = drawn(Authority.of(satellite), count=3)
    for plan in manoeuvres(waves, Request(returns=True), posed, satellite):
        flown = simulate(satellite, plan.torque, 1.0)
        middle = 0.5 * (flown.omega[1:] + flown.omega[:-1])
        np.testing.assert_allclose(middle, plan.rate, atol=2e-3 * satellite.rate_limit)
        assert np.linalg.norm(flown.omega[-1]) < 1e-3 * satellite.rate_limit
        apart = Rotation.from_quat(flown.attitude[:-1]).inv() * Rotation.from_quat(plan.attitude)
        assert np.degrees(apart.magnitude().max()) < 0.2
        assert np.degrees(turned(flown.attitude[-1])) < 0.2
        assert np.degrees(turned(flown.attitude).max()) > 5.0


def test_a_mode_whose_period_divides_the_window_is_left_at_rest():
    """Singer and Seering's boxcar, on a panel of the truth."""
    panel = Panel(hinge=[0, 0.3, 0], axis=[1, 0, 0], arm=[0, 0.3, 0], mass=1.0, frequency=0.25, damping=0.0)
    satellite = MICROSAT.replace(oscillators=[panel])
    J_free = satellite.inertia - satellite.wheels.rotor_inertia
    (mode,) = satellite.modes
    turning = mode.frequency / np.sqrt(1.0 - mode.coupling[0] ** 2 / J_free[0, 0])  # Hz, of the body set free
    ringing = {}
    for turns in (2.0, 2.5):
        window = np.full((1, 3), turns / turning)
        waves = Waves(
            period=np.full((1, 1), 1e6), window=window, amplitude=np.array([[0.02, 0, 0]]), phase=np.zeros((1, 3))
        )
        time = 0.1 * np.arange(1001)
        rates = waves.rates(time, 60.0, False)[0]
        flown = simulate(satellite, -np.diff(rates, axis=0) @ J_free / 0.1, 0.1)
        ringing[turns] = np.ptp(flown.deflection[time > 62.0])
        assert np.ptp(flown.deflection) > 1e-3
    assert ringing[2.0] < 0.05 * ringing[2.5]


def test_rivals_with_which_the_filter_breaks_down_are_left_out_and_told(monkeypatch):
    broken, said = ("sine", "chirp"), []

    def flown(world, policies, seeds, keep_outs=()):
        if any(policy.name in broken for policy in policies):
            raise FloatingPointError("a filter broke down")
        return [SimpleNamespace(name=policy.name, expected=1.0, keeps=lambda limit: True) for policy in policies]

    monkeypatch.setattr("satid_gym.manoeuvres.rivals.fly_side_by_side", flown)
    posed = problem("microsat", "static", control="rate")
    names = [trial.name for trial in rivals(posed, Request(duration=60.0), Effort(), said.append)]
    assert names == [*(name for name in PROFILES if name not in broken), "rate_square"]
    assert any("left out 26 settings of the paper's eight profiles" in line for line in said)


@cases(("period", "bandwidth"), [(1.0, 1.0), (3.0, 1.0), (10.0, 1.0), (1.0, 0.3)])
def test_it_returns_and_rests_whatever_the_period_of_decisions(period, bandwidth):
    world = {"decision_period": period, "horizon": 300.0, "rate_bandwidth": bandwidth}
    posed = problem("microsat", "static", world, control="rate")
    waves = drawn(Authority.of(MICROSAT), count=5)
    for plan in manoeuvres(waves, Request(returns=True), posed, MICROSAT):
        rest = round(settling(posed.scenario) / period)
        assert rest * period >= min(4.0 / bandwidth, 300.0)
        np.testing.assert_allclose(plan.rate[-rest:], 0.0, atol=1e-15)
        assert np.degrees(turned(plan.attitude[-1])) < 0.01


def test_a_weak_motor_gives_a_slow_manoeuvre_not_none():
    weak = MICROSAT.replace(wheels=MICROSAT.wheels.replace(max_torque=1e-3))
    posed = problem(weak, "static", {"horizon": 100.0}, control="rate")
    slow = Authority.of(weak, 0.5 * (100.0 - settling(posed.scenario)))
    rates = [np.abs(plan.rate).max() for plan in manoeuvres(drawn(slow), Request(duration=100.0), posed, weak)]
    assert np.median(rates) > 0.2 * slow.rate.max() > 0.0


def test_what_comes_after_an_early_end_does_not_count():
    runaway = ScriptedPolicy("one_step", PROFILES["one_step"], 1.0)
    sun = KeepOut(boresight=[0, 0, 1], direction=[1, 0, 0], angle=0.1)
    posed = problem("microsat", "static", {"horizon": 60.0})
    (trial,) = fly_side_by_side(posed, [runaway], seeds("validation", 8), [sun])
    assert trial.terminated.all()
    assert (trial.rate > 3.0).all()
    assert (trial.rate < 6.0).all()  # of the decision that ended it, not of the drawn ones that follow
    assert np.isinf(trial.std[-1]).all()
    assert not trial.keeps(1.0)
    assert (trial.clearance > np.radians(45.0)).all()  # it had turned by some degrees only
    assert (trial.end_rate > 2.0 * MICROSAT.rate_limit).all()


def test_limits_of_pointing_are_held_by_the_flights():
    said = r"points \d.* deg beyond its turn limit or into a keep-out: give it more room or search for more rounds$"
    with pytest.raises(NotPossibleError, match=said):
        design("microsat", duration=60.0, turn_limit=np.radians(0.05), effort=QUICK)


def test_an_accuracy_that_tolerances_forbid_is_refused_with_their_names():
    unsure = MICROSAT.replace(tolerances={**dict.fromkeys(ALL, 1e-6), "gyro_scale": 2e-3})
    with pytest.raises(NotPossibleError, match=r"give smaller tolerances \(gyro_scale\), wider limits"):
        design(unsure, duration=60.0, accuracy=2e-4, effort=Effort(population=8, rounds=1, episodes=2, flights=8))


def test_the_page_of_a_manoeuvre_by_torque_promises_no_rest_at_the_end():
    effort = Effort(population=8, rounds=1, episodes=2, flights=8)
    found = design("microsat", duration=60.0, control="torque", effort=effort)
    text = page(found, b"", "satid design microsat")
    assert "from rest to rest" not in text
    assert re.search(
        r"60 s from rest, flown by torque in open loop; at the end the rate is [\d.]+ % of its limit", text
    )


def test_ticks_of_bars_stay_apart_and_a_logarithmic_axis_has_dots():
    pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure

    from satid_gym.manoeuvres import figure

    for values, bars in (([6.1e-5, 5.4e-5, 8.2e-5], 3), ([6e-5, 5e-3, np.inf], 0)):
        axes = Figure(figsize=(5.5, 3.5)).subplots()
        figure._bars(axes, ["one", "two", "three"], values, ["0.5"] * 3)
        assert len(axes.patches) == bars
        assert len(axes.collections) == (bars == 0)
        assert axes.get_xscale() == ("linear" if bars else "log")
        assert not bars or len(axes.get_xticks()) <= 5


def test_attitudes_follow_the_rates():
    rates = np.tile([0.0, 0.0, 0.01], (1, 101, 1))
    turns = attitudes(rates, 1.0)
    assert turned(turns[0, -1]) == pytest.approx(1.0)
    sun = KeepOut(boresight=[2.0, 0.0, 0.0], direction=[0.0, 3.0, 0.0], angle=0.1)
    assert separations(turns, [sun])[0, -1, 0] == pytest.approx(0.5 * np.pi - 1.0)


def test_flights_side_by_side_are_those_of_the_evaluation():
    own = seeds("validation", 5)
    posed = problem("microsat", "static")
    policies = [RateSquarePolicy(period, 3.0) for period in (8.0, 16.0)]
    for policy, trial in zip(policies, fly_side_by_side(posed, policies, own), strict=True):
        flight = fly(policy, satellite="microsat", inertia="static", seeds=own)
        np.testing.assert_array_equal(trial.error, flight.error)
        np.testing.assert_array_equal(trial.costs[:, 0], flight.scores()["outside_fraction"])
        assert not trial.terminated.any()
    assert np.all(trial.std[-1] < 0.01)


@pytest.mark.parametrize(
    ("inertia", "doubted"), [("static", False), ("step", True)], ids=["as the filter has it", "a step it does not know"]
)
def test_a_note_tells_when_the_filter_doubts_itself_in_more_than_one_flight_in_a_hundred(inertia, doubted):
    posed = problem("microsat", inertia, {"horizon": 200.0}, {"name": "momentum", "inertia_walk": 0.0})
    (trial,) = fly_side_by_side(posed, [RateSquarePolicy(16.0, 3.0)], seeds("validation", 20))
    said = [note for note in remarks(only_mission(posed), Request(), trial, []) if "restarted" in note]
    assert bool(trial.doubted.mean() > 0.01) is doubted
    assert [note.startswith(f"in {trial.doubted.mean():.0%} of the flights") for note in said] == [True] * doubted


def test_std_of_the_typical_flight_stays_where_a_few_bad_ones_set_the_root_mean_square():
    posed = problem("microsat", "static", {"horizon": 60.0})
    (trial,) = fly_side_by_side(posed, [RateSquarePolicy(16.0, 3.0)], seeds("validation", 20))
    std = trial.std.copy()
    std[-1, 0] *= 100.0
    spoilt = dataclasses.replace(trial, std=std)
    np.testing.assert_allclose(spoilt.median_std, trial.median_std, rtol=0.2)
    assert (spoilt.parameter_std[-1] > 10.0 * spoilt.median_std).all()


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A design of 120 s, written by the command, with what was printed."""
    pytest.importorskip("matplotlib")
    folder = tmp_path_factory.mktemp("design")
    words = ["design", "microsat", "--duration", "120", "--rounds", "1", "--keep-out", "0,0,1:1,0,0:40"]
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as error:
        assert main([*words, "--output", str(folder)]) == 0
    return folder, out.getvalue(), error.getvalue()


@pytest.fixture(scope="module")
def found():
    return design("microsat", returns=True, turn_limit=0.5, effort=QUICK)


def test_a_design_keeps_its_limits_beats_the_eight_and_claims_what_is_so(found):
    trial = found.trial
    assert trial.keeps(0.01)
    assert trial.turn.max() < 0.5
    assert np.degrees(np.median(trial.turn[-1])) < 2.0
    assert np.median(trial.end_rate) < 0.03 * MICROSAT.rate_limit
    assert 0.3 < trial.nees.mean() < 2.0
    assert found.least[-1] < trial.accuracy < 3.0 * found.least[-1]
    eight = [rival.accuracy for rival in found.rivals if rival.name != "rate_square"]
    assert len(eight) == 8
    assert trial.accuracy < min(eight) / 5.0
    assert trial.error[-1].mean() < 3.0 * trial.accuracy
    assert found.open_loop.beyond > 0.1  # without a rate loop it drifts: the other control is for that


def test_bound_falls_with_time_and_with_better_limits():
    least = least_std(only_mission(problem("microsat", "static")), 100.0)
    assert np.all(np.diff(least) <= 0.0)
    assert least[0] > 0.1
    fast = problem(MICROSAT.replace(rate_limit=2.0 * MICROSAT.rate_limit), "static")
    quiet = problem(MICROSAT.replace(gyro_noise_std=0.5 * MICROSAT.gyro_noise_std), "static")
    for better in (fast, quiet):
        assert 0.4 < least_std(only_mission(better), 100.0)[-1] / least[-1] < 0.8


def test_what_no_motion_can_tell_is_refused_with_what_would_do():
    with pytest.raises(
        NotPossibleError, match=r"noise leaves 3\.\de-05; it takes at least \d+ s, or a rate limit"
    ) as no:
        design("microsat", accuracy=2e-5, effort=QUICK)
    longer = float(re.search(r"at least (\d+) s", str(no.value))[1])
    faster = float(re.search(r"limit of ([\d.]+) rad", str(no.value))[1])
    world = problem("microsat", "static")
    assert least_std(only_mission(world), longer)[-1] <= 2e-5 < least_std(only_mission(world), 0.95 * longer)[-1]
    quick = problem(MICROSAT.replace(rate_limit=faster), "static")
    assert least_std(only_mission(quick), 300.0)[-1] <= 2e-5


def test_what_the_best_manoeuvre_does_not_reach_is_said_with_the_time_it_takes():
    with pytest.raises(
        NotPossibleError, match=r"30 s leaves [\d.e-]+ of a moment of inertia; (60|120|240) s of the same"
    ):
        design("microsat", duration=30.0, accuracy=2e-4, effort=QUICK)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"duration": -1.0}, "duration must be finite and more than 0"),
        (
            {"duration": 30.5},
            "duration must be a multiple of the scenario's decisions of 1 s and at most 20000 s, got 30.5",
        ),
        ({"duration": 1e9}, "at most 20000 s"),
        ({"duration": 5.0}, "duration must be at least 12 s, got 5: 8 decisions of 1 s, and 4 s to come to rest"),
        ({"duration": 60.0, "scenario": {"decision_period": 10.0}}, "duration must be at least 90 s"),
        ({"accuracy": 2.0}, "accuracy must be finite"),
        ({"turn_limit": 4.0}, "turn_limit must be finite"),
        ({"keep_outs": [{"boresight": [0, 0, 1], "direction": [0, 0, 1], "angle": 0.1}]}, "within its keep-out of 5.7"),
        ({"keep_outs": [{"boresight": [0, 0, 0], "direction": [0, 0, 1], "angle": 0.1}]}, "must have a length"),
        ({"satellite": ["cubesat", "microsat"]}, "designed for one data sheet"),
        ({"control": "momentum"}, "unknown control 'momentum'"),
        ({"scenario": "flex"}, "scenario 'flex' draws panels or a tank"),
    ],
)
def test_requests_that_cannot_be_are_refused(settings, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        design(**{"satellite": "microsat", "effort": QUICK, **settings})


def test_the_command_writes_table_record_picture_and_page(written):
    folder, out, error = written
    table = np.genfromtxt(folder / "manoeuvre.csv", delimiter=",", names=True)
    assert len(table) == 120
    assert table.dtype.names[:4] == ("time_s", "rate_x_rad_per_s", "rate_y_rad_per_s", "rate_z_rad_per_s")
    kept = json.loads((folder / "design.json").read_text())
    assert kept["flights"]["least_clearance_rad"][0] > 0.0
    np.testing.assert_allclose(
        table["rate_x_rad_per_s"], np.array(kept["manoeuvre"]["rate_rad_per_s"])[:, 0], rtol=1e-8
    )
    assert (folder / "design.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    page = (folder / "design.html").read_text()
    assert not re.findall(r'(?:src|href)="(?!data:)', page)
    assert str(folder) not in page + json.dumps(kept)
    assert f"--output {folder.name}" in kept["command"]
    assert re.search(r"^Jxx +[\d.e-]+ +[\d.]+ % +[\d.]+ %$", out, flags=re.M)
    assert "round 1 of 1" in error


@pytest.mark.parametrize("control", ["rate", "torque"])
def test_a_pilot_flies_the_file(written, control):
    path = written[0] / "design.json"
    plan = ManoeuvrePolicy.read(path).manoeuvre
    pilot = Pilot("microsat", ManoeuvrePolicy(plan), control=control, scenario={"horizon": 121.0})
    torque = pilot.start(0.0, np.zeros(3), np.zeros(3))
    limits, first = (
        (MICROSAT.rate_limit, plan.rate[0]) if control == "rate" else (MICROSAT.wheels.max_torque, plan.torque[0])
    )
    np.testing.assert_allclose(pilot._tasks[0]["command"] * limits, first, rtol=1e-6)
    if control == "torque":
        np.testing.assert_allclose(torque, first, rtol=1e-6)
    policy = ManoeuvrePolicy(plan)
    policy.reset(pilot.mission, [0])
    actions = [policy(np.zeros((2, 1))) for _ in range(121)]
    np.testing.assert_array_equal(actions[-1], 0.0)  # the manoeuvre is over
    assert np.abs(actions).max() > 0.1


@pytest.mark.parametrize(
    ("satellite", "scenario", "said"),
    [
        (PYRAMID, {}, "the manoeuvre is for 3 wheels, and microsat has 4"),
        (MICROSAT, {"decision_period": 2.0}, "commands every 1 s, and the scenario decides every 2 s"),
        (MICROSAT, {"horizon": 60.0}, "takes 120 s, and the flight ends at 60 s, before it is at rest"),
        (
            SATELLITES["cubesat"],
            {},
            r"for microsat with moments of inertia of [\d. ]+ kg m\^2, and cubesat has [\d. ]+:",
        ),
        (MICROSAT.replace(wheels=MICROSAT.wheels.replace(axes=-np.eye(3))), {}, "for the wheel axes of microsat"),
        (MICROSAT.replace(rate_limit=0.01), {}, "times the rate limit of microsat: design one for it"),
    ],
)
def test_a_manoeuvre_for_another_satellite_or_flight_is_refused(written, satellite, scenario, said):
    with pytest.raises(ValueError, match=said):
        Pilot(satellite, str(written[0] / "design.json"), control="rate", scenario=scenario)


def test_a_changed_data_sheet_is_told_and_a_file_without_one_flies_any(written, tmp_path, capsys):
    heavier = tmp_path / "heavier.json"
    heavier.write_text(json.dumps(MICROSAT.replace(inertia=1.2 * MICROSAT.inertia).to_dict()))
    flown = ["fly", "--policy", str(written[0] / "design.json"), "--control", "rate", "--inertia", "static"]
    assert main([*flown, "--satellite", str(heavier)]) == 0
    assert "note: designed for another data sheet of microsat; here differ: inertia" in capsys.readouterr().err
    assert main(flown) == 0
    assert not capsys.readouterr().err
    kept = json.loads((written[0] / "design.json").read_text())
    (tmp_path / "old.json").write_text(json.dumps({name: kept[name] for name in ("manoeuvre", "control")}))
    old = ManoeuvrePolicy.read(tmp_path / "old.json")
    assert (old.sheet, old.doubt(MICROSAT)) == (None, "")
    Pilot(SATELLITES["cubesat"].replace(rate_limit=1.0), old, control="rate")


def test_a_manoeuvre_for_another_control_is_refused(written):
    with pytest.raises(ValueError, match="was designed for control 'rate', and this is 'torque': give control 'rate'"):
        Pilot("microsat", str(written[0] / "design.json"))


def test_a_file_without_a_manoeuvre_is_refused(tmp_path, capsys):
    path = tmp_path / "other.json"
    for kept, said in (
        ({"time_s": [0.0, 1.0]}, "'torque_Nm'"),
        ({"time_s": [0.0, 1.0], "torque_Nm": 0.0}, "not subscriptable"),
        ({"time_s": [0.0, 1.0], "torque_Nm": [[0.0] * 3] * 2, "decision_period_s": 2.0}, "'rate_rad_per_s'"),
    ):
        path.write_text(json.dumps({"control": "rate", "manoeuvre": kept}))
        assert main(["fly", "--policy", str(path)]) == 2
        error = capsys.readouterr().err
        assert "holds no manoeuvre (" in error
        assert said in error
    assert main(["fly", "--policy", str(tmp_path / "none.json")]) == 2
    assert "is missing: satid design writes it" in capsys.readouterr().err


def test_the_command_says_no_and_names_a_word_that_is_wrong(tmp_path, capsys):
    assert main(["design", "microsat", "--accuracy", "1e-6", "--output", str(tmp_path)]) == 1
    assert capsys.readouterr().err.startswith("no: no manoeuvre of 300 s determines every moment of inertia to 1e-06")
    assert main(["design", "microsat", "--keep-out", "0,0,1:35", "--output", str(tmp_path)]) == 2
    assert "BORESIGHT:DIRECTION:DEGREES" in capsys.readouterr().err
    assert main(["design", "microsat", "--turn-limit", "200", "--output", str(tmp_path)]) == 2
    assert "--turn-limit must be finite and more than 0 and at most 180" in capsys.readouterr().err
    assert main(["design", "microsat", "--rounds", "0", "--output", str(tmp_path)]) == 2
    assert "rounds must be an integer of at least 1" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
