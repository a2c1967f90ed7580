"""Markdown tables and sentences of a comparison for the README and the pages, from compare.json and timing.json."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from agents.benchmark.summary.ranking import best, cells, keeps_envelope, ranks, standings
from agents.docs.reward_figure import NEARLY, correlations
from baselines.command.markdown import table
from satid_gym.metrics import BEYOND_MAX
from satid_gym.profiles import PROFILES

Record = Mapping[str, Any]

_ORDER = {"learned": 0, "closed_loop": 1, "scripted": 2, "reference": 3}
WAVE = "rate_square"  # the simplest law that is hard to beat
_SHORT = (  # rows of the short tables: the best of each kind, up to these numbers
    (2, lambda r: r["kind"] == "learned"),
    (1, lambda r: r["kind"] == "closed_loop"),
    (1, lambda r: r["policy"] == WAVE),
    (1, lambda r: r["policy"] in PROFILES),
    (2, lambda r: r["kind"] == "reference"),
)


def ranked(records: Sequence[Record]) -> list[Record]:
    """One record of each policy: by kind, then by the geometric mean of final errors over the inertia modes."""
    modes = list(dict.fromkeys(r["inertia_mode"] for r in records))

    def order(record: Record) -> tuple[int, float]:
        errors = [np.mean(_of(records, record["policy"], "final_error_mean", mode)) for mode in modes]
        return _ORDER[record["kind"]], float(np.log(errors).mean())

    return sorted({r["policy"]: r for r in records}.values(), key=order)


def important(records: Sequence[Record]) -> list[Record]:
    """The rows of the short tables: best two learned, best loop, `rate_square`, best of the eight, references."""
    ordered = ranked(records)
    chosen = (r for count, belongs in _SHORT for r in [r for r in ordered if belongs(r)][:count])
    return list({r["policy"]: r for r in chosen}.values())


def error_table(results: Mapping[str, Any]) -> str:
    """Final error in % by inertia mode with intervals, the cells inside the envelope, and the mean rank in these."""
    records: Sequence[Record] = results["records"]
    modes = list(dict.fromkeys(r["inertia_mode"] for r in records))
    all_cells = cells(records)
    rows = []
    for r in important(records):
        policy = r["policy"]
        places = [place for cell in all_cells if (place := ranks(cell).get(policy)) is not None]
        rows.append(
            [
                _name(r),
                _kind(r),
                *(_mode_error(records, policy, mode) for mode in modes),
                f"{len(places)} of {len(all_cells)}",
                f"{np.mean(places):.1f}" if places else "none",
            ]
        )
    return "\n\n".join([table(["policy", "kind", *modes, "cells inside", "mean rank"], rows), source(results)])


def reward_table(results: Mapping[str, Any]) -> str:
    """Sum of the default reward over an episode, by inertia mode; the same rows as in the table of errors."""
    records: Sequence[Record] = results["records"]
    modes = list(dict.fromkeys(r["inertia_mode"] for r in records))
    rows = [
        [
            _name(r),
            _kind(r),
            *(_mode_reward(records, r["policy"], mode) for mode in modes),
        ]
        for r in important(records)
    ]
    return table(["policy", "kind", *modes], rows)


def standing_tables(results: Mapping[str, Any]) -> str:
    """Each learned policy in every cell, against the best of the paper's eight and the best closed loop inside."""
    head = ["cell", "rank", "best of the eight inside", "over it", "over the lowest of the eight", "best loop inside"]
    head += ["over it", "difference to it, % [95 %]", "error"]
    parts = []
    for policy in (r["policy"] for r in ranked(results["records"]) if r["kind"] == "learned"):
        rows = [
            [
                f"{s.satellite} {s.mode}",
                "outside" if s.rank is None else str(s.rank),
                s.profile or "none inside",
                _ratio(s.over_profile),
                _ratio(s.over_any_profile),
                s.loop or "none inside",
                _ratio(s.over_loop),
                _difference(s.difference),
                s.against_loop or "-",
            ]
            for s in standings(results, policy)
        ]
        parts += [f"**{policy}**", table(head, rows)]
    return "\n\n".join([*parts, source(results)])


