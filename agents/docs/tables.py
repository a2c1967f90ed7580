"""Tables of docs/, written from the code and from committed results: `python -m agents.docs.tables`.

Names and values come from the objects, meanings from their docstrings, scores from docs/results.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import Any

import docstring_parser

from agents.docs import faults_table, results_tables
from agents.docs import world_tables as worlds
from agents.docs.consistency_table import consistency, consistency_table, timing_table, tracker_table
from agents.docs.limits_figure import share_table
from agents.docs.readme import REMEDY, RESULTS, ROOT, between
from agents.docs.specification import satellites, section_table, vector_arguments
from agents.unseen.table import unseen, unseen_flex
from baselines import BASELINES, build, tuned_entry
from baselines.command import cli
from baselines.command.markdown import table
from satid_gym import Sensors, StarTracker, Tolerances, WheelPyramid
from satid_gym.appendages import Appendages
from satid_gym.config import Config
from satid_gym.estimators import MomentumEKFSettings
from satid_gym.estimators.settings import EstimatorSettings
from satid_gym.faults import Faults
from satid_gym.files import read_json, write_text
from satid_gym.law_ranges import PAPER_LAWS, LawRanges
from satid_gym.operations import Operations
from satid_gym.reward import RewardSettings
from satid_gym.satellite import BENCHMARK_SATELLITES
from satid_gym.scenario import Scenario
from satid_gym.scenario_catalogue import SCENARIOS

SOURCE = "agents.docs.tables"
_SHOWN_ELSEWHERE = ("name", "laws", "faults", "appendages", "wheels", "operations")  # in tables of their own


def meanings(cls: type) -> dict[str, str]:
    """Meaning of each attribute, from the docstrings of the class and its bases."""
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        parsed = docstring_parser.parse(base.__dict__.get("__doc__") or "", docstring_parser.DocstringStyle.GOOGLE)
        found |= {p.arg_name: " ".join((p.description or "").split()).removesuffix(".") for p in parsed.params}
    return found


def shown(value: Any) -> str:
    """A setting's value for a table."""
    if value is None:
        return "the satellite's"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, tuple | list):
        return (" to " if len(value) == 2 else ", ").join(shown(v) for v in value)
    if isinstance(value, EstimatorSettings):  # its name, and what differs from the filter's defaults
        own = value.to_dict()
        default = type(value).from_dict({"adaptive": True} if own.get("adaptive") else {}).to_dict()
        changed = {k: v for k, v in own.items() if v != default[k] or v is True}
        return shown({"name": own["name"], **changed})
    if isinstance(value, Tolerances | Sensors):  # a scenario's own, in tables of their own
        return "below"
    if isinstance(value, Mapping):
        return ", ".join(v if k == "name" else f"{k}: {shown(v)}" for k, v in value.items()) or "1"  # no factors
    return str(value)


def scenarios() -> str:
    """Every setting of every scenario; a blank is the default's value."""
    said, default = meanings(Scenario), SCENARIOS["default"]
    rows = []
    for field in dataclasses.fields(Scenario):
        if field.name in _SHOWN_ELSEWHERE:
            continue
        values = [getattr(s, field.name) for s in SCENARIOS.values()]
        cells = [
            shown(v) if s is default or v != values[0] else "" for v, s in zip(values, SCENARIOS.values(), strict=True)
        ]
        rows.append([f"`{field.name}`", *cells, said[field.name]])
    return table(["setting", *SCENARIOS, "meaning"], rows)


def appendages() -> str:
    """Panels and tanks that scenarios give their satellites."""
    given = {name: s.appendages for name, s in SCENARIOS.items() if s.appendages is not None}
    said = meanings(Appendages) | {name: text for own in given.values() for name, text in meanings(type(own)).items()}
    rows = [
        [f"`{name}`", *(shown(getattr(own, name)) if hasattr(own, name) else "" for own in given.values()), said[name]]
        for name in said
    ]
    return table(["setting", *given, "meaning"], rows)


def laws() -> str:
    """Ranges of the inertia laws: randomised, and the paper's."""
    said, drawn = meanings(LawRanges), LawRanges()
    rows = [
        [
            f"`{name}`",
            shown(own := getattr(drawn, name)),
            "" if own == (of := getattr(PAPER_LAWS, name)) else f"{of[0]:g}",
            said[name],
        ]
        for name in _names(LawRanges)
    ]
    ranged = ", ".join(name for name, scenario in SCENARIOS.items() if scenario.laws == drawn)
    return table(["range", ranged, "paper, benchmark", "meaning"], rows)


def faults() -> str:
    """Settings of faults: none, and those of the scenario that has them."""
    said, none, given = meanings(Faults), Faults(), SCENARIOS["faults"].faults
    rows = [[f"`{n}`", shown(getattr(none, n)), shown(getattr(given, n)), said[n]] for n in _names(Faults)]
    return table(["setting", "default", "scenario faults", "meaning"], rows)


def settings(cls: type[Config], given: Config | None = None) -> str:
    """Fields of a settings class with their defaults, or with the values `given`."""
    said, own = meanings(cls), cls() if given is None else given
    rows = [[f"`{name}`", _default(getattr(own, name)), said[name]] for name in _names(cls)]
    return table(["setting", "default" if given is None else "value", "meaning"], rows)


