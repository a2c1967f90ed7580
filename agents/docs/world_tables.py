"""Tables of the world as flown: a filter that is told too little, rate loops, gates of scenarios, Basilisk's truth."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from agents.docs.readme import REMEDY, RESULTS
from agents.standing.lookahead_table import lookahead_table
from agents.standing.paired_table import paired_table
from agents.standing.seeds import seeds_table
from agents.standing.summary import RUNGS, is_consistent, ladder
from baselines.command.markdown import table
from satid_gym.files import read_json

Cell = Mapping[str, Any]


def _pair(cells: Sequence[Cell], name: str, pattern: str, factor: float = 1.0) -> str:
    """Means over cells, without and with `inflate`."""
    plain, inflated = factor * np.mean([cell[name] for cell in cells], axis=0)
    return f"{plain:{pattern}} / {inflated:{pattern}}"


def _committed(name: str, rows: str, *more: str) -> Mapping[str, Any]:
    """A study's file in docs/results."""
    return read_json(RESULTS / f"{name}.json", REMEDY, keys=(rows, "settings", "revision", *more))


def unmodelled() -> str:
    """What becomes of a filter that is not told, from the committed study."""
    return unmodelled_table(_committed("unmodelled", "cells"))


def rate_loops() -> str:
    """Both rate loops, from the committed study."""
    return rate_loops_table(_committed("rate_loops", "cells"))


def _gates(kind: str, *scenarios: str) -> str:
    return "\n\n".join(gate_table(_committed(f"{kind}_{name}", "rows")) for name in scenarios)


def gates() -> str:
    """Ladders of the scenarios, from the committed gates."""
    return _gates("gate", "flex", "slosh", "calibration", "operations", "wheels4")


def planners() -> str:
    """`filter_mpc` next to the closed loop of each scenario, from the committed flights."""
    return _gates("planner", "flex", "slosh", "calibration")


def _standing() -> Mapping[str, Any]:
    """The committed standing table."""
    return _committed("standing", "rows", "command", "seeds")


def ladders() -> str:
    """The best of each kind in every scenario on every satellite, from the committed standing table."""
    return ladders_table(_standing())


def seeds() -> str:
    """Spread over seeds of the trainings that were run with several, from the committed flights."""
    return seeds_table(read_json(RESULTS / "seeds.json", REMEDY, keys=("trainings",)))


def looking_ahead() -> str:
    """`lookahead` next to other policies, from the committed standing table."""
    return lookahead_table(_standing())


def pairs(scenario: str, policy: str, others: str) -> Callable[[], str]:
    """Writer of a policy next to others, names with spaces, from the committed comparison in a scenario."""
    return lambda: paired_table(_committed(f"pairs_{scenario}", "rows"), policy, others.split())


def basilisk() -> str:
    """Basilisk's truth next to the environment's own, from the committed study."""
    return basilisk_table(_committed("basilisk", "cells"))


def tours() -> str:
    """The same of the learned policies that choose corners, by body rates."""
    return basilisk_table(_committed("basilisk_tours", "cells"))


def unmodelled_table(results: Mapping[str, Any]) -> str:
    """NEES, final error and alarms, means over satellites and inertia modes, by world and policy."""
    cells: Sequence[Cell] = results["cells"]
    rows = []
    for world, policy in dict.fromkeys((cell["world"], cell["policy"]) for cell in cells):
        own = [cell for cell in cells if (cell["world"], cell["policy"]) == (world, policy)]
        figures = _pair(own, "nees", ".2g"), _pair(own, "nees_settled", ".2g"), _pair(own, "final_error", ".2g", 100.0)
        rows.append([world, policy, *figures, f"{100.0 * np.mean([cell['alarmed'][0] for cell in own]):.0f}"])
    head = ["world", "policy", "NEES", "NEES from 60 s on", "final error, %", "flights with an alarm, %"]
    flown = "{episodes} {split} episodes a cell; revision ".format(**results["settings"])
    ended = sum(sum(cell["ended"]) for cell in cells)
    flown += f"{results['revision'][:7]}; {ended or 'none'} of {2 * results['settings']['episodes'] * len(cells)} "
    flown += "flights ended early."
    return table(head, rows, text_columns=2) + "\n\n" + flown


