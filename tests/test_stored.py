"""The planners' stored figures: shown for the same episodes, marked with their revision, and never lost."""

import copy
import json

import pytest

from agents.benchmark import stored
from agents.benchmark.cell import Cell
from agents.benchmark.compare import Comparison, compare, main, stored_lines, write
from agents.benchmark.report.leaderboard import leaderboard
from agents.benchmark.report.page import page_data
from agents.benchmark.results import read_results
from agents.benchmark.summary.tables import print_comparison
from baselines.command.cli import exit_code
from satid_gym.files import DamagedFileError
from satid_gym.policies.registry import BASELINES, PLANNERS, make_baseline
from tests.cases import cases

CELL = {"satellites": ("cubesat",), "modes": ("static", "step"), "episodes": 2, "seed_split": "validation"}
SHORT = ("zero", "rate_square")


@pytest.fixture(scope="module")
def plain():
    """A comparison as compare.json has it, flown with two baselines in the place of all."""
    comparison = Comparison(**CELL, policies=SHORT)
    results = compare(comparison, comparison.entrants())
    results["settings"]["policies"] = []
    del results["curves"]
    return json.loads(json.dumps(results))


@pytest.fixture
def full(plain):
    """The same with records of the planners, as an earlier revision found them."""
    results = copy.deepcopy(plain)
    for rows in ("records", "efficiencies"):
        own = [row for row in results[rows] if row["policy"] == "rate_square"]
        results[rows] += [{**row, "policy": name} for name in PLANNERS for row in own]
    return {**results, "revision": "earlier"}


def find(tmp_path, old, new):
    file = tmp_path / "old" / "compare.json"
    file.parent.mkdir(exist_ok=True)
    file.write_text(json.dumps(old))
    return stored.find_stored([file], new)


def found(tmp_path, old, new):
    """Planners and satellites that are shown, and the notes as one text."""
    result = find(tmp_path, old, new)
    return {(r["policy"], r["satellite"]) for r in result["records"]}, " ".join(result["notes"])


def test_the_planners_are_those_that_plan():
    assert set(PLANNERS) == {"greedy", "greedy_horizon", "mpc"}
    assert all(make_baseline(name, "cubesat").kind == "closed_loop" for name in PLANNERS)


def test_a_plain_comparison_flies_all_but_the_planners_and_all_flies_them_too():
    def names(**settings):
        return [policy.name for policy in Comparison(**CELL, **settings).entrants().policies_for["cubesat"]]

    assert set(names(all=True)) - set(names()) == set(PLANNERS)
    assert set(names()) >= set(BASELINES) - set(PLANNERS) | {"generalist", "ppo"}
    assert names(policies=("mpc",)) == ["mpc"]  # named, a planner flies
    with pytest.raises(ValueError, match="either --policies or --all"):
        names(policies=("mpc",), all=True)


def test_figures_of_the_same_episodes_are_shown_with_their_revision(tmp_path, plain, full):
    result = find(tmp_path, full, plain)
    assert {r["policy"] for r in result["records"]} == set(PLANNERS)
    assert len(result["records"]) == len(result["efficiencies"]) == len(PLANNERS) * 2
    assert (result["revision"], result["notes"]) == ("earlier", [])
    assert "revision earlier" in stored_lines(result)[0]
    assert str(tmp_path) not in json.dumps(result)