def sighted(scenario: str, cls: type[Config], part: str) -> Callable[[], str]:
    """Writer of a part of a scenario's settings, and those of its star tracker."""
    own = SCENARIOS[scenario]
    assert own.sensors is not None
    tracker = own.sensors.star_tracker
    return lambda: "\n\n".join((settings(cls, getattr(own, part)), settings(StarTracker, tracker)))


def _default(value: Any) -> str:
    return "`None`" if value is None else shown(value)


def _names(cls: type) -> list[str]:
    return [field.name for field in dataclasses.fields(cls)]


def baselines() -> str:
    """Every baseline, its kind, and its settings in the default scenario."""
    rows = []
    for name, baseline in BASELINES.items():
        tuned = {s: tuned_entry(name, s)["settings"] for s in BENCHMARK_SATELLITES} if baseline.tuned else {}
        kind = build(name, next(iter(tuned.values()), {})).kind.replace("_", " ")
        cells = [", ".join(f"{k} {v:g}" for k, v in tuned.get(s, {}).items()) for s in BENCHMARK_SATELLITES]
        rows.append([f"`{name}`", kind, *cells])
    return table(["name", "kind", *BENCHMARK_SATELLITES], rows)


def compared(write: Callable[[Mapping[str, Any]], str]) -> Callable[[], str]:
    """A writer, bound to the committed comparison."""
    keys = ("records", "pairs", "efficiencies", "revision", "command")
    return lambda: write(read_json(RESULTS / "compare.json", REMEDY, keys=keys))


PAGES: dict[str, dict[str, Callable[[], str]]] = {
    "scenarios.md": {
        "satellites": satellites,
        "scenarios": scenarios,
        "appendages": appendages,
        "calibration": sighted("calibration", Tolerances, "tolerances"),
        "operations": sighted("operations", Operations, "operations"),
        "wheels": lambda: settings(WheelPyramid, SCENARIOS["wheels4"].wheels),
        "gate": worlds.gates,
        "planners": worlds.planners,
        "looking ahead": worlds.looking_ahead,
        "ahead in pairs": worlds.pairs("calibration", "lookahead", "stargazer filter_mpc mpc swing_and_stop"),
        "laws": laws,
        "faults": faults,
    },
    "standing.md": {"ladders": worlds.ladders, "seeds": worlds.seeds},
    "training.md": {
        "unseen": unseen,
        "unseen with panels": unseen_flex,
        "stars": worlds.pairs("calibration", "stargazer", "prbs rate_square mpc swing_and_stop filter_mpc"),
        "panels": worlds.pairs("flex", "panel_tour", "shaped_square spared_square filter_mpc"),
        "tank": worlds.pairs("slosh", "tank_tour", "spared_square corner_tour filter_mpc"),
        "band": worlds.pairs("wheels4", "clear_tour", "clear_square mpc"),
        "windows": worlds.pairs("operations", "window_tour", "swing_between mpc filter_mpc"),
    },
    "estimators.md": {"momentum": lambda: settings(MomentumEKFSettings)},
    "baselines.md": {"baselines": baselines},
    "benchmark.md": {"errors": compared(results_tables.error_table), "rewards": compared(results_tables.reward_table)},
    "environment.md": {
        "observation": lambda: section_table("Observation space"),
        "body observation": lambda: section_table("Observation in the body frame"),
        "observed modes": lambda: section_table("Modes in the observation"),
        "observed attitude": lambda: section_table("Attitude in the observation"),
        "reward": lambda: settings(RewardSettings),
        "reward ranks": compared(results_tables.correlation_sentence),
        "info": lambda: section_table("Information"),
        "arguments": lambda: section_table("Arguments"),
        "vector arguments": vector_arguments,
    },
    "limits.md": {"shares": compared(share_table)},
    "faults.md": {"study": faults_table.short_table},
    "calibration.md": {
        "tolerances": lambda: settings(Tolerances),
        "consistency": lambda: consistency(consistency_table),
    },
    "flexible.md": {"flexible": lambda: consistency(functools.partial(consistency_table, topic="flexible"))},
    "sensors.md": {"sensors": lambda: settings(Sensors), "timing": lambda: consistency(timing_table)},
    "startracker.md": {
        "star tracker": lambda: settings(StarTracker),
        "consistency": lambda: consistency(tracker_table, "star_tracker"),
    },
    "unmodelled.md": {"unmodelled": worlds.unmodelled},
    "rates.md": {"rate loops": worlds.rate_loops},
    "truth.md": {"basilisk": worlds.basilisk, "tours": worlds.tours},
    "notes/every_cell.md": {
        "standing": compared(results_tables.standing_tables),
        "errors": compared(results_tables.cell_error_tables),
        "rewards": compared(results_tables.cell_reward_tables),
    },
}


def written(page: str, text: str) -> str:
    """A page with its tables written again."""
    for name, content in PAGES[page].items():
        text = between(text, name, content(), SOURCE)
    return text


def main() -> None:
    """Write the tables of all pages."""
    for page in PAGES:
        file = ROOT / "docs" / page
        write_text(file, written(page, file.read_text()))


if __name__ == "__main__":
    cli.run(main)
