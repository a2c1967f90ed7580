"""How the core is compiled.

Small functions carry `@inline`: they are compiled into whatever calls them. The few kernels that Python
calls carry `@kernel`: they release the GIL and are cached on disk. Numba's cache looks at the file of the
kernel alone, so an edit of a function that the kernel calls would go unseen; every kernel therefore closes
over a fingerprint of the whole core's source, which is part of numba's cache key.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit

_FLAGS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}


def _fingerprint() -> str:
    """Digest of the core's source files, in name order."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


SOURCE_FINGERPRINT = _fingerprint()


def inline(function: Callable[..., Any]) -> Any:
    """Compile a small pure function; LLVM inlines it into the kernel that calls it."""
    return njit(**_FLAGS)(function)


def kernel(build: Callable[[str], Callable[..., Any]]) -> Any:
    """Compile and cache the function that `build(fingerprint)` returns.

    The returned function must name the fingerprint in its body, so that the fingerprint is one of its
    closure variables.
    """
    return njit(nogil=True, cache=True, **_FLAGS)(build(SOURCE_FINGERPRINT))