@cases(
    ("change", "said"),
    [
        (lambda r: r["seeds"].update(count=3), "are of 3 validation seeds from 2000000000, not of 2"),
        (lambda r: r["seeds"].update(split="test", first=3_000_000_000), "are of 2 test seeds from 3000000000, not of"),
        (lambda r: r["scenario"].update(torque_noise=0.06), "are of another scenario"),
        (lambda r: r["scenario"].update(estimator="momentum"), "are of another scenario"),
        (lambda r: r["scenario"].update(faults={"gyro_bias_std": 1e-3}), "are of another scenario"),
        (lambda r: r["scenario"].update(new_setting=1.0), "are of a scenario that this version does not have"),
        (lambda r: r["definitions"]["satellites"]["cubesat"].update(rate_limit=0.06), "with other values"),
        (lambda r: r["definitions"]["satellites"].clear(), "do not have this satellite"),
        (lambda r: r["definitions"]["laws"].update(step={"mode": "step"}), "do not have the inertia 'step'"),
        (lambda r: r["settings"].update(tuned="my_tuned.json"), "other settings of the planners"),
        (lambda r: [x.update(reward=1.001 * x["reward"]) for x in r["records"]], "score differently now"),
    ],
)
def test_figures_of_other_episodes_are_never_shown(tmp_path, plain, full, change, said):
    full = copy.deepcopy(full)
    change(full)
    shown, notes = found(tmp_path, full, plain)
    assert not shown
    assert said in notes
    assert "--all flies the planners" in notes


def test_a_setting_that_satellites_have_had_since_voids_no_figures(tmp_path, plain, full):
    """Where it has its default."""
    full = copy.deepcopy(full)
    for satellite in full["definitions"]["satellites"].values():
        del satellite["sensors"]["star_tracker"]
    assert found(tmp_path, full, plain)[0]


def test_a_satellite_or_mode_that_was_not_flown_is_left_out_and_said(tmp_path, plain, full):
    plain = copy.deepcopy(plain)
    plain["settings"]["satellites"] = ["cubesat", "scout"]
    plain["definitions"]["satellites"]["scout"] = {"name": "scout"}
    shown, notes = found(tmp_path, full, plain)
    assert shown == {(name, "cubesat") for name in PLANNERS}
    assert "left out for scout: those of" in notes
    plain["settings"]["modes"] = ["static", "step", "drift"]
    shown, notes = found(tmp_path, full, plain)
    assert not shown  # means over the modes would be of other modes than the others'
    assert "do not have the inertia 'drift'" in notes


def test_other_policies_whose_figures_differ_are_named(tmp_path, plain, full):
    for r in full["records"]:
        if (r["policy"], r["inertia_mode"]) == ("rate_square", "step"):
            r["final_error_mean"] *= 1.0 + 1e-8
    shown, notes = found(tmp_path, full, plain)
    assert shown  # a policy may have been trained or tuned again
    assert "rate_square in 1 cells" in notes


def test_differences_of_a_billionth_are_none(plain):
    near = copy.deepcopy(plain["records"])
    for r in near:
        r["reward"] *= 1.0 + 1e-10
    assert stored.differing(plain["records"], near) == {}


def test_a_figure_that_older_results_lack_is_no_difference(tmp_path, plain, full, capsys):
    """The cost is newer than the stored figures of the planners, which the table then shows without one."""
    for r in full["records"]:
        del r["cost"]
    results = {**plain, "stored": find(tmp_path, full, plain)}
    assert results["stored"]["records"]
    shown = stored.with_stored(results)
    print_comparison(shown["records"], "", results["bounds"], results["efficiencies"])
    assert "mpc (stored)" in capsys.readouterr().out


@cases("text", ["", "[]", '{"records": []}', '{"records": [5], "efficiencies": []}'])
def test_a_damaged_file_gives_no_figures_but_a_note(tmp_path, plain, text):
    file = tmp_path / "compare.json"
    file.write_text(text)
    result = stored.find_stored([tmp_path / "missing.json", file], plain)
    assert result["records"] == []
    assert "compare.json" in " ".join(result["notes"])


def test_without_any_file_the_note_says_what_flies_them(tmp_path, plain):
    result = stored.find_stored([tmp_path / "missing.json"], plain)
    assert result["notes"] == [
        "no stored figures of greedy, greedy_horizon, mpc: python -m agents.compare --all flies the planners"
    ]


# what is shown


