"""Compilation of the core by numba: kernels, their parts, and a cache of them."""

from satid_gym.core.jit.entry import kernel
from satid_gym.core.jit.parts import inline, inline_disjoint, outline, outline_disjoint

__all__ = ["inline", "inline_disjoint", "kernel", "outline", "outline_disjoint"]
