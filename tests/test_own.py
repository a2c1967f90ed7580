"""Satellites, scenarios, inertia laws and policies of one's own: from files and modules, in the environment and in
every command that flies, under names that tell results apart."""

from __future__ import annotations

import contextlib
import io
import json
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import satid_gym
from agents.benchmark import compare, evaluate
from agents.training import imitation, train
from agents.training.imitation import ImitationSettings
from agents.training.ppo import PPOSettings
from agents.viewer import record
from agents.viewer.rollout import Pairing
from baselines.command.cli import exit_code
from baselines.tuning import amplitudes, open_loop_design
from satid_gym import SATELLITES, SCENARIOS, InertiaLaw, Satellite
from satid_gym.evaluation import benchmark_scenario
from satid_gym.law_ranges import PAPER_LAWS
from satid_gym.policies import find
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.policies.registry import PLANNERS
from satid_gym.resolution import resolve_inertia, resolve_satellites, resolve_scenario
from tests.cases import cases

SCOUT = """
inertia = [2.0, 2.4, 1.8]
rate_limit = 0.04

[wheels]
inertia = 5e-4
max_torque = 0.03
max_speed = 600.0
"""
FUEL = "time,factor\n0,1\n10,0.95\n10.5,1.05\n"
CRAFTS = """
from satid_gym import InertiaLaw, Satellite, Scenario
from satid_gym.reaction_wheels import ReactionWheels

WHEELS = ReactionWheels(inertia=5e-4, max_torque=0.03, max_speed=600.0)
TILTED = Satellite("tilted", [[2.0, 0.2, 0.0], [0.2, 2.4, 0.0], [0.0, 0.0, 1.8]], WHEELS)
FLAT = Satellite("flat", [1.0, 1.1, 2.0], WHEELS)
PLAIN = {"inertia": [2.0, 2.4, 1.8], "wheels": WHEELS}
NUMBER = 3

def ringing():
    return InertiaLaw.sampled(lambda t: 1.0 + 0.01 * t / 30.0, horizon=30.0, period=5.0)

def short():
    return Scenario(name="brief", horizon=20.0)
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A user's folder, the current one."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scout.toml").write_text(SCOUT)
    (tmp_path / "fuel.csv").write_text(FUEL)
    (tmp_path / "brief.json").write_text(json.dumps({"horizon": 20.0}))
    (tmp_path / "crafts.py").write_text(CRAFTS)
    sys.modules.pop("crafts", None)
    return tmp_path


def call(module, line):
    """Exit code, standard output and standard error of a command."""
    errors = io.StringIO()
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(io.StringIO()) as output,
        contextlib.redirect_stderr(errors),
    ):
        patch.setattr(sys, "argv", ["command", *line.split()])
        code = exit_code(module.main)
    return code, output.getvalue(), errors.getvalue()


def save_policy(path, name="mine", seed=0):
    """A network that no one trained."""
    rng = np.random.default_rng(seed)
    layer = Network((0.1 * rng.standard_normal((3, 37)).astype(np.float32),), (np.zeros(3, np.float32),))
    LearnedPolicy(name, layer, "rate", 2.6).save(path)


# sources


@pytest.mark.interpreted
def test_the_environment_takes_files_and_modules():
    env = gymnasium.make("SatInertiaID-v0", satellite="scout.toml", inertia="fuel.csv", scenario="brief.json").unwrapped
    posed = env.problem
    assert (posed.satellites[0].name, posed.inertia.label, posed.scenario.name) == ("scout", "fuel", "brief")
    np.testing.assert_array_equal(np.diag(posed.satellites[0].inertia), [2.0, 2.4, 1.8])
    assert posed.scenario == SCENARIOS["default"].replace(name="brief", horizon=20.0)
    _, first = env.reset(seed=0)
    for _ in range(12):
        *_, info = env.step(np.zeros(3, np.float32))
    np.testing.assert_allclose(info["inertia_true"], 1.05 * first["inertia_true"], rtol=1e-12)
    both = satid_gym.SatInertiaIDVectorEnv(2, satellite=["crafts:TILTED", "microsat"], inertia="crafts:ringing")
    assert [s.name for s in both.problem.satellites] == ["tilted", "microsat"]
    assert both.problem.inertia.label == "ringing"


def test_modules_hold_objects_mappings_and_functions():
    assert resolve_satellites("crafts:PLAIN")[0].name == "PLAIN"
    assert resolve_scenario("crafts:short").horizon == 20.0
    law = resolve_inertia("crafts:ringing")
    assert (law.mode, law.name, len(law.times)) == ("table", "ringing", 7)


def test_a_scenario_file_starts_from_its_base(folder):
    (folder / "hard.toml").write_text('base = "tight"\nhorizon = 60.0\n')
    hard = resolve_scenario("hard.toml")
    assert hard == SCENARIOS["tight"].replace(name="hard", horizon=60.0)
    (folder / "hard.toml").write_text('base = "tigth"\n')
    with pytest.raises(ValueError, match=r"hard.toml: unknown base of a scenario 'tigth'.*Did you mean 'tight'"):
        resolve_scenario("hard.toml")


def test_the_benchmark_gives_paper_laws_to_scenarios_without_laws_of_their_own(folder):
    assert benchmark_scenario("brief.json").laws == PAPER_LAWS
    (folder / "wild.json").write_text(json.dumps({"laws": {"step_size": [0.4, 0.4]}}))
    assert benchmark_scenario("wild.json").laws.step_size == (0.4, 0.4)


def test_tables_of_tensors(folder):
    (folder / "boom.csv").write_text("time, xx, yy, zz\n0, 0, 0, 0\n50, 0.5, 0.4, 0.1\n")
    np.testing.assert_array_equal(resolve_inertia("boom.csv").values, [[0, 0, 0], [0.5, 0.4, 0.1]])
    (folder / "boom.csv").write_text("\ufefftime,xx,yy,zz,xy,xz,yz\n0,1,2,3,4,5,6\n")
    np.testing.assert_array_equal(resolve_inertia("boom.csv").values, [[[1, 4, 5], [4, 2, 6], [5, 6, 3]]])


def test_plain_values_of_a_law_are_a_file_of_it(folder):
    law = InertiaLaw("table", times=(0.0, 5.0), values=(1.0, 1.1), name="grown")
    (folder / "law.json").write_text(json.dumps(law.to_dict()))
    assert resolve_inertia("law.json") == law


@cases(
    ("file", "text", "words"),
    [
        ("x.toml", SCOUT.replace("max_speed", "max_sped"), ["x.toml", "'max_sped'", "Did you mean 'max_speed'?"]),
        ("x.toml", SCOUT.replace("rate_limit = 0.04", "rate_limit = -1"), ["x.toml", "rate_limit must be finite and"]),
        ("x.toml", "inertia = [1, 2", ["x.toml", "is not TOML"]),
        ("x.toml", "rate_limit = 0.04", ["x.toml", "Satellite needs a value for 'inertia'"]),
        ("x.json", "{1}", ["x.json", "is not JSON"]),
        ("x.json", "[1]", ["x.json", "must be an object of JSON"]),
        ("x.json", None, ["x.json", "there is no such file"]),
        ("x.json", "{}", ["x.json", "needs a value for"]),
    ],
)
def test_what_is_wrong_in_a_file_is_said_with_its_name_and_key(folder, file, text, words):
    (folder / file).unlink(missing_ok=True)
    if text is not None:
        (folder / file).write_text(text)
    with pytest.raises(ValueError, match=r"^Satellite x\.") as error:
        resolve_satellites(file)
    for word in words:
        assert word in str(error.value)


@cases(
    ("text", "message"),
    [
        ("", "the first line must name the columns time, factor; or time, xx, yy, zz; or .*; got nothing"),
        ("time,force\n0,1\n", "got time, force"),
        ("time,factor\n0\n", "row 2 has 1 columns, not 2"),
        ("time,factor\n0,1\n1,one\n", "row 3 has an entry that is not a number: .*'one'"),
        ("time,factor\n1,1\n0,1\n", "times of the inertia law must be .* with 0 after 1"),
    ],
)
def test_what_is_wrong_in_a_table_is_said(folder, text, message):
    (folder / "law.csv").write_text(text)
    with pytest.raises(ValueError, match=f"InertiaLaw law.csv: .*{message}"):
        resolve_inertia("law.csv")


@cases(
    ("text", "message"),
    [
        ("constants:TILTED", "cannot import constants"),
        ("crafts:TILTD", "unknown name in crafts 'TILTD'.*Did you mean 'TILTED'"),
        ("crafts:NUMBER", "must be a Satellite, a mapping of its settings or a function that returns one"),
        ("scuot", "unknown satellite 'scuot'.* Or the path of a .json or .toml file, or module:name"),
    ],
)
def test_what_is_wrong_in_a_module_is_said(text, message):
    with pytest.raises(ValueError, match=message):
        resolve_satellites(text)


def test_reading_a_file_runs_no_code(folder):
    """Only module:name imports: a file that looks like code is refused as data."""
    (folder / "crafts.json").write_text(CRAFTS)
    with pytest.raises(ValueError, match="is not JSON"):
        resolve_satellites("crafts.json")
    assert "crafts" not in sys.modules


# the comparison


def test_compare_flies_what_is_ones_own_and_keeps_it_in_full(folder):
    save_policy(folder / "runs" / "ppo-2" / "policy", "ppo-mine")
    code, printed, errors = call(
        compare,
        "--scenario brief.json --satellites scout.toml crafts:FLAT --modes fuel.csv step --episodes 2 "
        "--policies runs/ppo-2 other=runs/ppo-2/policy zero --output out",
    )
    assert code == 0, errors
    results = json.loads((folder / "out" / "compare_brief.json").read_text())
    assert {r["policy"] for r in results["records"]} == {"ppo-mine", "other", "zero"}
    assert {r["satellite"] for r in results["records"]} == {"scout", "flat"}
    assert {r["inertia_mode"] for r in results["records"]} == {"fuel", "step"}
    assert "scout: final error" in printed
    settings, made = results["settings"], results["definitions"]
    assert (settings["scenario"], settings["satellites"], settings["modes"]) == (
        "brief", ["scout", "flat"], ["fuel", "step"]
    )  # fmt: skip
    assert Satellite.from_dict(made["satellites"]["scout"]) == resolve_satellites("scout.toml")[0]
    assert InertiaLaw.from_dict(made["laws"]["fuel"]) == resolve_inertia("fuel.csv")
    assert results["scenario"]["horizon"] == 20.0
    assert len(made["policies"]["ppo-mine"]["sha256"]) == 64
    everything = (folder / "out" / "compare_brief.json").read_text() + (
        folder / "out" / "report_brief.html"
    ).read_text()
    assert str(folder) not in everything


def test_absolute_paths_stay_out_of_results(folder):
    code, _, errors = call(
        compare,
        f"--scenario {folder}/brief.json --satellites {folder}/scout.toml --modes {folder}/fuel.csv --episodes 2 "
        f"--policies zero random --output {folder}/out",
    )
    assert code == 0, errors
    for path in (folder / "out").iterdir():
        assert str(folder) not in path.read_text(), path.name


def test_baselines_that_have_no_settings_are_left_out_with_the_command_that_finds_them():
    entrants = compare.Comparison(satellites=("scout.toml", "cubesat"), episodes=2, all=True).entrants()
    names = {satellite: {policy.name for policy in team} for satellite, team in entrants.policies_for.items()}
    assert {"generalist", "mpc", "greedy", "random", "zero"} <= names["scout"]
    missing = names["cubesat"] - names["scout"]
    assert {"sine", "open_loop_optimal"} <= missing
    assert "rate_square" in names["scout"]
    lines = [line for line in entrants.not_tuned if "'scout'" in line]
    assert len(lines) == len(missing | {"rate_square", *PLANNERS})
    assert entrants.definitions()["not_tuned"] == entrants.not_tuned
    said = "\n".join(lines)
    assert said.count("(meanwhile it flies with its default margin)") == len(PLANNERS)
    assert said.count("(meanwhile its settings are made of the data sheet)") == 1
    assert (
        "rate_square has no settings for satellite 'scout' in scenario 'default': run python -m baselines.tune "
        "--satellites scout.toml --scenarios default --output my_tuned.json and add --tuned my_tuned.json"
    ) in said
    assert "python -m baselines.tuning.open_loop_design --satellites scout.toml" in said


def test_what_is_not_tuned_is_one_short_note_for_each_command():
    entrants = compare.Comparison(satellites=("scout.toml", "microsat"), scenario="brief.json", episodes=2).entrants()
    assert len(entrants.not_tuned) > 10
    tune, design = entrants.notes()
    assert tune.startswith("not tuned for scout, microsat (left out: ")
    assert "; with default settings: rate_square): run" in tune
    assert tune.endswith(
        ": run python -m baselines.tune --satellites scout.toml microsat --scenarios brief.json --output my_tuned.json "
        "and add --tuned my_tuned.json"
    )
    assert all(tune.count(f" {name}") == 1 for name in ("rate_square", "chirp"))
    assert "(left out: open_loop_optimal): run python -m baselines.tuning.open_loop_design" in design


@cases(
    ("module", "line"),
    [
        (compare, "--policies sine zero --satellites scout.toml --episodes 2"),
        (evaluate, "generalist --satellites scout.toml --episodes 2 --against sine"),
        (record, "generalist --satellite scout.toml --against sine"),
    ],
)
def test_a_baseline_that_was_asked_for_and_has_no_settings_is_refused_with_the_command(module, line):
    code, _, errors = call(module, line)
    assert code == 2
    assert errors.count("\n") == 1
    assert "python -m baselines.tune --satellites scout.toml --scenarios default --output my_tuned.json" in errors
    assert "--tuned my_tuned.json" in errors


def test_the_square_wave_flies_any_satellite_and_the_evaluation_says_that_it_is_not_tuned(tmp_path):
    code, printed, errors = call(evaluate, "generalist --satellites scout.toml --modes static --episodes 2")
    assert code == 0, errors
    said = " ".join(printed.split())
    assert "not tuned for scout (with default settings: rate_square): run python -m baselines.tune" in said


def few(monkeypatch):
    """Tuning and design in seconds: few settings, a small search."""
    monkeypatch.setattr(
        amplitudes, "grid", lambda name, *_: [[_SETTINGS[name]]] if name in _SETTINGS else [[{"amplitude": 0.02}]]
    )


_SETTINGS = {
    "rate_square": {"period": 20.0, "margin": 2.5},
    "staggered_square": {"amplitude": 0.02, "period": 24.0},
    **{name: {"margin": 2.5} for name in PLANNERS},
}


def test_tuned_and_designed_for_a_satellite_of_ones_own(folder, monkeypatch):
    few(monkeypatch)
    line = "--satellites scout.toml --scenarios brief.json --episodes 2"
    assert call(amplitudes, f"{line} --output my_tuned.json")[0] == 0
    assert call(open_loop_design, f"{line} --population 4 --elite 2 --rounds 1 --output my_designs.json")[0] == 0
    flown = "--satellites scout.toml --scenario brief.json --modes step --episodes 2 --output out"
    prepared = "--tuned my_tuned.json --designs my_designs.json"
    code, _, errors = call(compare, f"{flown} --policies rate_square open_loop_optimal sine {prepared}")
    assert code == 0, errors
    results = json.loads((folder / "out" / "compare_brief.json").read_text())
    assert {r["policy"] for r in results["records"]} == {"rate_square", "open_loop_optimal", "sine"}
    assert (results["settings"]["tuned"], results["settings"]["designs"]) == ("my_tuned.json", "my_designs.json")
    own = compare.Prepared(tuned=Path("my_tuned.json"), designs=Path("my_designs.json"))
    everything = compare.Comparison(
        satellites=("scout.toml",), scenario="brief.json", prepared=own, episodes=2, all=True
    )
    entrants = everything.entrants()
    assert not entrants.not_tuned
    (folder / "scout.toml").write_text(SCOUT.replace("2.4", "2.5"))
    code, _, errors = call(compare, f"{flown} --policies rate_square {prepared}")
    assert code == 2
    assert "my_tuned.json was made for another scout than that of scout.toml: run python -m baselines.tune" in errors


@pytest.mark.parametrize("module", [amplitudes, open_loop_design])
def test_what_is_found_for_one_satellite_leaves_the_settings_of_others(module, folder, monkeypatch):
    few(monkeypatch)
    monkeypatch.setattr(amplitudes, "tunable", lambda: ["one_step", "mpc"])
    small = "--population 4 --elite 2 --rounds 1" if module is open_loop_design else ""
    line = f"--scenarios brief.json --output found.json {small} --episodes"

    def found(more):
        code, _, errors = call(module, f"{line} {more}")
        assert code == 0, errors
        made = json.loads((folder / "found.json").read_text())
        return {(e.get("policy"), e["satellite"]): e for e in made["entries"]}, made["definitions"]["satellites"]

    first, _ = found("2 --satellites scout.toml cubesat")
    old = json.loads((folder / "found.json").read_text())
    old["revision"] = "a1"
    for entry in old["entries"]:
        del entry["revision"]  # as files of before had none
    (folder / "found.json").write_text(json.dumps(old))
    second, defined = found("3 --satellites cubesat")
    assert second.keys() == first.keys()
    assert set(defined) == {"scout"}
    for key, entry in second.items():
        if key[1] == "scout":
            assert entry == {**first[key], "revision": "a1"}
        else:
            assert (entry["revision"], entry["episodes"]) == (first[key]["revision"], 1 if key[0] == "mpc" else 3)
    (folder / "scout.toml").write_text(SCOUT.replace("2.4", "2.5"))
    third, _ = found("2 --satellites scout.toml --scenarios default")
    assert {key: e["scenario"] for key, e in third.items() if key[1] == "scout"} == dict.fromkeys(
        (key for key in first if key[1] == "scout"), "default"
    ), "the other scout's are void"
    (folder / "found.json").write_text("[]")
    code, _, errors = call(module, f"{line} 2 --satellites cubesat")
    assert code == 2
    assert "found.json holds no entries: give another --output" in errors


@pytest.mark.parametrize("module", [amplitudes, open_loop_design])
def test_what_is_ones_own_does_not_go_into_the_shipped_settings(module):
    code, _, errors = call(module, "--satellites scout.toml")
    assert code == 2
    assert "scout would replace the settings that are shipped: add --output FILE.json" in errors


def test_learned_policies_that_do_not_fit_a_satellite_are_left_out_or_refused():
    """A satellite with products of inertia has six parameters, the shipped policies were trained for three."""
    entrants = compare.Comparison(satellites=("crafts:TILTED",), episodes=2, all=True).entrants()
    assert {policy.name for policy in entrants.policies_for["tilted"]} >= {"mpc", "zero"}
    assert not {"generalist", "ppo"} & {policy.name for policy in entrants.policies_for["tilted"]}
    assert any("'tilted': policy generalist takes observations of" in line for line in entrants.not_tuned)
    code, _, errors = call(evaluate, "generalist --against zero --satellites crafts:TILTED --episodes 2")
    assert (code, errors.count("\n")) == (2, 1)
    assert "policy generalist takes observations of" in errors


# names


def test_a_satellite_with_the_name_of_another_is_refused(folder):
    (folder / "microsat.toml").write_text(SCOUT)
    (folder / "other.toml").write_text('name = "scout"\n' + SCOUT)
    for line, words in (
        ("--satellites microsat.toml", "'microsat' is the name of another satellite, in the catalogue: give"),
        ("--satellites scout.toml other.toml", "two satellites have the name 'scout', which identifies results: give"),
        ("--satellites microsat microsat", "two satellites have the name 'microsat'"),
    ):
        code, _, errors = call(compare, f"{line} --policies zero --episodes 2")
        assert (code, errors.count("\n")) == (2, 1)
        assert words in errors


def test_the_catalogues_own_values_may_have_its_name(folder):
    (folder / "copy.json").write_text(json.dumps(SATELLITES["microsat"].to_dict()))
    entrants = compare.Comparison(satellites=("copy.json",), policies=("sine",)).entrants()
    assert [policy.name for policy in entrants.policies_for["microsat"]] == ["sine"]


def test_a_scenario_with_the_name_of_another_is_refused(folder):
    (folder / "default.json").write_text(json.dumps({"horizon": 20.0}))
    (folder / "bad.json").write_text(json.dumps({"name": "../up", "horizon": 20.0}))
    for file, words in (("default.json", "'default' is the name of another scenario"), ("bad.json", "got '../up'")):
        code, _, errors = call(compare, f"--scenario {file} --policies zero --episodes 2")
        assert code == 2
        assert words in errors


def test_a_law_with_the_name_of_a_mode_is_refused(folder):
    (folder / "step.csv").write_text(FUEL)
    code, _, errors = call(compare, "--modes step.csv --policies zero --episodes 2")
    assert code == 2
    assert "'step' is the name of another inertia law" in errors


def test_policies_with_one_name_are_refused_with_the_way_out(folder):
    for name in ("one", "two"):
        save_policy(folder / name, "mine", seed=len(name))
    save_policy(folder / "chirp_like", "chirp")
    save_policy(folder / "general", "generalist")
    for texts, words in (
        ("one two", "two policies have the name 'mine': tell them apart by NAME=two"),
        (
            "chirp_like zero",
            "the policy of chirp_like has the name 'chirp', and so has one that comes with the project",
        ),
        ("general zero", "give it another one, NAME=general"),
        ("zero=one zero", "has the name 'zero'"),
    ):
        code, _, errors = call(compare, f"--policies {texts} --episodes 2")
        assert (code, errors.count("\n")) == (2, 1)
        assert words in errors
    entrants = compare.Comparison(policies=("one", "other=two", "chirped=chirp_like")).entrants()
    assert [policy.name for policy in entrants.policies_for["cubesat"]] == ["mine", "other", "chirped"]
    code, _, errors = call(record, "one --against two")
    assert code == 2
    assert "both policies have the name 'mine': tell them apart by NAME=PATH, say other=two" in errors


def test_find_takes_a_runs_folder_and_another_name(folder):
    save_policy(folder / "runs" / "ppo-2" / "policy", "ppo")
    assert find("runs/ppo-2").name == "ppo"
    assert find("mine=runs/ppo-2").name == "mine"
    with pytest.raises(ValueError, match="a policy's name is up to 64 letters"):
        find("no name=runs/ppo-2")
    with pytest.raises(ValueError, match="no such file either"):
        find("mine=runs/ppo-3")


# other commands


def test_evaluate_flies_ones_own(folder):
    save_policy(folder / "mine")
    code, printed, errors = call(
        evaluate, "mine --against zero --satellites scout.toml --modes fuel.csv --scenario brief.json --episodes 2"
    )
    assert code == 0, errors
    assert "scout: final error" in printed
    assert "scenario brief" in printed


def test_a_pairing_flies_ones_own():
    pairing = Pairing(
        policy="zero", against="random", satellite="scout.toml", inertia="fuel.csv", scenario="brief.json", horizon=12.0
    )
    first, second = pairing.rollouts()
    for _ in range(12):
        first.step()
        second.step()
    assert first.over
    np.testing.assert_array_equal(first.info["inertia_true"], second.info["inertia_true"])
    assert pairing.title == "scout, fuel inertia"


@pytest.mark.parametrize("kind", [PPOSettings, ImitationSettings])
def test_a_run_keeps_what_it_was_started_with(kind, folder):
    settings = kind(satellite="scout.toml", inertia="fuel.csv", scenario="brief.json")
    kept = json.loads(json.dumps(settings.to_dict()))
    assert kept["satellite"] == resolve_satellites("scout.toml")[0].to_dict()
    assert kept["inertia"]["times"] == [0.0, 10.0, 10.5]
    assert kept["scenario"]["horizon"] == 20.0
    for file in ("scout.toml", "fuel.csv", "brief.json"):
        (folder / file).unlink()
    again = kind.from_dict(kept)
    assert again == settings
    assert again.satellites[0].name == "scout"


def test_training_on_ones_own_goes_on_though_the_file_has_changed(folder):
    line = (
        "--satellite scout.toml --inertia fuel.csv --scenario brief.json --num-envs 4 --rollout 10 --batch-size 40 "
        "--evaluation-episodes 2 --evaluate-every 40 --run runs/mine"
    )
    assert call(train, f"{line} --steps 40")[0] == 0
    head = json.loads((folder / "runs" / "mine" / "run.json").read_text())
    assert head["settings"]["satellite"]["name"] == "scout"
    (folder / "scout.toml").write_text("changed")
    assert call(train, "--run runs/mine --resume")[0] == 0
    trained = find("runs/mine").details["trained"]["settings"]
    assert trained["satellite"] == head["settings"]["satellite"]
    assert str(folder) not in (folder / "runs" / "mine" / "run.json").read_text()


def test_training_refuses_a_satellite_with_the_name_of_another(folder):
    (folder / "microsat.toml").write_text(SCOUT)
    for command in (train, imitation):
        code, _, errors = call(command, "--satellite microsat.toml")
        assert code == 2
        assert "'microsat' is the name of another satellite" in errors
