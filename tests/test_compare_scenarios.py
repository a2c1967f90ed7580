"""Comparison in every scenario that has a name: a table is printed, with bounds where there are any."""

import json
import sys

import numpy as np
import pytest

from agents.benchmark import compare, evaluate
from agents.benchmark.entrants import entrant
from agents.benchmark.report.episode import fly_episode
from agents.dataset.collection import Collection, policy_for
from baselines.command.cli import exit_code
from baselines.scenarios.tune import tuned
from baselines.studies.performance_bound import lacks_bound, performance_bound
from satid_gym.evaluation import benchmark_scenario, fly, seeds
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.policies.learned.shipped import find, rate_names
from satid_gym.policies.reference import ZeroPolicy
from satid_gym.policies.registry import RATE_BASELINES
from satid_gym.problem import problem
from satid_gym.satellite import SATELLITES
from satid_gym.scenario_catalogue import SCENARIOS
from tests.cases import cases
from tests.test_compare import call

BOUNDED = {"default", "tight", "wheels4"}


@cases("scenario", SCENARIOS)
def test_every_scenario_has_a_table(scenario, tmp_path):
    """Panels and tanks draw several data sheets a satellite, which the bound once took for one after all flights."""
    code, printed = call(
        f"--scenario {scenario} --satellites microsat --modes static --policies zero random --episodes 2 "
        f"--seed-split validation --output {tmp_path}"
    )
    assert code == 0
    assert "zero" in printed
    assert "random" in printed
    (path,) = tmp_path.glob("compare*.json")
    results = json.loads(path.read_text())
    assert len(results["records"]) == 2
    assert {row["policy"] for row in results["bounds"]} == (
        {"bound", "reference_limit"} if scenario in BOUNDED else set()
    )


@cases("scenario", ["default", "flex", "slosh"])
def test_the_shown_episode_is_the_one_that_was_flown(scenario):
    """With panels and tanks, the episode of the data sheet that its seed draws."""
    (seed,) = seeds("validation", 1, offset=5)
    world = benchmark_scenario(scenario)
    episode = fly_episode([ZeroPolicy()], satellite="microsat", mode="step", seed=seed, scenario=world)
    flight = fly(ZeroPolicy(), satellite="microsat", inertia="step", seeds=[seed], scenario=world)
    assert episode["time"][-1] == flight.time[-1]
    np.testing.assert_allclose(episode["flights"][0]["error"][-1], flight.error[-1, 0], rtol=1e-3)


@cases("name", rate_names())
def test_policies_that_command_body_rates_are_told_where_they_are_compared(name, capsys, monkeypatch):
    for module, line in ((compare, ["--policies", name, "zero"]), (evaluate, [name])):
        monkeypatch.setattr(sys, "argv", ["command", *line, "--satellites", "microsat", "--scenario", "flex"])
        assert exit_code(module.main) == 2
        said = capsys.readouterr().err
        assert said.startswith(f"error: {name}: observes the body and commands body rates")
        assert "add --control rate" in said
        assert said.count("\n") == 1


def test_by_body_rates_tuned_laws_fly_next_to_a_policy_that_commands_them(monkeypatch, capsys, tmp_path):
    line = f"--scenario flex --satellites microsat --modes static --episodes 2 --control rate --output {tmp_path}"
    assert call(f"{line} --seed-split validation --policies tank_tour shaped_square")[0] == 0
    results = json.loads((tmp_path / "compare_flex_rate.json").read_text())
    found = {record["policy"]: record["mean_error_mean"] for record in results["records"]}
    assert found.keys() == {"tank_tour", "shaped_square"}
    cell = {"satellite": "microsat", "inertia": "static", "scenario": benchmark_scenario("flex")}
    law = tuned("flex", "microsat")["shaped_square"][1]
    for name, policy in (("tank_tour", find("tank_tour")), ("shaped_square", law)):
        direct = fly(policy, control="rate", seeds=seeds("validation", 2), **cell).scores()["mean_error"].mean()
        assert found[name] == pytest.approx(direct)
    monkeypatch.setattr(sys, "argv", ["evaluate", "tank_tour", *line.split()[:-2], "--against", "spared_square"])
    assert exit_code(evaluate.main) == 0
    assert "spared_square" in capsys.readouterr().out


