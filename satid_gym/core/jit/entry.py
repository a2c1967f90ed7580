"""Compilation of the core: `@kernel` for what Python calls, `@inline` and `@outline` for what kernels call.

`@inline_disjoint` and `@outline_disjoint` are the same for functions whose arguments share no memory.

Kernels release the GIL and are cached on disk. A small function, `@inline`, is compiled into whatever calls it; a
larger one, `@outline`, once into each kernel, since the compiler takes its time over every copy.

A branch that only the shapes of a record's arrays decide is taken before anything in it is compiled
(`satid_gym.core.jit.shapes`): what only some satellites have stands behind `if oscillators.mass.shape[0] > 0`.

An array that is handed to an outlined function has no shape that the compiler knows, so that it unrolls no loop there:
hand on the record that holds the array instead, or inline.

Results must not depend on which process compiled what first. LLVM may therefore not choose what to inline: a kernel
from the cache might be linked with functions that were compiled otherwise than its own, and the last bits would differ.

With NUMBA_DISABLE_JIT=1 in the environment the same code runs as plain Python, some hundred times slower: for
debuggers, coverage and mutation testing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import config, njit

from satid_gym.core.jit.cache import cache_of
from satid_gym.core.jit.interpreted import interpreted
from satid_gym.core.jit.parts import FLAGS, Vectorised


def kernel(function: Callable[..., Any]) -> Any:
    """Compile and cache a function that Python calls."""
    if config.DISABLE_JIT:
        return interpreted(function)
    compiled = njit(nogil=True, pipeline_class=Vectorised, **FLAGS)(function)
    compiled._cache = cache_of(function)
    return compiled
