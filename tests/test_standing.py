"""Standings of a comparison: who is compared with whom, and how the reward ranks policies."""

import json

import numpy as np
import pytest
from PIL import Image

from agents.benchmark.summary.ranking import ranks, standings
from agents.docs import readme, results_tables, reward_figure
from tests.cases import cases

COMMAND = "python -m agents.compare --output results"


def record(policy, kind, mode, error, *, reward=0.0, **changed):
    cell = {"policy": policy, "kind": kind, "satellite": "s", "inertia_mode": mode, "reward": reward}
    errors = {f"final_error_{end}": factor * error for end, factor in (("lo", 0.9), ("mean", 1.0), ("hi", 1.1))}
    return {**cell, **errors, "mean_error_mean": error, "outside_fraction": 0.0, "saturated_fraction": 0.0, **changed}


def match(mode, low, high, other="mpc"):
    cell = {"policy": "net", "other": other, "satellite": "s", "inertia_mode": mode}
    return {**cell, "difference_mean": (low + high) / 2.0, "difference_lo": low, "difference_hi": high}


def comparison(**outside):
    """Two modes: in the first the sine is beyond the envelope, by rates or by wheels, in the second it is inside."""
    flown = [("static", outside or {"outside_fraction": 0.011}), ("step", {})]
    records = [
        r
        for mode, sine in flown
        for r in (
            record("sine", "scripted", mode, 0.02, reward=3.0, **sine),
            record("mpc", "closed_loop", mode, 0.005, reward=1.0),
            record("net", "learned", mode, 0.004, reward=2.0),
            record("zero", "reference", mode, 0.1, reward=0.5),
        )
    ]
    pairs = [match("static", -0.002, -0.0001), match("step", -0.002, 0.0001)]
    return {"records": records, "pairs": pairs, "revision": "r", "command": COMMAND}


TIMES = {"mpc": {"alone": 1.0, "side_by_side": 2.0}, "net": {"alone": 0.1, "side_by_side": 0.02}}
TIMING = {"episodes": 100, "decision_ms": TIMES}


@cases("beyond", ["outside_fraction", "saturated_fraction"])
def test_who_is_outside_the_envelope_is_not_compared_with(beyond):
    static, step = standings(comparison(**{beyond: 0.011}), "net")
    assert (static.profile, static.over_profile) == (None, None)
    assert static.over_any_profile == pytest.approx(0.2)
    assert (step.profile, step.over_profile) == ("sine", pytest.approx(0.2))
    assert (static.rank, step.rank) == (1, 1)


def test_a_policy_outside_has_no_rank():
    results = comparison()
    results["records"] = [{**r, "outside_fraction": 0.5} if r["policy"] == "net" else r for r in results["records"]]
    assert [(s.inside, s.rank) for s in standings(results, "net")] == [(False, None)] * 2


def test_the_paired_interval_says_whether_it_is_lower_or_level():
    assert [s.against_loop for s in standings(comparison(), "net")] == ["lower", "level"]


def test_an_unknown_policy_is_refused():
    with pytest.raises(ValueError, match="unknown policy of the comparison 'nett'"):
        standings(comparison(), "nett")


def test_the_claims_say_who_is_inside_and_of_how_many_episodes_the_times_are():
    said = " ".join(readme.claims(comparison(), TIMING).split())
    assert "`net` is inside the envelope in 2 of 2 cells" in said
    assert "0.20 to 0.20 of that of the best of the paper's eight profiles inside the envelope (1 of 2 cells" in said
    assert "lower in 1 of the cells, level in 1, higher in 0" in said
    assert "A decision takes 0.1 ms when one episode flies alone (1/10 of `mpc`'s time)" in said
    assert "0.02 ms an episode when 100 fly side by side (1/100)." in said


def test_the_claims_where_no_profile_is_inside_in_any_cell():
    results = comparison()
    results["records"] = [{**r, "outside_fraction": 0.5} if r["policy"] == "sine" else r for r in results["records"]]
    assert "None of the paper's eight profiles is inside the envelope in any cell" in " ".join(
        readme.claims(results, TIMING).split()
    )


def test_the_tables_star_who_is_outside_and_say_none_inside():
    assert r"| sine | scripted | 2.00\* [1.80 2.20] | 2.00 [1.80 2.20] | 1 of 2 | 3.0 |" in results_tables.error_table(
        comparison()
    )
    assert r"| sine | scripted | 3.0\* | 3.0 |" in results_tables.reward_table(comparison())
    assert r"| sine | scripted | 3.0\* | 3.0 |" in results_tables.cell_reward_tables(comparison())
    assert "| **0.400** [0.360 0.440] |" in results_tables.cell_error_tables(comparison())
    assert "| s static | 1 | none inside | - | 0.20 | mpc | 0.80 |" in results_tables.standing_tables(comparison())


def test_rank_correlation_by_hand():
    """In static the reward ranks net, mpc and zero as their errors do; in step the sine, third, is paid most."""
    found = reward_figure.correlations(comparison()["records"], 0.01)
    assert found["s", "static"] == pytest.approx(1.0)
    ranks = np.array([[1, 2, 3, 4], [2, 3, 1, 4]])  # of net, mpc, sine, zero by error, and by reward
    distance = np.sum((ranks[0] - ranks[1]) ** 2)
    assert found["s", "step"] == pytest.approx(1.0 - 6.0 * distance / (4 * (4**2 - 1)))


def test_a_cell_with_too_few_policies_inside_is_refused():
    records = [r for r in comparison()["records"] if r["policy"] in ("sine", "mpc", "net")]
    with pytest.raises(ValueError, match="s static: 2 policies are beyond the envelope for at most 1% of the time"):
        reward_figure.correlations(records, 0.01)


def test_the_figure_is_of_the_committed_results():
    results = json.loads((readme.RESULTS / "compare.json").read_text())
    with Image.open(readme.ROOT / "docs" / "media" / "reward_ranks.png") as picture:
        assert picture.info["Source"] == reward_figure.source(results), "run python -m agents.docs.reward_figure"
        assert min(picture.size) > 800


def test_a_figure_can_be_drawn(tmp_path):
    reward_figure.draw(comparison(), tmp_path / "ranks.png")
    with Image.open(tmp_path / "ranks.png") as picture:
        assert picture.info["Source"].startswith(COMMAND)


@cases(("cost", "place"), [(0.008, 1), (0.03, None)])
def test_a_policy_beyond_the_limit_of_panels_is_not_ranked(cost, place):
    """The cost is the largest of all in each decision: what it has beyond rates and wheels is of panels."""
    cell = [record("law", "closed_loop", "static", 0.001), record("bends", "learned", "static", 0.0005, cost=cost)]
    assert ranks(cell).get("bends") == place
