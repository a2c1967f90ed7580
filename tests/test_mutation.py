"""Mutation testing itself: the mutants of a small source, and that a trial tells a mutant from the original."""

from __future__ import annotations

import ast

import pytest

from tests.cases import cases
from tests.qa.mutation.__main__ import GROUPS, TESTS, MutationArguments, Target, Trials, score
from tests.qa.mutation.equivalent import EQUIVALENT
from tests.qa.mutation.mutants import find_mutants, mutate

pytestmark = [pytest.mark.compiled, pytest.mark.slow]  # its trials switch the compiler off themselves

SOURCE = '''
"""Text."""

LIMIT: float = 2.5


def clipped(x: float, low: float = 0.0) -> float:
    """Text 1 + 1."""
    if x <= low and LIMIT > 0:
        raise ValueError(f"{x + 1} is too low")
    return max(-x, low)
'''


def test_mutants_of_a_small_source():
    """Every operator where it applies; docstrings, annotations and messages are left alone."""
    found = [(m.function, m.after) for m in find_mutants(SOURCE)]
    test, value = "if x <= low and LIMIT > 0:", "return max(-x, low)"
    assert found == [
        ("", "LIMIT: float = 5.0"),
        ("clipped", "def clipped(x: float, low: float=1.0) -> float:"),
        ("clipped", test.replace("and", "or")),
        ("clipped", test.replace("<=", "<")),
        ("clipped", test.replace("<=", ">")),
        ("clipped", test.replace("> 0", ">= 0")),
        ("clipped", test.replace("> 0", "<= 0")),
        ("clipped", test.replace("> 0", "> 1")),
        ("clipped", "pass"),
        ("clipped", value.replace("max", "min")),
        ("clipped", value.replace("-x", "x")),
    ]


@cases("name", TESTS)
def test_mutants_are_other_programs_and_every_equivalent_one_is_one_of_todays(name):
    source = Target(name).source
    original = ast.dump(ast.parse(source))
    mutants = find_mutants(source)
    assert len({mutant.key for mutant in mutants}) == len(mutants), "each has a name of its own"
    third = range(0, len(mutants), 3)
    changed = {ast.dump(mutate(source, i)) for i in third}
    assert original not in changed
    assert len(changed) > 0.95 * len(third)  # x > 0 and not x <= 0 are one program
    assert EQUIVALENT.get(name, {}).keys() <= {mutant.key for mutant in mutants}


def test_a_trial_kills_a_wrong_sign_and_passes_the_original():
    target = Target("core/truth/sensors")
    mutants = find_mutants(target.source)
    wrong = next(i for i, m in enumerate(mutants) if "gyro_bias[i] - plant.gyro_noise_std" in m.after)
    request = {"path": target.path, "tests": target.tests, "order": [], "seconds": 100}
    trials = Trials(1)
    try:
        clean = trials.run({**request, "index": None})
        assert clean["outcome"] == "survived"
        assert {test.split("::")[0] for test in clean["tests"]} == {
            f"tests/test_{name}.py" for name in TESTS["core/truth/sensors"]
        }
        result = trials.run({**request, "index": wrong})
        assert result["outcome"] == "killed"
        assert result["killer"].startswith("tests/test_sensors.py::test_a_sample_draw_by_draw")
    finally:
        trials.close()


def test_a_sample_has_an_interval_and_a_census_none():
    outcomes = [("core/reward", str(i), "killed" if i < 9 else "survived") for i in range(10)]
    part = score("core/reward", outcomes, 50)
    assert part["rate"] == 0.9
    assert part["rate_low"] == pytest.approx(0.596, abs=1e-3)  # Wilson's interval of 9 in 10
    assert part["rate_high"] == pytest.approx(0.982, abs=1e-3)
    whole = score("core/reward", outcomes, 10)
    assert (whole["rate_low"], whole["rate_high"]) == (0.9, 0.9)


def test_arguments_are_checked_and_groups_are_made_of_the_modules():
    assert sorted(name for group in GROUPS.values() for name in group) == sorted(TESTS)
    with pytest.raises(ValueError, match=r"unknown module 'core/rewards'; .* Did you mean 'core/reward'\?"):
        MutationArguments(modules=("core/rewards",)).check()
    with pytest.raises(ValueError, match="sample must be an integer of at least 1, got 0"):
        MutationArguments(sample=0).check()
