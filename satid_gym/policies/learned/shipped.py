"""Shipped policies, and learned policies by name or path."""

from __future__ import annotations

from pathlib import Path

from satid_gym.config import unknown_name
from satid_gym.policies.learned.policy import LearnedPolicy, check_name

PRETRAINED = Path(__file__).parent / "pretrained"
RATE_PRETRAINED = PRETRAINED / "rate"
"""Policies for `control="rate"` alone; comparisons, which fly torques, leave them out."""


def names() -> list[str]:
    """Names of the shipped policies."""
    return sorted(path.stem for path in PRETRAINED.glob("*.safetensors"))


def rate_names() -> list[str]:
    """Names of the shipped policies that need `control="rate"`."""
    return sorted(path.stem for path in RATE_PRETRAINED.glob("*.safetensors"))


def shipped() -> list[LearnedPolicy]:
    """Shipped policies."""
    return [LearnedPolicy.load(PRETRAINED / name) for name in names()]


def find(policy: str | Path) -> LearnedPolicy:
    """Learned policy by the name of a shipped one, or by the path of its files or of its run's folder; runs no code.

    `NAME=PATH` gives it another name.

    Raises:
        ValueError: no such policy or file exists, or the name has invalid characters, or it is no text.
    """
    if not isinstance(policy, (str, Path)):
        raise ValueError(f"policy must be the name or the path of a learned policy, got {policy!r}: see names()")
    policy = str(policy)
    if policy in names():
        return LearnedPolicy.load(PRETRAINED / policy)
    if policy in rate_names():
        return LearnedPolicy.load(RATE_PRETRAINED / policy)
    name, text = renamed(policy)
    path = Path(text)
    try:
        found = LearnedPolicy.load(path / "policy" if path.is_dir() else path)
    except FileNotFoundError as error:
        if path.suffix == ".zip" and path.is_file():
            raise ValueError(
                f"{path} is a model of Stable-Baselines3: make a policy of it by "
                "satid_gym.policies.learned.from_sb3.learned_policy(model, name).save(path)"
            ) from error
        raise unknown_name("policy (no such file either)", policy, [*names(), *rate_names()]) from error
    if name is not None:
        check_name(name)
        found.name = name
    return found


def renamed(policy: str) -> tuple[str | None, str]:
    """Name and text of NAME=PATH; no name if the sign is part of a folder's name."""
    name, sign, text = policy.partition("=")
    return (name, text) if sign and name == Path(name).name else (None, policy)
