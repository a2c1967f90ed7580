"""Stored figures of the planners: what an earlier comparison of the same episodes found.

Planners take most of a comparison's time, so a plain comparison does not fly them and shows their figures from a file
instead, marked and with the revision that made them. Figures of other episodes are never shown: scenario, seeds,
number of episodes, satellite, inertia and settings must be the same, and so must what the reference policies, which
have no settings, score in both.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from agents.benchmark.results import file_names, files_of, read_results
from baselines.command.provenance import portable
from satid_gym.files import DamagedFileError, read_json, write_bytes
from satid_gym.policies.registry import PLANNERS
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario

ROOT = Path(__file__).parents[2]
COMMITTED = ROOT / "docs" / "results"
KEPT = "all"  # folder for comparisons with planners that a plain one would overwrite
MARK = " (stored)"  # ends the name of a policy whose figures were not flown now
_SAME = 1e-9  # relative difference of figures up to which they are of the same flights
_KEYS = ("records", "efficiencies", "revision", "command", "seeds", "scenario", "settings", "definitions")
_FLY = "python -m agents.compare --all flies the planners"

Values = Mapping[str, Any]


def candidates(folder: Path, scenario: str) -> list[Path]:
    """Files that may hold the planners' figures, in order: the output's own, then those of the repository."""
    name = file_names(scenario)["results"]
    return [folder / name, *sorted(folder.glob(f"{KEPT}*/{name}")), COMMITTED / name]


def find_stored(files: Sequence[Path], results: Values) -> dict[str, Any]:
    """Figures of the planners from the first file that holds any for the episodes of a comparison.

    Args:
        files: results of comparisons.
        results: the present comparison, as compare.json has it, without planners.

    Returns:
        `file`, `revision` and `command` that made them (None without figures), `records` and `efficiencies` as of
        compare.json, and `notes`: sentences on what is left out and why, and on other policies whose figures differ.
    """
    notes: list[str] = []
    for file in dict.fromkeys(path for path in files if path.is_file()):
        found = _from_file(file, results)
        if found["records"]:
            return found
        notes += found["notes"]
    if not notes:
        notes = [f"no stored figures of {', '.join(PLANNERS)}: {_FLY}"]
    return {"file": None, "revision": None, "command": None, "records": [], "efficiencies": [], "notes": notes}


def with_stored(results: Values) -> dict[str, Any]:
    """Results whose records and efficiencies include the stored ones, under marked names."""
    stored = results.get("stored")
    if not stored:
        return dict(results)

    def marked(rows: Sequence[Values], **changes: Any) -> list[dict[str, Any]]:
        return [{**row, "policy": row["policy"] + MARK, "stored": True, **changes} for row in rows]

    return {
        **results,
        "records": [*results["records"], *marked(stored["records"])],
        "efficiencies": [*results["efficiencies"], *marked(stored["efficiencies"], decision_ms=None)],
    }


def keep_planners(folder: Path, results: Values) -> Path | None:
    """Copy a comparison whose planners were flown to a folder of its own, if `results` without them replace it.

    Returns:
        The folder; None if nothing would be lost.
    """
    names = files_of(results)
    old = folder / names["results"]
    try:
        records = read_results(old, "", keys=["records"])["records"]
    except DamagedFileError:
        return None  # nothing is stored, or nothing that could be read again
    lost = {r["policy"] for r in records if r["policy"] in PLANNERS} - {r["policy"] for r in results["records"]}
    if not lost:
        return None
    content = old.read_bytes()
    for number in itertools.count(1):
        kept = folder / (KEPT if number == 1 else f"{KEPT}-{number}")
        there = kept / names["results"]
        if there.is_file() and there.read_bytes() == content:
            return kept
        if not there.exists():
            break
    for file in (folder / names["curves"], folder / names["page"], old.with_suffix(".csv"), old):
        if file.is_file():
            write_bytes(kept / file.name, file.read_bytes())
    return kept


def _from_file(file: Path, results: Values) -> dict[str, Any]:
    """Planners' figures from one existing file, as of `find_stored`."""
    name = str(file.relative_to(ROOT)) if file.is_relative_to(ROOT) else portable(str(file))
    empty: dict[str, Any] = {"file": None, "revision": None, "command": None, "records": [], "efficiencies": []}
    try:
        old = read_results(file, "its figures are not shown", keys=("records", "efficiencies"))
        read_json(file, "its figures are not shown", keys=_KEYS)
    except DamagedFileError as error:
        return {**empty, "notes": [str(error)]}
    if not any(r["policy"] in PLANNERS for r in old["records"]):
        return {**empty, "notes": []}
    made = f"{name}, revision {old['revision']}"
    if reason := _other_episodes(old, results):
        return {**empty, "notes": [f"stored figures of planners are left out: those of {made} {reason}: {_FLY}"]}
    notes = _differences(old["records"], results["records"], made)
    cells = set()
    for satellite in results["settings"]["satellites"]:
        if reason := _other_satellite(old, results, satellite):
            notes.append(f"stored figures of planners are left out for {satellite}: those of {made} {reason}: {_FLY}")
        else:
            cells |= {(satellite, mode) for mode in results["settings"]["modes"]}

    def kept(rows: Sequence[Values]) -> list[Values]:
        return [r for r in rows if r["policy"] in PLANNERS and (r["satellite"], r["inertia_mode"]) in cells]

    found = {"file": name, "revision": old["revision"], "command": old["command"]}
    return {**found, "records": kept(old["records"]), "efficiencies": kept(old["efficiencies"]), "notes": notes}


