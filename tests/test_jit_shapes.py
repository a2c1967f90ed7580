"""Branches that shapes decide: what is in those that are not taken is not compiled, and the others stay."""

import numba
import numpy as np
import pytest

from satid_gym.core.jit import inline, kernel, outline

if numba.config.DISABLE_JIT:
    pytest.skip("nothing is compiled", allow_module_level=True)

pytestmark = pytest.mark.compiled


def rows(count, on=1):
    """A record with so many rows in its part, each of ones."""
    dtype = np.dtype([("on", np.int64), ("part", np.dtype([("values", np.float64, (count, 2))]))])
    record = np.zeros(1, dtype)
    record["on"], record["part"]["values"] = on, 1.0
    return record


@inline
def not_compiled(x):
    return x + 1.0


@outline
def sum_of(values):
    total = 0.0
    for i in range(values.shape[0]):
        total += values[i, 0] + values[i, 1]
    return total


@inline
def guarded(record):
    if record.part.values.shape[0] == 0:
        return not_compiled(record)
    return sum_of(record.part.values)


@inline
def guarded_by_both(record):
    both = record.part.values.shape[0] > 1 and record.on != 0
    total = 0.0
    if both:
        total = not_compiled(record)
    return total


@inline
def guarded_by_either(record):
    part = record.part
    if part.values.shape[0] != 3 or record.on == 0:
        return -1.0
    return sum_of(part.values)


@inline
def guarded_by_a_number(record):
    count = record.part.values.shape[0]
    count += record.on
    return 1.0 if count > 2 else 0.0


def compiled(part):
    def whole(records):
        return part(records[0])

    whole_kernel = kernel(whole)
    whole_kernel._cache.disable()
    return whole_kernel


def test_a_branch_that_is_not_taken_need_not_even_have_a_type():
    run = compiled(guarded)
    assert run(rows(2)) == 4.0
    with pytest.raises(numba.TypingError, match="add"):
        run(rows(0))


def test_a_condition_of_which_a_part_is_known_is_known_where_that_part_decides():
    run = compiled(guarded_by_both)
    assert run(rows(1)) == run(rows(0)) == 0.0
    with pytest.raises(numba.TypingError, match="add"):
        run(rows(2))


def test_what_numbers_decide_is_left_to_the_run():
    run = compiled(guarded_by_either)
    assert [run(rows(3, on)) for on in (0, 1)] == [-1.0, 6.0]
    assert run(rows(2)) == -1.0
    run = compiled(guarded_by_a_number)
    assert [run(rows(2, on)) for on in (0, 1)] == [0.0, 1.0]
