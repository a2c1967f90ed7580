"""The comparison: statistics by hand, what it writes, what it prints, what it refuses."""

import contextlib
import csv
import io
import json
import sys

import numpy as np
import pytest

from agents.benchmark import compare
from agents.benchmark.summary import tables
from agents.benchmark.summary.statistics import pair, record
from baselines.command import provenance
from baselines.command.cli import exit_code
from satid_gym import files
from tests.cases import cases

EPISODES = 6


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A small comparison from the command line: results, records of the CSV, and standard output."""
    folder = tmp_path_factory.mktemp("results")
    code, printed = call(
        f"--satellites microsat --modes static step --policies zero chirp rate_square --episodes {EPISODES} "
        f"--seed-split validation --output {folder}"
    )
    assert code == 0
    rows = list(csv.DictReader((folder / "compare.csv").open()))
    return json.loads((folder / "compare.json").read_text()), rows, printed


def call(line):
    """Exit code and standard output of `python -m agents.compare LINE`."""
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()) as output:
        patch.setattr(sys, "argv", ["compare", *line.split()])
        code = exit_code(compare.main)
    return code, output.getvalue()


def scores(final_error, **changed):
    n = len(final_error)
    values = {
        "final_error": final_error, "mean_error": [0.02] * n, "time_to_1pct_s": [3.0] * n,
        "outside_fraction": [0.01] * n, "information_nats": [100.0] * n, "nees": [1.0] * n, "effort": [0.5] * n,
        "saturated_fraction": [0.0] * n, "reward": [10.0] * n, "terminated": [False] * n,
        "cost": [0.02] * n,
    }  # fmt: skip
    return {name: np.array(value) for name, value in (values | changed).items()}


# statistics


def test_record_by_hand():
    r = record(scores([0.0, 0.01, 0.02, 0.09], terminated=[True, False, False, False], nees=[0.5, 1.5, 1.0, 1.0]))
    assert r["final_error_mean"] == pytest.approx(0.03)
    assert r["final_error_iqm"] == pytest.approx(0.015)
    assert r["final_error_lo"] < 0.03 < r["final_error_hi"]
    assert r["final_error_iqm_lo"] <= 0.015 <= r["final_error_iqm_hi"]
    assert (r["mean_error_lo"], r["mean_error_mean"], r["mean_error_hi"]) == (0.02, 0.02, 0.02)
    assert r["terminated_fraction"] == 0.25
    assert r["nees"] == 1.0
    assert (r["outside_fraction"], r["information_nats"], r["effort"], r["reward"]) == (0.01, 100.0, 0.5, 10.0)
    assert r["cost"] == 0.02


@cases(
    ("times", "median"),
    [([1.0, 2.0, np.inf], 2.0), ([1.0, np.inf, np.inf], None), ([1.0, 2.0, np.inf, np.inf], None)],
)
def test_time_to_one_percent_is_none_where_the_median_episode_never_gets_there(times, median):
    n = len(times)
    assert record(scores(np.linspace(0.1, 0.2, n), time_to_1pct_s=times))["time_to_1pct_s"] == median


def test_pair_by_hand():
    mine, theirs = [0.01, 0.02, 0.03, 0.04], [0.02, 0.02, 0.05, 0.03]
    p = pair(scores(mine), scores(theirs))
    assert p["probability_of_improvement"] == pytest.approx((1 + 0.5 + 1 + 0) / 4)
    assert p["difference_mean"] == pytest.approx((-0.01 + 0.0 - 0.02 + 0.01) / 4)
    assert p["difference_lo"] < p["difference_mean"] < p["difference_hi"]
    back = pair(scores(theirs), scores(mine))
    assert back["probability_of_improvement"] == pytest.approx(1.0 - p["probability_of_improvement"])
    assert back["difference_mean"] == pytest.approx(-p["difference_mean"])


def test_pairing_sees_what_scatter_between_episodes_hides():
    rng = np.random.default_rng(0)
    hard = rng.exponential(0.01, 100)  # how hard an episode is, the same for both
    better, worse = hard + rng.normal(0.0, 1e-4, 100), hard + 5e-4 + rng.normal(0.0, 1e-4, 100)
    one, other = record(scores(better)), record(scores(worse))
    assert one["final_error_hi"] > other["final_error_lo"]  # the intervals of the means overlap
    assert pair(scores(better), scores(worse))["difference_hi"] < -4e-4


# what it writes


def test_one_record_for_each_policy_and_cell(run):
    results, rows, _ = run
    found = [(r["policy"], r["satellite"], r["inertia_mode"]) for r in results["records"]]
    modes = ("static", "step")
    assert found == [(p, "microsat", mode) for mode in modes for p in ("chirp", "rate_square", "zero")]
    assert {r["policy"]: r["kind"] for r in results["records"]} == {
        "chirp": "scripted", "rate_square": "closed_loop", "zero": "reference",
    }  # fmt: skip
    assert all(r["episodes"] == EPISODES for r in results["records"])
    assert len(rows) == len(results["records"])
    for row, r in zip(rows, results["records"], strict=True):
        assert list(row) == list(r)
        assert row["policy"] == r["policy"]
        assert float(row["final_error_mean"]) == r["final_error_mean"]


def test_records_have_what_readers_were_promised(run):
    promised = (
        "policy kind satellite inertia_mode episodes final_error_mean final_error_lo final_error_hi "
        "final_error_iqm final_error_iqm_lo final_error_iqm_hi mean_error_mean mean_error_lo mean_error_hi "
        "time_to_1pct_s outside_fraction information_nats nees effort saturated_fraction terminated_fraction reward "
        "cost"
    )
    for r in run[0]["records"]:
        assert list(r) == promised.split()
        assert r["final_error_lo"] <= r["final_error_mean"] <= r["final_error_hi"]
        assert 0.0 < r["final_error_mean"] < 0.05  # a fraction, not per cent
    zero = next(r for r in run[0]["records"] if r["policy"] == "zero")
    assert zero["effort"] == 0.0


def test_closed_loop_is_paired_with_every_other_policy(run):
    pairs = run[0]["pairs"]
    assert [(p["policy"], p["other"], p["inertia_mode"]) for p in pairs] == [
        ("rate_square", other, mode) for mode in ("static", "step") for other in ("chirp", "zero")
    ]
    assert all(p["probability_of_improvement"] > 0.5 and p["difference_mean"] < 0.0 for p in pairs)


def test_results_say_where_they_come_from(run):
    results = run[0]
    assert results["command"].startswith("python -m agents.compare --satellites microsat --modes static step")
    assert results["seeds"] == {"split": "validation", "first": 2_000_000_000, "count": EPISODES}
    assert results["settings"]["episodes"] == EPISODES
    assert results["revision"]
    assert results["versions"]["numpy"] == np.__version__
    assert results["scenario"]["laws"]["step_size"] == [0.1, 0.1]


def test_the_same_command_gives_the_same_records(run, tmp_path):
    call(f"--satellites microsat --modes step --policies zero --episodes {EPISODES} --seed-split validation "
         f"--output {tmp_path}")  # fmt: skip
    (again,) = json.loads((tmp_path / "compare.json").read_text())["records"]
    before = [r for r in run[0]["records"] if (r["policy"], r["inertia_mode"]) == ("zero", "step")]
    assert [again] == before


def test_other_scenarios_have_files_of_their_own(tmp_path):
    code, printed = call(f"--scenario tight --satellites cubesat --modes drift --policies zero random --episodes 2 "
                         f"--output {tmp_path}")  # fmt: skip
    assert code == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "compare_tight.csv", "compare_tight.json", "report_data_tight.json", "report_tight.html",
    ]  # fmt: skip
    assert "scenario tight" in printed


# what it prints


def test_tables_fit_a_hundred_columns_and_name_their_source(run):
    _, _, printed = run
    lines = printed.splitlines()
    assert max(map(len, lines)) <= 100
    for policy in ("zero", "chirp", "rate_square"):
        assert sum(line.strip().startswith(policy) for line in lines) == 2
    flat = " ".join(printed.split())
    assert "validation seeds 2000000000 to 2000000005" in flat
    assert "python -m agents.compare" in flat
    assert "…" not in printed


@cases(
    ("fraction", "text"), [(0.0009876, ".099"), (0.00118, ".118"), (0.012345, "1.23"), (0.2, "20.0"), (1.0, "100.0")]
)
def test_percent(fraction, text):
    assert tables._percent(fraction) == text


def test_costs_above_a_hundredth_are_told():
    """Of a tank, say: rates and wheels are inside, which alone are in the table."""
    rows = [{"policy": name, "cost": cost} for name, cost in (("a", 0.25), ("a", 0.15), ("b", 0.01), ("c", 0.02))]
    rows += [{"policy": "old"}]  # of a revision without costs
    line = tables.cost_line(rows, ["b", "c", "a", "old"])
    assert line == (
        "mean cost above 1 % (largest of all limits, those of panels, tanks and payload too): c 2.00, a 20.00"
    )
    assert tables.cost_line(rows, ["b", "old"]) == ""


# what it refuses


@cases(
    ("line", "message"),
    [
        ("--satellites cubsat", "unknown satellite 'cubsat'; expected one of ['cubesat', 'innocube', 'microsat', "),
        ("--modes steps", "unknown inertia mode 'steps'"),
        ("--policies sinus", "unknown policy (no such file either) 'sinus'"),
        ("--scenario tihgt", "unknown scenario 'tihgt'"),
        ("--seed-split tests", "unknown split of seeds 'tests'"),
        ("--episodes 1", "episodes must be at least 2"),
    ],
)
def test_what_cannot_be_compared_is_one_line_and_exit_code_2(line, message, capsys, tmp_path):
    code, _ = call(f"{line} --output {tmp_path}")
    error = capsys.readouterr().err
    assert code == 2
    assert message in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


@cases(
    ("line", "said"),
    [
        (["--episodes", "5", "--output", "results/x"], "--episodes 5 --output results/x"),
        (["--output", "/somewhere/of one/file.json"], "--output file.json"),
        (["--output=/somewhere/file.json", "--name=a=b"], "--output=file.json --name=a=b"),
    ],
)
def test_a_command_names_no_place_of_this_machine(line, said, monkeypatch):
    monkeypatch.setattr(provenance.sys, "argv", ["compare.py", *line])
    assert provenance.command("agents.compare") == f"python -m agents.compare {said}"
    assert provenance.command("agents.train", line) == f"python -m agents.train {said}"


def test_a_failed_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "compare.json"
    files.write_json(path, {"old": 1})
    with pytest.raises(ValueError, match="not JSON compliant"):
        files.write_json(path, {"new": float("nan")})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(files.os, "replace", lambda *_: (_ for _ in ()).throw(OSError("disk is full")))
        with pytest.raises(OSError, match="disk is full"):
            files.write_json(path, {"new": 2})
    assert json.loads(path.read_text()) == {"old": 1}
    assert list(tmp_path.iterdir()) == [path]
