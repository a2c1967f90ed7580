"""Tables of the filter's consistency for the pages, from consistency.json and star_tracker.json of docs/results."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from agents.docs.readme import REMEDY, RESULTS
from baselines.command.markdown import table
from baselines.studies.worlds.catalogue import WORLDS
from satid_gym.files import read_json

_GROUPS = (("rate_square",), ("multi_step", "sine"), ("one_step", "zero"))  # policies by how they excite the body

Cell = Mapping[str, Any]


def consistency(write: Callable[[Mapping[str, Any]], str], study: str = "consistency") -> str:
    """A table of the filter's consistency, from a committed study."""
    return write(read_json(RESULTS / f"{study}.json", REMEDY, keys=("cells", "settings", "revision")))


def _shown(nees: float) -> str:
    return f"{nees:.2f}" if nees < 100.0 else f"{nees:.0e}".replace("e+0", "e")


def _span(values: Sequence[float]) -> str:
    return f"{_shown(min(values))} to {_shown(max(values))}"


def _errors(cells: Sequence[Cell]) -> str:
    errors = [100.0 * cell["final_error"] for cell in cells]
    return f"{min(errors):.2g} to {max(errors):.2g}"


def _by_world(results: Mapping[str, Any], *topics: str) -> dict[str, list[Cell]]:
    """Cells by world, in the order of `WORLDS`, of those of some topics."""
    cells: Sequence[Cell] = results["cells"]
    flown = {cell["world"] for cell in cells}
    names = [name for name, world in WORLDS.items() if name in flown and world.topic in topics]
    return {name: [cell for cell in cells if cell["world"] == name] for name in names}


def _policies(cells: Iterable[Cell], group: Sequence[str]) -> str:
    """Those of a group that the cells are of."""
    flown = {cell["policy"] for cell in cells}
    return ", ".join(policy for policy in group if policy in flown)


def _heads(worlds: Mapping[str, Sequence[Cell]]) -> list[str]:
    """Head of each group's column: its policies that any of the worlds was flown with."""
    cells = [cell for own in worlds.values() for cell in own]
    return [f"{_policies(cells, group)}: NEES" for group in _GROUPS]


def _flown(results: Mapping[str, Any], worlds: Mapping[str, Sequence[Cell]]) -> str:
    """What was flown, below a table, and in which worlds it was less than the head says."""
    cells = [cell for own in worlds.values() for cell in own]
    revisions = sorted({cell.get("revision", results["revision"])[:7] for cell in cells})
    text = f"\n\n{results['settings']['episodes']} validation episodes a cell; revision {', '.join(revisions)}."
    for name, own in worlds.items():
        fewer = [
            ", ".join(dict.fromkeys(cell[key] for cell in own))
            for key in ("policy", "inertia")
            if {cell[key] for cell in own} < {cell[key] for cell in cells}
        ]
        text += f" {name}: {'; '.join(fewer)} alone." if fewer else ""
    return text


def consistency_table(results: Mapping[str, Any], topic: str = "calibration") -> str:
    """Final error of the first group and NEES of each, over satellites and inertia modes, world by world."""
    return _spans(results, _by_world(results, topic))


def tracker_table(results: Mapping[str, Any]) -> str:
    """The same of the study with and without star tracker."""
    return _spans(results, _by_world(results, "calibration", "tracker"))


def _spans(results: Mapping[str, Any], worlds: Mapping[str, Sequence[Cell]]) -> str:
    rows = []
    for world, own in worlds.items():
        groups = [[cell for cell in own if cell["policy"] in policies] for policies in _GROUPS]
        spans = (_span([cell["nees"] for cell in cells]) if cells else "-" for cells in groups)
        rows.append([world, _errors(groups[0]), *spans])
    head = ["world", "rate_square: error, %", *_heads(worlds)]
    return table(head, rows, text_columns=1) + _flown(results, worlds)


def timing_table(results: Mapping[str, Any]) -> str:
    """The same for sensors that are late, average or count, with cells in which the inertia steps by themselves.

    Of those the median over episodes: the mean is that of the few in which a decision ends before a late filter has
    seen the step.
    """
    worlds, rows = _by_world(results, "timing"), []
    for world, own in worlds.items():
        square = [cell for cell in own if cell["policy"] == "rate_square"]
        smooth = [[c for c in own if c["policy"] in p and c["inertia"] != "step"] for p in _GROUPS]
        stepped = [cell for cell in square if cell["inertia"] == "step"]
        medians, means = _span([c["nees_median"] for c in stepped]), _span([c["nees"] for c in stepped])
        rows.append([world, _errors(square), *(_span([c["nees"] for c in cells]) for cells in smooth), medians, means])
    head = ["world", "rate_square: error, %", *_heads(worlds)]
    head += ["rate_square, step: median NEES", "mean NEES"]
    return table(head, rows, text_columns=1) + _flown(results, worlds)