def _other_episodes(old: Values, results: Values) -> str:
    """Why the episodes of two comparisons differ, for whatever satellite; "" if they do not."""
    try:
        scenario = Scenario.from_dict(old["scenario"])
    except (ValueError, TypeError) as error:
        return f"are of a scenario that this version does not have ({error})"
    if scenario != Scenario.from_dict(results["scenario"]):
        return "are of another scenario, or of a scenario with other settings"
    if old["seeds"] != results["seeds"]:
        return f"are of {_seeds(old['seeds'])}, not of {_seeds(results['seeds'])}"
    if any(name in made["settings"] for made in (old, results) for name in ("tuned", "designs")):
        return "may be of other settings of the planners, because --tuned or --designs was given"
    fresh = [r for r in results["records"] if r["kind"] == "reference"]
    if differing(old["records"], fresh):
        return "are of other flights: the reference policies, which have no settings, score differently now"
    return ""


def _other_satellite(old: Values, results: Values, satellite: str) -> str:
    """Why the episodes of a satellite differ; "" if they do not."""
    before, now = (made["definitions"]["satellites"].get(satellite) for made in (old, results))
    if before is None:
        return "do not have this satellite"
    try:
        same = Satellite.from_dict(before) == Satellite.from_dict(now)  # settings that are new have their defaults
    except (ValueError, TypeError) as error:
        return f"are of a satellite of this name that this version does not have ({error})"
    if not same:
        return "are of a satellite of this name with other values"
    flown = {r["inertia_mode"] for r in old["records"] if r["satellite"] == satellite and r["policy"] in PLANNERS}
    for mode in results["settings"]["modes"]:
        laws = [_plain(made["definitions"]["laws"].get(mode)) for made in (old, results)]
        if mode not in flown or laws[0] != laws[1]:
            return f"do not have the inertia {mode!r}"
    return ""


def differing(old: Sequence[Values], new: Sequence[Values]) -> dict[str, int]:
    """Number of cells, by policy, in which a figure that two tables of records have differs by more than 1e-9 of it."""
    before = {(r["policy"], r["satellite"], r["inertia_mode"]): r for r in old}
    found: dict[str, int] = {}
    for r in new:
        other = before.get((r["policy"], r["satellite"], r["inertia_mode"]))
        if other is not None and not all(_same(r[name], other[name]) for name in r if name in other):
            found[r["policy"]] = found.get(r["policy"], 0) + 1
    return found


def _differences(old: Sequence[Values], new: Sequence[Values], made: str) -> list[str]:
    found = differing(old, new)
    texts = ", ".join(f"{policy} in {count} cells" for policy, count in found.items())
    return [f"figures that differ from those of {made}: {texts}"] if found else []


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, float) and isinstance(other, int | float):
        return math.isclose(one, other, rel_tol=_SAME, abs_tol=1e-15)
    return bool(one == other)


def _plain(value: Any) -> Any:
    """A value as JSON gives it back."""
    return json.loads(json.dumps(value))


def _seeds(seeds: Values) -> str:
    return f"{seeds['count']} {seeds['split']} seeds from {seeds['first']}"