def _ratio(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _difference(value: tuple[float, float, float] | None) -> str:
    if value is None:
        return "-"
    mean, low, high = (100.0 * v for v in value)
    return f"{mean:.2g} [{low:.2g} {high:.2g}]"


def cell_error_tables(results: Mapping[str, Any]) -> str:
    """Final error in % with its interval in every cell, a table for each satellite; bold is the best inside."""

    def cell(record: Record, lowest: Record | None) -> str:
        text = f"{_percent(record['final_error_mean'])}{_star(record)}"
        interval = f" [{_percent(record['final_error_lo'])} {_percent(record['final_error_hi'])}]"
        return (f"**{text}**" if record is lowest else text) + interval

    return _by_satellite(results, cell)


def cell_reward_tables(results: Mapping[str, Any]) -> str:
    """Sum of the default reward over an episode in every cell, a table for each satellite."""
    return _by_satellite(results, lambda record, lowest: f"{record['reward']:.1f}{_star(record)}")


def _by_satellite(results: Mapping[str, Any], cell: Callable[[Record, Record | None], str]) -> str:
    records: Sequence[Record] = results["records"]
    modes = list(dict.fromkeys(r["inertia_mode"] for r in records))
    policies, parts = ranked(records), []
    for satellite in dict.fromkeys(r["satellite"] for r in records):
        here = {(r["policy"], r["inertia_mode"]): r for r in records if r["satellite"] == satellite}
        lowest = {mode: best(r for (_, m), r in here.items() if m == mode) for mode in modes}
        rows = [[p["policy"], _kind(p), *(cell(here[p["policy"], m], lowest[m]) for m in modes)] for p in policies]
        parts.append(table([satellite, "kind", *modes], rows))
    return "\n\n".join([*parts, source(results)])


def correlation_sentence(results: Mapping[str, Any]) -> str:
    """Rank correlation of reward and error, over the cells."""
    nearly, inside = (correlations(results["records"], most) for most in (NEARLY, BEYOND_MAX))
    return (
        f"Spearman's rank correlation of reward and falling mean error over the {len(nearly)} cells: "
        f"{_correlation_range(nearly)} among the policies beyond the envelope for at most {100 * NEARLY:.0f} % of the "
        f"time, {_correlation_range(inside)} among those inside it (at most {100 * BEYOND_MAX:.0f} %: few in some "
        "cells, and close to each other)."
    )


def _correlation_range(found: Mapping[tuple[str, str], float]) -> str:
    worst, least = min(found.items(), key=lambda item: item[1])
    return f"{least:.2f} ({' '.join(worst)}) to {max(found.values()):.2f}"


def source(results: Mapping[str, Any]) -> str:
    """What made the figures."""
    return f"Revision {results['revision']}, {results['command'].split(' --output')[0]}."


def _of(records: Sequence[Record], policy: str, name: str, mode: str) -> list[float]:
    return [r[name] for r in records if r["policy"] == policy and r["inertia_mode"] == mode]


def _mode_error(records: Sequence[Record], policy: str, mode: str) -> str:
    """Mean over satellites, which share seeds: the mean of the intervals covers it however they go together."""
    mean, low, high = (float(np.mean(_of(records, policy, f"final_error_{end}", mode))) for end in ("mean", "lo", "hi"))
    return f"{_percent(mean)}{_stars(records, policy, mode)} [{_percent(low)} {_percent(high)}]"


def _mode_reward(records: Sequence[Record], policy: str, mode: str) -> str:
    return f"{np.mean(_of(records, policy, 'reward', mode)):.1f}{_stars(records, policy, mode)}"


def _stars(records: Sequence[Record], policy: str, mode: str) -> str:
    """A star where the policy is outside the envelope on at least one satellite."""
    return max(_star(r) for r in records if r["policy"] == policy and r["inertia_mode"] == mode)


def _percent(fraction: float) -> str:
    return f"{100.0 * fraction:#.3g}".removesuffix(".")


def _star(record: Record) -> str:
    return "" if keeps_envelope(record) else r"\*"


def _name(record: Record) -> str:
    return f"**{record['policy']}**" if record["kind"] == "learned" else record["policy"]


def _kind(record: Record) -> str:
    return record["kind"].replace("_", " ")
