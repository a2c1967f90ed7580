"""Files with the settings of baselines, and what to do where a satellite or scenario lacks them."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from baselines import build, make_baseline
from baselines.tuning.by_rates import by_rates
from satid_gym.files import read_json
from satid_gym.policies.open_loop_optimal import DESIGNS, NotPreparedError, OpenLoopOptimalPolicy
from satid_gym.policies.rate_square import RateSquarePolicy, untuned_rate_square
from satid_gym.policies.registry import PLANNERS, TUNED
from satid_gym.policy import Policy
from satid_gym.satellite import SATELLITES, Satellite
from satid_gym.scenario import Scenario
from satid_gym.scenario_catalogue import SCENARIOS
from satid_gym.selection import select_satellites, select_scenarios


@dataclass(frozen=True, kw_only=True)
class Prepared:
    """Files with settings of baselines for custom satellites and scenarios."""

    tuned: Path = TUNED
    """Settings found by baselines.tune; what the file lacks is taken from the shipped one."""
    designs: Path = DESIGNS
    """Open-loop designs of baselines.tuning.open_loop_design, likewise."""

    def check(self, satellites: Sequence[tuple[str, Satellite]], scenarios: Sequence[tuple[str, Scenario]]) -> None:
        """Refuse settings that were found for other satellites or scenarios of the same names.

        Raises:
            ValueError: a file was made for another one.
            DamagedFileError: a file is missing or holds no settings.
        """
        for file, module in ((self.tuned, "baselines.tune"), (self.designs, "baselines.tuning.open_loop_design")):
            made = read_json(file, f"python -m {module} writes it", keys=["entries"])
            for kind, chosen in (("satellites", satellites), ("scenarios", scenarios)):
                for text, own in chosen:
                    known = made.get("definitions", {}).get(kind, {}).get(own.name)
                    if known is not None and known != own.to_dict():
                        raise ValueError(
                            f"{file} was made for another {own.name} than that of {text}: run python -m {module} "
                            f"--{kind} {text} again"
                        )

    def find(
        self,
        name: str,
        satellite: Satellite,
        scenario: tuple[str, Scenario],
        flown: Sequence[tuple[str, Satellite]],
        control: str = "torque",
    ) -> tuple[Policy | None, str]:
        """A baseline for a satellite, one of those `flown`, and what is to be said of it.

        Planners that were not tuned fly with their default margin, `rate_square` as the data sheet suggests; what has
        no default is None. By body rates see `by_rates`. Texts are what satellites and scenario were named by; the line
        has the command that finds settings for all that lack them.
        """
        world = scenario[1]
        if control == "rate":
            return by_rates(name, satellite, world)
        try:
            return make_baseline(name, satellite.name, world.name, tuned=self.tuned, designs=self.designs), ""
        except NotPreparedError:
            line = f"{name} has no settings for satellite {satellite.name!r} in scenario {world.name!r}: "
            line += self.remedy(name, satellite, scenario, flown)
        if name in PLANNERS:
            return build(name, {}), f"{line} (meanwhile it flies with its default margin)"
        if name == RateSquarePolicy.name:
            policy = untuned_rate_square(satellite, world.horizon)
            return policy, f"{line} (meanwhile its settings are made of the data sheet)"
        return None, line

    def remedy(
        self, name: str, satellite: Satellite, scenario: tuple[str, Scenario], flown: Sequence[tuple[str, Satellite]]
    ) -> str:
        """The command that finds a baseline's settings for all satellites that lack them; arguments as of `find`."""
        text, world = scenario
        lacking = [given for given, own in flown if own.name not in SATELLITES or world.name not in SCENARIOS]
        module, option, file = "baselines.tune", "--tuned", "my_tuned.json"
        if name == OpenLoopOptimalPolicy.name:
            module, option, file = "baselines.tuning.open_loop_design", "--designs", "my_designs.json"
        search = [
            "python",
            "-m",
            module,
            "--satellites",
            *(lacking or [satellite.name]),
            "--scenarios",
            text,
            "--output",
            file,
        ]
        return f"run {shlex.join(search)} and add {option} {file}"

    def policy(
        self,
        name: str,
        satellite: Satellite,
        scenario: tuple[str, Scenario],
        flown: Sequence[tuple[str, Satellite]],
        control: str = "torque",
    ) -> Policy:
        """A baseline for a satellite; unlike `find`, it prints what is to be said, and raises where it has no settings.

        Raises:
            NotPreparedError: it has no settings; the message has the command that finds them.
        """
        policy, line = self.find(name, satellite, scenario, flown, control)
        if policy is None:
            raise NotPreparedError(line)
        if line:
            print(f"note: {line}", file=sys.stderr)
        return policy


def check_output(satellites: Sequence[str], scenarios: Sequence[str], output: Path, shipped: Path) -> None:
    """Refuse invalid satellites and scenarios, and writing custom ones to a shipped file.

    Raises:
        ValueError: one is unknown, not valid or has the name of another, or would be written among the shipped.
        DamagedFileError: the output is a file of something else.
    """
    given = [s.name for s in select_satellites(satellites)] + [s.name for s in select_scenarios(scenarios)]
    own = [name for name in given if name not in SATELLITES and name not in SCENARIOS]
    if own and output.resolve() == shipped.resolve():
        raise ValueError(f"{', '.join(own)} would replace the settings that are shipped: add --output FILE.json")
    _stored(output)


def definitions(satellites: Sequence[Satellite], scenarios: Sequence[Scenario]) -> dict[str, Any]:
    """In full, the satellites and scenarios that no catalogue has."""
    return {
        "satellites": {s.name: s.to_dict() for s in satellites if s.name not in SATELLITES},
        "scenarios": {s.name: s.to_dict() for s in scenarios if s.name not in SCENARIOS},
    }


def merged(file: Path, made: Mapping[str, Any]) -> dict[str, Any]:
    """What a search found, and those entries of a file that it did not find again.

    Each entry names its revision, as the head is of the last search alone.
    Entries for a satellite or scenario that has another definition now are left out.

    Raises:
        DamagedFileError: it is a file of something else.
    """
    old = _stored(file)
    known: dict[str, dict[str, Any]] = old.get("definitions", {})
    now = {kind: {**known.get(kind, {}), **own} for kind, own in made["definitions"].items()}
    void = {name for kind, own in known.items() for name, value in own.items() if now[kind][name] != value}
    entries = {}
    for head in (old, made):
        for entry in head["entries"]:
            if head is made or not void & {entry["satellite"], entry["scenario"]}:
                key = entry.get("policy"), entry["satellite"], entry["scenario"]
                entries[key] = {"revision": head.get("revision"), **entry}
    return {**made, "definitions": now, "entries": list(entries.values())}


def _stored(file: Path) -> dict[str, Any]:
    """The file, if there is one, else one without entries."""
    return read_json(file, "give another --output", keys=["entries"]) if file.exists() else {"entries": []}
