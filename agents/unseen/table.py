"""Table of a comparison on unseen satellites, for the docs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from agents.docs.readme import REMEDY, RESULTS
from baselines.command.markdown import table
from satid_gym.files import read_json

_KEYS = ("summary", "settings", "revision")
_LIMITS = {"outside_fraction": "rates", "saturated_fraction": "wheels", "cost": "all together"}


def unseen() -> str:
    """The committed comparison of satellites without panels."""
    return unseen_table(read_json(RESULTS / "unseen.json", REMEDY, keys=_KEYS))


def unseen_flex() -> str:
    """The committed comparison of satellites with panels."""
    return unseen_table(read_json(RESULTS / "unseen_flex.json", REMEDY, keys=_KEYS))


def unseen_table(results: Mapping[str, Any]) -> str:
    """One row a policy, from a file of `agents.unseen.compare`."""
    entries, settings = results["summary"], results["settings"]
    first, limits = entries[0]["policy"], [name for name in _LIMITS if f"at_most_1_percent_{name}" in entries[0]]
    head = [
        "policy",
        "mean error, %",
        f"`{first}` over it, mean error: median, 95th percentile",
        "final error",
        f"limits kept ({', '.join(_LIMITS[name] for name in limits)}): % of satellites",
        "NEES",
    ]
    rows = []
    for entry in entries:
        over = [entry[f"{first}_over_it_{score}"] for score in ("mean_error", "final_error")]
        shares = (100.0 * entry[f"at_most_1_percent_{name}"] for name in limits)
        rows.append(
            [
                f"`{entry['policy']}`",
                f"{100.0 * entry['mean_error']:.3f}",
                *("" if entry is entries[0] else f"{o['median']:.2f}, {o['percentile_95']:.2f}" for o in over),
                ", ".join(f"{share:.0f}" for share in shares),
                f"{entry['nees']:.2f}",
            ]
        )
    low, high = settings["wheels"]
    of = f"{entries[0]['satellites']} satellites of {low} to {high} wheels, {settings['split']} seeds, four laws"
    episodes = f"{settings['episodes']} episodes a cell, {settings['planned']} of planners"
    ended = [f"`{e['policy']}` {e['ended_early']} of {e['flights']}" for e in entries if e.get("ended_early")]
    early = f" Flights that ended early: {', '.join(ended)}." if ended else ""
    return f"{table(head, rows)}\n\n{of}, {episodes}; revision {results['revision'][:7]}.{early}"