def test_stored_figures_are_marked_wherever_they_are_shown(tmp_path, plain, full, capsys):
    results = {**plain, "stored": find(tmp_path, full, plain)}
    shown = stored.with_stored(results)
    assert {r["policy"] for r in shown["records"]} == {*SHORT, *(f"{name} (stored)" for name in PLANNERS)}
    print_comparison(shown["records"], "", results["bounds"], results["efficiencies"])
    printed = capsys.readouterr().out
    assert printed.count("mpc (stored)") == 2
    assert "mpc " not in printed.replace("mpc (stored)", "")
    assert max(map(len, printed.splitlines())) <= 100
    rows = leaderboard(shown, "cubesat", "step")
    assert {row["decision_ms"] for row in rows if row.get("policy", "").endswith("(stored)")} == {None}
    data = page_data(results, {"time": [], "curves": [], "bounds": [], "episode": {}})
    assert {p["name"] for p in data["policies"] if p["stored"]} == {f"{name} (stored)" for name in PLANNERS}
    assert data["stored"]["revision"] == "earlier"
    assert not any("stored" in name for name in data["shown"])
    assert [r["policy"] for r in results["records"]] == ["rate_square", "zero"] * 2  # what was flown, alone


def test_damaged_stored_figures_are_refused(tmp_path, plain, full):
    file = tmp_path / "compare.json"
    good = find(tmp_path, full, plain)
    file.write_text(json.dumps({**plain, "stored": good}))
    read_results(file, "", keys=["records"])
    for bad in (5, {**good, "records": [5]}, {"records": []}):
        file.write_text(json.dumps({**plain, "stored": bad}))
        with pytest.raises(DamagedFileError, match="is damaged: "):
            read_results(file, "", keys=["records"])


# what is written


def test_a_plain_comparison_keeps_the_planners_figures_that_it_would_overwrite(tmp_path, plain, full):
    write(full, tmp_path)
    (tmp_path / "report.html").write_text("page")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    kept = stored.keep_planners(tmp_path, plain)
    assert kept == tmp_path / "all"
    assert {path.name: path.read_bytes() for path in kept.iterdir()} == before
    assert stored.keep_planners(tmp_path, plain) == kept  # the same once more is no second copy
    write(plain, tmp_path)
    assert stored.keep_planners(tmp_path, plain) is None
    files = stored.candidates(tmp_path, "default")
    assert stored.find_stored(files, plain)["revision"] == "earlier"  # and they are found again
    write({**full, "revision": "later"}, tmp_path)
    assert stored.keep_planners(tmp_path, plain) == tmp_path / "all-2"  # nothing kept is overwritten
    assert json.loads((kept / "compare.json").read_text())["revision"] == "earlier"
    assert stored.keep_planners(tmp_path, full) is None  # flown again, they replace the old


def test_the_command_shows_stored_figures_and_overwrites_none(tmp_path, plain, full, monkeypatch, capsys):
    """From the command line, with two baselines in the place of all: the episodes are those of `full`."""
    few = [name for name in BASELINES if name in (*SHORT, *PLANNERS)]
    monkeypatch.setattr("agents.benchmark.entrants.baselines_of", lambda scenario, control: few)
    monkeypatch.setattr("agents.benchmark.entrants.names", list)
    write(full, tmp_path)
    flown, original = [], Cell.start

    def start(pool, policies, **cell):
        flown.extend(policy.name for policy in policies)
        return original(pool, policies, **cell)

    monkeypatch.setattr(Cell, "start", start)
    line = "--satellites cubesat --modes static step --episodes 2 --seed-split validation --output"
    monkeypatch.setattr("sys.argv", ["compare", *line.split(), str(tmp_path)])
    assert exit_code(main) == 0
    assert set(flown) == set(SHORT)
    printed = capsys.readouterr().out
    assert "mpc (stored)" in printed
    assert "revision earlier" in " ".join(printed.split())
    new = json.loads((tmp_path / "compare.json").read_text())
    assert {r["policy"] for r in new["records"]} == set(SHORT)
    assert new["records"] == plain["records"]
    assert new["stored"]["records"] == [r for r in full["records"] if r["policy"] in PLANNERS]
    assert json.loads((tmp_path / "all" / "compare.json").read_text()) == full
