"""Markdown tables and sentences of a comparison for the README and the pages, from compare.json and timing.json."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from agents.benchmark.summary.ranking import Standing, best, cells, keeps_envelope, ranks, standings
from agents.docs.reward_figure import NEARLY, correlations
from baselines.command.markdown import table
from satid_gym.metrics import BEYOND_MAX
from satid_gym.profiles import PROFILES

Record = Mapping[str, Any]

_ORDER = {"learned": 0, "closed_loop": 1, "scripted": 2, "reference": 3}
_PLANNER = "mpc"  # whose time of a decision is what a network saves
_SHORT = (  # rows of the short tables: the best of each kind, up to these numbers
    (2, lambda r: r["kind"] == "learned"),
    (1, lambda r: r["kind"] == "closed_loop"),
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
    """The rows of the short tables: the best two learned, the best loop, the best of the eight, the references."""
    ordered = ranked(records)
    return [r for count, belongs in _SHORT for r in [r for r in ordered if belongs(r)][:count]]


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


def claims(results: Mapping[str, Any], timing: Mapping[str, Any]) -> str:
    """A paragraph on each learned policy: against the paper's eight, the best closed loop, the planner's time."""
    learned = [r["policy"] for r in ranked(results["records"]) if r["kind"] == "learned"]
    return "\n".join(_claim(policy, standings(results, policy), timing) for policy in learned)


def _claim(policy: str, places: Sequence[Standing], timing: Mapping[str, Any]) -> str:
    ratios = [s.over_profile for s in places if s.over_profile is not None]
    against = [s.against_loop for s in places]
    sentences = [f"`{policy}` is inside the envelope in {sum(s.inside for s in places)} of {len(places)} cells."]
    if ratios:
        sentences.append(
            f"Its final error is {_range(ratios)} of that of the best of the paper's eight profiles inside the "
            f"envelope ({len(ratios)} of {len(places)} cells have one)."
        )
    else:
        any_profile = _range([s.over_any_profile for s in places])
        sentences.append(
            f"None of the paper's eight profiles is inside the envelope in any cell; its final error is {any_profile} "
            "of the lowest of the eight."
        )
    sentences.append(
        "Compared with the best closed loop inside the envelope, by paired 95 % intervals, it is "
        f"lower in {against.count('lower')} cells, level in {against.count('level')}, higher in "
        f"{against.count('higher')}" + (f"; {against.count(None)} have no such loop." if None in against else ".")
    )
    own, planner = timing["decision_ms"].get(policy), timing["decision_ms"].get(_PLANNER)
    if own and planner:
        sentences.append(
            f"A decision takes {own['alone']:.2g} ms when one episode flies alone ({_share(own, planner, 'alone')} of "
            f"`{_PLANNER}`'s time), {own['side_by_side']:.2g} ms an episode when {timing['episodes']} fly side by side "
            f"({_share(own, planner, 'side_by_side')})."
        )
    return textwrap.fill(" ".join(sentences), 118, initial_indent="- ", subsequent_indent="  ", break_on_hyphens=False)


def _share(own: Mapping[str, float], other: Mapping[str, float], how: str) -> str:
    """A time over another one, as a fraction that reads well."""
    ratio = other[how] / own[how]
    return f"{1.0 / ratio:.2g} times" if ratio < 1.5 else f"1/{ratio:.0f}"


def _range(values: Sequence[float]) -> str:
    return f"{min(values):.2f} to {max(values):.2f}"


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
    mean, low, high = (np.mean(_of(records, policy, f"final_error_{end}", mode)) for end in ("mean", "lo", "hi"))
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
