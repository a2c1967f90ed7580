"""Compilation of the core: its parts, and the compiler's cache for what numba's own leaves open."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core import ir
from numba.core.compiler import run_frontend
from numba.core.types.functions import BaseFunction

from satid_gym.core import kernels
from satid_gym.core.factors import invert
from satid_gym.core.jit import inline, inline_disjoint, kernel, outline, outline_disjoint, passes
from satid_gym.core.jit.cache import NamedByContent
from satid_gym.core.sample import measure

if numba.config.DISABLE_JIT:
    pytest.skip("nothing is compiled", allow_module_level=True)


@inline
def doubled(x):
    return 2.0 * x


@outline
def doubled_sum(values):
    total = 0.0
    for i in range(values.shape[0]):
        total += doubled(values[i])
    return total


def both(values):
    return doubled_sum(values) + doubled(doubled_sum(values[1:]))


@pytest.mark.compiled
def test_an_outlined_function_is_in_a_kernel_once_and_an_inlined_one_not_at_all():
    compiled_both = kernel(both)
    compiled_both._cache.disable()  # what comes from the cache no longer names its functions
    assert compiled_both(np.array([1.0, 2.0, 3.0])) == 32.0
    (compiled,) = compiled_both.overloads.values()
    names = [f.name for f in compiled.library.get_defined_functions()]
    assert [sum(part.__name__ + "B" in name for name in names) for part in (doubled, doubled_sum)] == [0, 1]


def products(values, by, out):
    for i in range(values.shape[0]):
        out[i] = values[i] * by[0]


@pytest.mark.compiled
@pytest.mark.parametrize(("part", "alone"), [(inline, 0), (inline_disjoint, 0), (outline, 1), (outline_disjoint, 1)])
def test_a_part_of_disjoint_arguments_is_compiled_as_one(part, alone):
    """With the mark on its pointers where they are said to be disjoint, and as often as its like."""
    piece = part(products)

    def whole(values, by, out):
        piece(values, by, out)

    compiled_whole = kernel(whole)
    compiled_whole._cache.disable()
    out = np.zeros(3)
    compiled_whole(np.array([1.0, 2.0, 3.0]), np.array([2.0]), out)
    np.testing.assert_array_equal(out, [2.0, 4.0, 6.0])
    (compiled,) = compiled_whole.overloads.values()
    names = [f.name for f in compiled.library.get_defined_functions() if "8products" in f.name]
    assert len(names) == alone
    (own,) = piece.overloads.values()
    marked = re.search(r"noalias [^,]*%arg\.", own.library.get_llvm_str()) is not None
    assert marked == part.__name__.endswith("disjoint")


@pytest.mark.compiled
def test_kernels_leave_numba_as_it_was():
    def settings():
        return numba.config.SLP_VECTORIZE, BaseFunction.get_call_type, ir.Inst._rec_list_vars

    before = settings()
    compiled = kernel(both)
    compiled._cache.disable()
    compiled(np.array([1.0, 2.0]))
    assert settings() == before


@pytest.mark.compiled
@pytest.mark.parametrize("function", [both, doubled_sum.py_func, measure.py_func, invert.py_func])
def test_the_variables_of_a_statement_are_those_that_numba_lists(function):
    statements = [s for block in run_frontend(function).blocks.values() for s in block.body]
    assert any(len(s.list_vars()) > 1 for s in statements)
    for statement in statements:
        assert passes._variables(statement, vars(statement)) == statement.list_vars()


def larger(one, other):
    return max(one, other) + 1


@pytest.mark.compiled
def test_what_is_remembered_of_a_call_is_what_numba_finds():
    compiled = kernel(larger)
    compiled._cache.disable()
    for _ in range(2):
        assert [type(compiled(*pair)) for pair in ((1, 2), (1.0, 2.0), (1, 2.0))] == [int, float, float]
    known = [key for key in passes._call_types if key[0].typing_key is max]
    assert len(known) >= 3
    for function, context, args, kws in known:
        signature, _ = passes._call_types[function, context, args, kws]
        assert signature == passes._find_call_type(function, context, args, dict(kws))


def test_python_may_call_a_part():
    for _ in range(2):  # before and after kernels have taken it in
        assert doubled(3.0) == 6.0
        assert doubled_sum(np.array([1.0, 2.0])) == 6.0
        assert kernel(both)(np.array([1.0, 2.0])) == 14.0


def test_processes_that_save_at_once_do_not_take_each_others_files(tmp_path):
    one, other = (NamedByContent(tmp_path, "kernel", "stamp") for _ in range(2))
    other._load_index = dict  # it read the index before `one` wrote it
    one.save("signature of one", "code of one")
    other.save("signature of other", "code of other")
    fresh = NamedByContent(tmp_path, "kernel", "stamp")
    assert fresh.load("signature of other") == "code of other"
    assert fresh.load("signature of one") in (None, "code of one")
    one.save("signature of one", "code of one")
    assert [fresh.load(f"signature of {name}") for name in ("one", "other")] == ["code of one", "code of other"]


@pytest.mark.compiled
def test_kernels_use_it():
    assert type(kernels.start_filter._cache._cache_file) is NamedByContent


LAWS = """
import sys
import numpy as np
from satid_gym import InertiaLaw
from satid_gym.plants import law_inertia

for knots in map(int, sys.argv[1:]):
    law = InertiaLaw("table", times=np.arange(knots), values=1.0 + np.arange(knots))
    np.testing.assert_array_equal(law_inertia(law, np.ones(3), (0.5, 2.0))[:, 0, 0], (1.5, 3.0))
"""


@pytest.mark.slow
@pytest.mark.compiled
def test_kernels_that_two_processes_compiled_are_told_apart_by_a_third(tmp_path):
    """Numba numbers record types by process, and names their kernels by the numbers."""
    for knots in (["4"], ["20"], ["4", "20"], ["20", "4"]):
        done = subprocess.run(
            [sys.executable, "-c", LAWS, *knots],
            cwd=Path(__file__).parent.parent,
            env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert done.returncode == 0, done.stderr
