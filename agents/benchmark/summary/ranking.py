"""Ranking of the policies of a comparison, cell by cell.

A policy keeps to the limits if it is beyond the envelope, of rates and wheel speeds, for at most 1 % of the time, and
beyond what else has a limit, panels, tanks and payload, for at most 1 % more. Only those that do are ranked and
compared with. A group in which none does has no best, and no policy is compared with it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from satid_gym.config import unknown_name
from satid_gym.metrics import BEYOND_MAX, beyond_envelope
from satid_gym.profiles import PROFILES

Record = Mapping[str, Any]


def keeps_envelope(record: Record, most: float = BEYOND_MAX) -> bool:
    """Whether a policy is beyond the envelope, and beyond all other limits, for at most a share of the time each."""
    outside, saturated = record["outside_fraction"], record["saturated_fraction"]
    others = (record.get("cost") or 0.0) - outside - saturated  # the cost is the largest of all, in each decision
    return max(beyond_envelope(outside, saturated), others) <= most


def inside(records: Sequence[Record]) -> list[Record]:
    """Those that keep to the envelope; all of them if none does."""
    return [r for r in records if keeps_envelope(r)] or list(records)


def best(records: Iterable[Record]) -> Record | None:
    """The record with the lowest final error of those that keep to the envelope; None if none does."""
    return min((r for r in records if keeps_envelope(r)), key=_error, default=None)


@dataclass(frozen=True, kw_only=True)
class Standing:
    """Standing of a policy in one cell. Errors are final errors, means over episodes.

    Attributes:
        satellite, mode: which cell.
        inside: whether the policy keeps to the envelope there.
        rank: its place by error among all that keep to the envelope, from 1; None where it does not.
        profile: the best of the paper's eight profiles inside the envelope; None where none is.
        over_profile: the policy's error over that profile's; None if it is missing.
        over_any_profile: the policy's error over the lowest of the eight, inside or not.
        loop: the best closed loop inside the envelope; None where none is.
        over_loop: the policy's error over that loop's; None if it is missing.
        difference: mean (error less that loop's, on the same seeds) and both ends of its 95 % interval; None likewise.
    """

    satellite: str
    mode: str
    inside: bool
    rank: int | None
    profile: str | None
    over_profile: float | None
    over_any_profile: float
    loop: str | None
    over_loop: float | None
    difference: tuple[float, float, float] | None

    @property
    def against_loop(self) -> str | None:
        """Whether its error is clearly "lower" than the best closed loop's, clearly "higher", or "level"."""
        if self.difference is None:
            return None
        _, low, high = self.difference
        return "lower" if high < 0.0 else "higher" if low > 0.0 else "level"


def standings(results: Mapping[str, Any], policy: str) -> list[Standing]:
    """A policy in every cell of a comparison that holds the paper's eight profiles.

    Args:
        results: as compare.json has them.
        policy: a learned policy or a closed loop, for only these were set against others in pairs.

    Raises:
        ValueError: the comparison has no such policy.
    """
    if policy not in (names := [r["policy"] for r in results["records"]]):
        raise unknown_name("policy of the comparison", policy, dict.fromkeys(names))
    return [_standing(cell, results["pairs"], policy) for cell in cells(results["records"])]


def cells(records: Iterable[Record]) -> list[list[Record]]:
    """The records of each cell."""
    found: dict[tuple[str, str], list[Record]] = {}
    for r in records:
        found.setdefault((r["satellite"], r["inertia_mode"]), []).append(r)
    return list(found.values())


def ranks(cell: Sequence[Record]) -> dict[str, int]:
    """Places by final error, from 1, of the policies of a cell that keep to the envelope."""
    kept = sorted((r for r in cell if keeps_envelope(r)), key=_error)
    return {r["policy"]: place for place, r in enumerate(kept, start=1)}


def _error(record: Record) -> float:
    return float(record["final_error_mean"])


def _standing(cell: Sequence[Record], pairs: Sequence[Record], policy: str) -> Standing:
    own = next(r for r in cell if r["policy"] == policy)
    eight = [r for r in cell if r["policy"] in PROFILES]
    profile = best(eight)
    loop = best(r for r in cell if r["kind"] == "closed_loop" and r["policy"] != policy)
    return Standing(
        satellite=own["satellite"],
        mode=own["inertia_mode"],
        inside=keeps_envelope(own),
        rank=ranks(cell).get(policy),
        profile=None if profile is None else profile["policy"],
        over_profile=None if profile is None else _error(own) / _error(profile),
        over_any_profile=_error(own) / min(map(_error, eight)),
        loop=None if loop is None else loop["policy"],
        over_loop=None if loop is None else _error(own) / _error(loop),
        difference=None if loop is None else _difference(pairs, own, loop),
    )


def _difference(pairs: Sequence[Record], own: Record, loop: Record) -> tuple[float, float, float]:
    """Error less that of a loop in the same cell: mean and both ends of its interval."""
    match = next(
        p
        for p in pairs
        if (p["policy"], p["other"]) == (own["policy"], loop["policy"])
        and (p["satellite"], p["inertia_mode"]) == (own["satellite"], own["inertia_mode"])
    )
    return match["difference_mean"], match["difference_lo"], match["difference_hi"]
