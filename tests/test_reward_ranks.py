"""The default reward ranks policies as the benchmark does: in flights, and in the committed comparison."""

import itertools
import json
from pathlib import Path

from agents.docs.reward_figure import correlations
from satid_gym.evaluation import benchmark_scenario, fly, seeds
from satid_gym.policies import find, make_baseline
from tests.cases import cases

RESULTS = Path(__file__).parent.parent / "docs" / "results" / "compare.json"
RECORDS = json.loads(RESULTS.read_text(encoding="utf-8"))["records"]


@cases(("satellite", "inertia"), itertools.product(("cubesat", "microsat"), ("static", "periodic")))
def test_from_doing_nothing_to_the_best_more_reward_is_less_error(satellite, inertia):
    policies = [make_baseline(name, satellite) for name in ("zero", "multi_sine", "sine", "rate_square")]
    chosen = seeds("validation", 20)
    flights = [
        fly(policy, satellite=satellite, inertia=inertia, seeds=chosen, scenario=benchmark_scenario()).scores()
        for policy in (*policies, find("generalist"))
    ]
    errors, rewards = ([flight[name].mean() for flight in flights] for name in ("mean_error", "reward"))
    assert errors == sorted(errors, reverse=True)
    assert rewards == sorted(rewards)


@cases(("cell", "correlation"), correlations(RECORDS).items())
def test_who_is_hardly_beyond_the_envelope_ranks_by_reward_as_by_mean_error(cell, correlation):
    """With a penalty from 0.96 of the limit on it was as low as 0.2."""
    assert correlation >= 0.95