def rate_loops_table(results: Mapping[str, Any]) -> str:
    """Time outside and final error through the rate loops, by world: the worst satellite, and the range."""
    cells: Sequence[Cell] = results["cells"]
    controls = tuple(dict.fromkeys(cell["control"] for cell in cells))
    rows = []
    for world in dict.fromkeys(cell["world"] for cell in cells):
        figures = []
        for control in controls:
            own = [cell for cell in cells if (cell["world"], cell["control"]) == (world, control)]
            errors = [100.0 * cell["final_error"] for cell in own]
            spread = f"{min(errors):.2g}" + (f" to {max(errors):.2g}" if len(errors) > 1 else "")
            figures += [f"{100.0 * max(cell['outside_fraction'] for cell in own):.2f}", spread]
        rows.append([world, *figures])
    head = ["world", *(text for control in controls for text in (f"{control}: outside, %", "final error, %"))]
    flown = "{episodes} validation episodes a cell, inertia {inertia}; revision ".format(**results["settings"])
    return table(head, rows, text_columns=1) + f"\n\n{flown}{results['revision'][:7]}."


def gate_table(results: Mapping[str, Any]) -> str:
    """Ladder of a scenario, from nothing to the oracle."""
    rows = []
    for own in results["rows"]:
        worst = max(own["costs"], key=own["costs"].get)
        rows.append(
            [
                f"`{own['policy']}`" if own["policy"] != "oracle" else "oracle",
                ", ".join(f"{k} {v if isinstance(v, str) else f'{v:g}'}" for k, v in own["settings"].items()),
                "-" if own["expected"] is None else f"{100.0 * own['expected']:.3f}",
                "-" if own["over_oracle"] is None else f"{own['over_oracle']:.2f}",
                f"{100.0 * own['final_error']:.3f}",
                f"{own['nees']:.2f} ({own['nees_median']:.2f})",
                f"{worst} {100.0 * own['costs'][worst]:.2f}" if own["costs"][worst] > 0.0 else "none",
                f"{100.0 * own['terminated']:.0f}",
            ]
        )
    head = ["expected error, %", "over the oracle", "final error, %", "NEES (median)", "largest cost, %", "ended, %"]
    if all("expected_at_end" in own for own in results["rows"]):
        head.insert(2, "expected at the end, %")
        for cells, own in zip(rows, results["rows"], strict=True):
            value = own["expected_at_end"]
            cells.insert(4, "-" if value is None else f"{100.0 * value:.3f}")
    if results["settings"]["oracle"] == 0:
        column = head.index("over the oracle")
        head[column] = "ms a decision"
        for cells, own in zip(rows, results["rows"], strict=True):
            cells[2 + column] = f"{own['decision_ms']:.2g}"
    said = "Scenario {scenario}, {satellite}, {inertia}: {tuned} tuning and {episodes} validation episodes"
    if results["settings"]["oracle"] > 0:
        said += ", {oracle} of these for the oracle"
    said += ". The expected error is the filter's own, mean over the flight. Revision "
    said = said.format(**results["settings"])
    return table(["policy", "settings", *head], rows, text_columns=2) + f"\n\n{said}{results['revision'][:7]}."


