"""Entrants of a comparison: names, files and modules resolved, each with a name that no other has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from agents.benchmark.cell import misfit
from baselines import BASELINES
from baselines.tuning.by_rates import all_baselines, baselines_of
from baselines.tuning.prepared import Prepared
from satid_gym.config import unknown_name
from satid_gym.laws import InertiaLaw
from satid_gym.policies.custom import digest, find_any
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.policies.learned.shipped import find, names, rate_names
from satid_gym.policies.open_loop_optimal import NotPreparedError
from satid_gym.policies.registry import PLANNERS, RATE_BASELINES, RATE_PLANNERS
from satid_gym.policy import Policy
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class Shortfall:
    """A policy that does not fly a satellite, or only with its default settings.

    Attributes:
        policy, satellite: their names.
        line: what lacks, in words.
        remedy: the command that finds a baseline's settings; "" if it has no such command.
        flies: whether it flies, with its default settings.
    """

    policy: str
    satellite: str
    line: str
    remedy: str = ""
    flies: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class Entrants:
    """Cells of a comparison and the policies that fly in them, resolved.

    Attributes:
        satellites, modes, scenario: of the cells.
        control: what actions are, "torque" or "rate".
        policies_for: policies that fly each satellite, by its name.
        shortfalls: baselines without settings for a satellite, which are left out or fly with their default ones, and
            other policies that do not fit it.
        given: policies that were named by a path or by module:name, as results tell of them.
    """

    satellites: Sequence[Satellite]
    modes: Sequence[str | InertiaLaw]
    scenario: Scenario
    control: str
    policies_for: Mapping[str, Sequence[Policy]]
    shortfalls: Sequence[Shortfall] = ()
    given: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def not_tuned(self) -> list[str]:
        """The lines of the shortfalls."""
        return [one.line for one in self.shortfalls]

    def notes(self) -> list[str]:
        """The shortfalls in brief: a line for each command that finds settings, and for each unfit policy."""
        lines = []
        for remedy in dict.fromkeys(one.remedy for one in self.shortfalls if one.remedy):
            mine = [one for one in self.shortfalls if one.remedy == remedy]
            out, flying = ([one.policy for one in mine if one.flies == flies] for flies in (False, True))
            parts = {"left out": out, "with default settings": flying}
            said = "; ".join(f"{how}: {', '.join(dict.fromkeys(own))}" for how, own in parts.items() if own)
            satellites = ", ".join(dict.fromkeys(one.satellite for one in mine))
            lines.append(f"not tuned for {satellites} ({said}): {remedy}")
        rest = [one for one in self.shortfalls if not one.remedy]
        return [*lines, *(one.line if one.flies else f"left out: {one.line}" for one in rest)]

    def definitions(self) -> dict[str, Any]:
        """All that names stand for, in full, so that a result can be reproduced without the files given."""
        laws = [mode for mode in self.modes if isinstance(mode, InertiaLaw)]
        return {
            "satellites": {satellite.name: satellite.to_dict() for satellite in self.satellites},
            "laws": {law.label: law.to_dict() for law in laws},
            "policies": {name: dict(values) for name, values in self.given.items()},
            "not_tuned": self.not_tuned,
        }


def find_entrants(
    *,
    satellites: Mapping[str, Satellite],
    modes: Sequence[str | InertiaLaw],
    scenario: tuple[str, Scenario],
    control: str,
    policies: Sequence[str],
    prepared: Prepared,
    planners: bool,
) -> Entrants:
    """Resolve who flies.

    Args:
        satellites: by the texts that they were named by.
        modes: of the inertia.
        scenario: with the text that it was named by.
        control: what actions are, "torque" or "rate".
        policies: names, paths or module:name; where none is named, all that come with the project.
        prepared: settings of baselines.
        planners: whether planners fly where no policy is named.

    Raises:
        ValueError: a policy is unknown, its name is taken, needs rate commands, or it was named and cannot fly one of
            the satellites.
        DamagedFileError: a file of settings is missing or holds none.
    """
    torque, slow = control == "torque", () if planners else (*PLANNERS, *RATE_PLANNERS)
    if policies:
        baselines = [name for name in all_baselines(scenario[1], control) if name in policies]
        rest = [text for text in policies if text not in baselines]
    else:
        baselines = [name for name in baselines_of(scenario[1], control) if name not in slow]
        rest = names() if torque else [*names(), *rate_names()]
    own, given = others_by(rest)
    if torque:
        check_torque(own)
    texts = list(satellites.items())
    prepared.check(texts, [scenario])
    policies_for: dict[str, list[Policy]] = {satellite.name: [] for satellite in satellites.values()}
    shortfalls: list[Shortfall] = []
    for satellite in satellites.values():
        for name in baselines:
            baseline, line = prepared.find(name, satellite, scenario, texts, control)
            if baseline is not None and (unfit := misfit(baseline, satellite, modes, scenario[1], control)):
                baseline, line = None, unfit  # a law for stars or windows, where there are none
            if baseline is not None:
                policies_for[satellite.name].append(baseline)
            elif policies:
                raise NotPreparedError(line)
            if line:
                remedy = prepared.remedy(name, satellite, scenario, texts) if torque else ""
                about = {"policy": name, "satellite": satellite.name, "line": line, "remedy": remedy}
                shortfalls.append(Shortfall(**about, flies=baseline is not None))
        for policy in own:
            line = misfit(policy, satellite, modes, scenario[1], control)
            if not line:
                policies_for[satellite.name].append(policy)
            elif policies:
                raise ValueError(line)
            else:
                shortfalls.append(Shortfall(policy=policy.name, satellite=satellite.name, line=line))
    return Entrants(
        satellites=list(satellites.values()),
        modes=modes,
        scenario=scenario[1],
        control=control,
        policies_for=policies_for,
        shortfalls=shortfalls,
        given=given,
    )


def others_by(texts: Sequence[str]) -> tuple[list[Policy], dict[str, dict[str, Any]]]:
    """The policies that are no baselines, and what results tell of those that are no shipped ones either.

    Raises:
        ValueError: a text names no policy, or two policies would have one name.
    """
    found: list[Policy] = []
    given: dict[str, dict[str, Any]] = {}
    for text in texts:
        policy = entrant(text)
        if policy.name in {other.name for other in found}:
            raise ValueError(f"two policies have the name {policy.name!r}: tell them apart by NAME={_path(text)}")
        found.append(policy)
        if text not in (*names(), *rate_names()):
            given[policy.name] = _origin(policy, text)
    return found, given


def _origin(policy: Policy, text: str) -> dict[str, Any]:
    """What tells a policy that did not come with the project from others."""
    if not isinstance(policy, LearnedPolicy):
        return {"sha256": digest(policy), "module": _path(text)}
    return {"sha256": digest(policy), **policy.settings, "trained": policy.details.get("trained")}


def entrant(text: str) -> Policy:
    """A policy that is no baseline: learned, by name or path, or of the user's own code, by module:name.

    Raises:
        ValueError: there is no such policy, or it has the name of a baseline or, without being it, of a shipped one.
    """
    shipped = [*names(), *rate_names()]
    try:
        policy = find_any(text)
    except ValueError as error:
        if not isinstance(error.__cause__, FileNotFoundError):
            raise
        if text in RATE_BASELINES:
            raise ValueError(f"{text} commands body rates: add --control rate") from error
        if text in BASELINES:
            raise ValueError(
                f"{text!r} is a baseline, and another policy was expected, one of {shipped}, a path or module:name: "
                f"baselines fly next to it (--against {text}), or by themselves (python -m agents.compare --policies "
                f"{text})"
            ) from error
        raise unknown_name("policy (no such file either)", text, [*shipped, *BASELINES]) from error
    itself = policy.name in shipped and digest(find(policy.name)) == digest(policy)
    if policy.name in (*BASELINES, *RATE_BASELINES, *shipped) and not itself:
        raise ValueError(
            f"the policy of {text} has the name {policy.name!r}, and so has one that comes with the project: give it "
            f"another one, NAME={_path(text)}"
        )
    return policy


def check_torque(policies: Sequence[Policy]) -> None:
    """Refuse policies that the torque commands of a comparison cannot carry out.

    Raises:
        ValueError: some command body rates that only the environment's own rate loop flies.
    """
    learned = [policy for policy in policies if isinstance(policy, LearnedPolicy)]
    if found := [policy.name for policy in learned if (policy.control, policy.observation) == ("rate", "body")]:
        raise ValueError(
            f"{', '.join(found)}: observes the body and commands body rates, and actions are torques of each wheel: "
            "add --control rate"
        )


def _path(text: str) -> str:
    return text.rpartition("=")[2]
