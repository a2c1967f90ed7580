"""Entrants of a comparison: names, files and modules resolved, each with a name that no other has."""

from __future__ import annotations

import copy
import hashlib
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from baselines import BASELINES, build, make_baseline
from satid_gym.config import unknown_name
from satid_gym.files import read_json
from satid_gym.laws import InertiaLaw
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.policies.open_loop_optimal import DESIGNS, NotPreparedError, OpenLoopOptimalPolicy
from satid_gym.policies.registry import PLANNERS, TUNED
from satid_gym.policies.shipped import find, names
from satid_gym.policy import Policy, missions, observation_settings
from satid_gym.problem import problem
from satid_gym.satellite import SATELLITES, Satellite
from satid_gym.scenario import Scenario
from satid_gym.scenario_catalogue import SCENARIOS


@dataclass(frozen=True, eq=False, kw_only=True)
class Entrants:
    """Cells of a comparison and the policies that fly in them, resolved.

    Attributes:
        satellites, modes, scenario: of the cells.
        policies_for: policies that fly each satellite, by its name.
        not_tuned: lines that say which baselines have no settings for a satellite and are left out, or fly with their
            default ones, and which command finds them; and which learned policies do not fit it.
        given: learned policies that were named by a path, as results tell of them.
    """

    satellites: Sequence[Satellite]
    modes: Sequence[str | InertiaLaw]
    scenario: Scenario
    policies_for: Mapping[str, Sequence[Policy]]
    not_tuned: Sequence[str] = ()
    given: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def definitions(self) -> dict[str, Any]:
        """All that names stand for, in full, so that a result can be reproduced without the files given."""
        laws = [mode for mode in self.modes if isinstance(mode, InertiaLaw)]
        return {
            "satellites": {satellite.name: satellite.to_dict() for satellite in self.satellites},
            "laws": {law.label: law.to_dict() for law in laws},
            "policies": {name: dict(values) for name, values in self.given.items()},
            "not_tuned": list(self.not_tuned),
        }


def find_entrants(
    *,
    satellites: Mapping[str, Satellite],
    modes: Sequence[str | InertiaLaw],
    scenario: tuple[str, Scenario],
    policies: Sequence[str],
    prepared: Prepared,
    planners: bool,
) -> Entrants:
    """Resolve who flies.

    Args:
        satellites: by the texts that they were named by.
        modes: of the inertia.
        scenario: with the text that it was named by.
        policies: names or paths; where none is named, all that come with the project.
        prepared: settings of baselines.
        planners: whether planners fly where no policy is named.

    Raises:
        ValueError: a policy is unknown, its name is taken, or it was named and cannot fly one of the satellites.
        DamagedFileError: a file of settings is missing or holds none.
    """
    networks, given = learned_by(policies or names())
    baselines = [
        name for name in BASELINES if (name in policies if policies else planners or not BASELINES[name].planner)
    ]
    texts = list(satellites.items())
    prepared.check(texts, [scenario])
    policies_for: dict[str, list[Policy]] = {satellite.name: [] for satellite in satellites.values()}
    not_tuned: list[str] = []
    for satellite in satellites.values():
        for name in baselines:
            baseline, line = prepared.find(name, satellite, scenario, texts)
            if baseline is not None:
                policies_for[satellite.name].append(baseline)
            elif policies:
                raise NotPreparedError(line)
            if line:
                not_tuned.append(line)
        for policy in networks:
            line = misfit(policy, satellite, modes, scenario[1])
            if not line:
                policies_for[satellite.name].append(policy)
            elif policies:
                raise ValueError(line)
            else:
                not_tuned.append(line)
    return Entrants(
        satellites=list(satellites.values()),
        modes=modes,
        scenario=scenario[1],
        policies_for=policies_for,
        not_tuned=not_tuned,
        given=given,
    )