def ladders_table(results: Mapping[str, Any]) -> str:
    """Rows are scenarios on a satellite, columns kinds of policies; where the flights come from below it."""
    settings, flown = results["settings"], results["rows"]
    steps = {
        (scenario, satellite): {
            step["rung"]: step
            for step in ladder([row for row in flown if (row["scenario"], row["satellite"]) == (scenario, satellite)])
        }
        for scenario, satellite in itertools.product(settings["scenarios"], settings["satellites"])
    }
    shown = [rung for rung in RUNGS if any(rung in rungs for rungs in steps.values())]

    def cell(step: Mapping[str, Any] | None) -> str:
        if step is None:
            return "-"
        star = "" if step["inside"] == step["cells"] else "\\*"
        error = "ended early" if step["expected"] is None else f"{100.0 * step['expected']:.3g}"
        over = "" if step["over_best"] is None else f" ({step['over_best']:.2f})"
        text = f"`{step['policy']}`{star} {error}{over}"
        return f"**{text}**" if step["over_best"] == 1.0 else text

    rows = [
        [f"`{scenario}`", satellite, *(cell(rungs.get(rung)) for rung in shown)]
        for (scenario, satellite), rungs in steps.items()
    ]
    head = ["scenario", "satellite", *(RUNGS[rung] for rung in shown)]
    revisions = sorted({row["revision"][:7] for row in flown})
    judged = [row for row in flown if row.get("nees") is not None]
    consistent, worst = sum(map(is_consistent, judged)), max(row["nees"] for row in judged)
    source = (
        f"Inertia {', '.join(settings['inertias'])}; {settings['episodes']} {results['seeds']['split']} episodes a cell"
        + (f", {settings['oracle']} of the oracle" if settings["oracle"] else "")
        + f"; mean NEES in [0.3, 2] in {consistent} of {len(judged)} cells of all policies, at most {worst:.1f}"
        + f"; revision {', '.join(revisions)}; `{results['command']}`."
    )
    return table(head, rows, text_columns=2 + len(shown)) + "\n\n" + source


def basilisk_table(results: Mapping[str, Any]) -> str:
    """Scores on Basilisk's truth and on the environment's own, by row and policy, and how many are within 5 %."""
    cells: Sequence[Cell] = [cell for cell in results["cells"] if cell["own"] is not None]
    rows = []
    for cell in cells:
        own, theirs = cell["own"], cell["basilisk"]
        outside = (f"{100.0 * truth['outside_fraction']:.2f}" for truth in (theirs, own))
        rows.append(
            [
                cell["row"],
                f"`{cell['policy']}`",
                *(f"{100.0 * truth['final_error']:.3g}" for truth in (theirs, own)),
                f"{theirs['final_error'] / own['final_error']:.3f}",
                *(f"{truth['nees']:.3g}" for truth in (theirs, own)),
                f"{theirs['nees'] / own['nees']:.3f}",
                " / ".join(outside),
                ", ".join(f"{cell['flights_apart'][name]:.0e}" for name in ("median", "largest")),
            ]
        )
    head = ["row", "policy", "final error, %: Basilisk", "own", "ratio", "NEES: Basilisk", "own", "ratio"]
    head += ["outside, %: Basilisk / own", "errors of a flight apart: median, largest"]
    both = [cell for cell in cells if "imbalance" not in cell["row"]]
    close = [abs(cell["basilisk"][name] / cell["own"][name] - 1.0) for cell in both for name in ("final_error", "nees")]
    within = sum(apart <= 0.05 for apart in close)
    said = "Microsat, static inertia, {episodes} validation episodes of 300 s a cell; revision ".format(
        **results["settings"]
    )
    said += f"{results['revision'][:7]}{_later(cells)}. Where both truths model the same, {within} of {len(close)} "
    return table(head, rows, text_columns=2) + "\n\n" + said + "ratios are within 5 %."


def _later(cells: Sequence[Cell]) -> str:
    """Which cells were flown again, or first, at a revision of their own."""
    found: dict[str, dict[str, list[str]]] = {}
    for cell in cells:
        if "revision" in cell:
            found.setdefault(cell["revision"], {}).setdefault(cell["row"], []).append(f"`{cell['policy']}`")
    named = (
        f"; of {revision[:7]} " + "; ".join(f"{row}: {', '.join(own)}" for row, own in rows.items())
        for revision, rows in found.items()
    )
    return "".join(named)