def test_what_is_not_tuned_by_body_rates_flies_with_its_default_and_says_so(tmp_path):
    (tmp_path / "mine.json").write_text(json.dumps({"base": "flex", "horizon": 60.0}))
    line = f"--scenario {tmp_path / 'mine.json'} --satellites microsat --modes static --episodes 2 --control rate"
    code, printed = call(f"{line} --seed-split validation --policies zero rate_square corner_tour --output {tmp_path}")
    assert code == 0
    words = " ".join(printed.split())
    where = "has no settings by body rates for satellite 'microsat' in scenario 'mine' (meanwhile"
    assert f"corner_tour {where} it flies with its default settings)" in words
    assert f"rate_square {where} its settings are made of the data sheet)" in words
    assert call(f"{line} --policies prbs --output {tmp_path}")[0] == 2


def test_a_law_of_another_scenario_flies_by_rates_with_its_default(tmp_path):
    law = next(name for name in RATE_BASELINES if name.endswith("square") and name not in tuned("tight", "microsat"))
    line = f"--scenario tight --satellites microsat --modes static --episodes 2 --control rate --output {tmp_path}"
    code, printed = call(f"{line} --seed-split validation --policies {law} zero")
    assert code == 0
    assert f"{law} has no settings by body rates" in " ".join(printed.split())


def test_in_a_scenario_of_ones_own_the_laws_that_do_not_fit_are_left_out(tmp_path, capsys):
    (tmp_path / "mine.json").write_text(json.dumps({"base": "default", "horizon": 30.0}))
    line = f"--scenario {tmp_path / 'mine.json'} --satellites microsat --modes static --episodes 2 --control rate"
    code, printed = call(f"{line} --seed-split validation --output {tmp_path}")
    assert code == 0
    words = " ".join(printed.split())
    assert "left out: satellite 'microsat': the attitude is not observed: swing_and_stop" in words
    found = json.loads((tmp_path / "compare_mine_rate.json").read_text())["records"]
    assert {"rate_square", "corner_tour", "rigid_tour", "zero"} <= {record["policy"] for record in found}
    assert call(f"{line} --policies swing_and_stop --output {tmp_path}")[0] == 2
    assert "the attitude is not observed" in capsys.readouterr().err


def test_a_law_by_body_rates_is_told_so_by_torque(capsys):
    assert call("--scenario flex --satellites microsat --policies shaped_square")[0] == 2
    assert "shaped_square commands body rates: add --control rate" in capsys.readouterr().err


def test_a_policy_is_evaluated_among_panels(monkeypatch, capsys, tmp_path):
    """One that was trained there, with the covariance of the modes."""
    layer = Network((np.zeros((3, 130), np.float32),), (np.ones(3, np.float32),))
    LearnedPolicy("mine", layer, "rate", 2.6, include_covariance=True).save(tmp_path / "mine")
    line = [
        str(tmp_path / "mine"),
        "--scenario",
        "flex",
        "--satellites",
        "microsat",
        "--modes",
        "static",
        "--episodes",
        "2",
    ]
    monkeypatch.setattr(sys, "argv", ["evaluate", *line, "--against", "sine"])
    assert exit_code(evaluate.main) == 2
    assert capsys.readouterr().err.endswith("; or fly another next to it, such as --against zero\n")
    monkeypatch.setattr(sys, "argv", ["evaluate", *line, "--against", "zero"])
    assert exit_code(evaluate.main) == 0
    assert "mine" in capsys.readouterr().out


def test_a_baseline_is_no_learned_policy():
    with pytest.raises(ValueError, match=r"'zero' is a baseline.*'rigid_tour'.*--against zero") as refusal:
        entrant("zero")
    assert "Did you mean" not in str(refusal.value)
    with pytest.raises(ValueError, match=r"unknown policy .* 'tank_tuor'.*Did you mean 'tank_tour'"):
        entrant("tank_tuor")


@cases(
    ("world", "reason"),
    [
        ({}, ""),
        ({"tolerances": {"gyro_bias": 1e-4}}, "tolerances in the data sheet"),
        ({"sensors": {"gyro_integrates": True}}, "sensors off nominal or a star tracker"),
        ({"faults": {"gyro_dropout": 0.1}}, "faults"),
    ],
)
def test_what_the_bound_takes_no_account_of_is_named(world, reason):
    assert lacks_bound(problem("microsat", "static", world)) == reason


def test_a_satellite_with_panels_has_no_bound():
    with pytest.raises(ValueError, match=r"no account of panels or tanks.*'microsat'"):
        performance_bound("microsat", "static", [0, 1], benchmark_scenario("flex"))


def test_a_data_set_by_rates_has_the_laws_that_are_tuned_for_each_satellite():
    asked = Collection(policies=("swing_and_stop",), scenario="calibration", control="rate")
    for satellite in ("cubesat", "microsat"):
        settings, _ = tuned("calibration", satellite)["swing_and_stop"]
        law = policy_for(asked, "swing_and_stop", SATELLITES[satellite])
        assert {name: getattr(law, name) for name in settings} == settings
