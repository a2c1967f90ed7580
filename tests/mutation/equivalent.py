"""Survivors that no test can kill: the mutant does what the original does, to within rounding."""

from __future__ import annotations

EQUIVALENT: dict[str, dict[str, str]] = {}