@dataclass(frozen=True, kw_only=True)
class Prepared:
    """Files with settings of baselines for satellites and scenarios of one's own."""

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
        self, name: str, satellite: Satellite, scenario: tuple[str, Scenario], flown: Sequence[tuple[str, Satellite]]
    ) -> tuple[Policy | None, str]:
        """A baseline for a satellite, one of those `flown`, and what is to be said of it.

        Planners that were not tuned fly with their default margin; what has no default is None. Texts are what
        satellites and scenario were named by; the line has the command that finds settings for all that lack them.
        """
        text, world = scenario
        try:
            return make_baseline(name, satellite.name, world.name, tuned=self.tuned, designs=self.designs), ""
        except NotPreparedError:
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
        line = (
            f"{name} has no settings for satellite {satellite.name!r} in scenario {world.name!r}: "
            f"run {shlex.join(search)} and add {option} {file}"
        )
        if name in PLANNERS:
            return build(name, {}), f"{line} (meanwhile it flies with its default margin)"
        return None, line

    def policy(
        self, name: str, satellite: Satellite, scenario: tuple[str, Scenario], flown: Sequence[tuple[str, Satellite]]
    ) -> Policy:
        """The same where it must not be missing.

        Raises:
            NotPreparedError: it has no settings; the message has the command that finds them.
        """
        policy, line = self.find(name, satellite, scenario, flown)
        if policy is None:
            raise NotPreparedError(line)
        return policy


def learned_by(texts: Sequence[str]) -> tuple[list[LearnedPolicy], dict[str, dict[str, Any]]]:
    """The learned policies among texts that may name baselines as well, and what results tell of those given by path.

    Raises:
        ValueError: a text is neither a name nor a policy's path, or two policies would have one name.
    """
    found: list[LearnedPolicy] = []
    given: dict[str, dict[str, Any]] = {}
    for text in texts:
        if text in BASELINES:
            continue
        policy = learned(text)
        if policy.name in {other.name for other in found}:
            raise ValueError(f"two policies have the name {policy.name!r}: tell them apart by NAME={_path(text)}")
        found.append(policy)
        if text not in names():
            tensors = {name: tensor.tobytes() for name, tensor in sorted(policy.network.tensors().items())}
            digest = hashlib.sha256(b"".join(tensors.values())).hexdigest()
            given[policy.name] = {"weights_sha256": digest, "margin": policy.margin, "control": policy.control}
            given[policy.name] |= {"trained": policy.details.get("trained")}
    return found, given


def learned(text: str) -> LearnedPolicy:
    """A learned policy by name, path or NAME=PATH.

    Raises:
        ValueError: there is no such policy, or it has the name of a baseline or, given by its path, of a shipped one.
    """
    try:
        policy = find(text)
    except ValueError as error:
        if isinstance(error.__cause__, FileNotFoundError):
            raise unknown_name("policy (no such file either)", text, [*names(), *BASELINES]) from error
        raise
    if text not in names() and policy.name in (*BASELINES, *names()) and not _is_shipped(policy):
        raise ValueError(
            f"the policy of {text} has the name {policy.name!r}, and so has one that comes with the project: give it "
            f"another one, NAME={_path(text)}"
        )
    return policy


def misfit(policy: Policy, satellite: Satellite, modes: Sequence[str | InertiaLaw], scenario: Scenario) -> str:
    """Why a policy cannot fly a satellite, such as other numbers of wheels or parameters; "" where it can."""
    for mode in modes:
        posed = problem(satellite, mode, scenario, **observation_settings(policy))
        try:
            copy.copy(policy).reset(missions(posed)[0], [0])
        except ValueError as error:
            return f"satellite {satellite.name!r}: {error}"
    return ""


def _is_shipped(policy: LearnedPolicy) -> bool:
    """Whether it is the shipped policy itself, by another path."""
    if policy.name not in names():
        return False
    own = find(policy.name).network.tensors()
    given = policy.network.tensors()
    return own.keys() == given.keys() and all((own[name] == given[name]).all() for name in own)


def _path(text: str) -> str:
    return text.rpartition("=")[2]
