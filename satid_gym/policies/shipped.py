"""The policies that come with the project, and policies by name or path."""

from __future__ import annotations

from pathlib import Path

from satid_gym.config import unknown_name
from satid_gym.policies.learned import LearnedPolicy

PRETRAINED = Path(__file__).parent / "pretrained"


def names() -> list[str]:
    """Names of the shipped policies."""
    return sorted(path.stem for path in PRETRAINED.glob("*.safetensors"))


def shipped() -> list[LearnedPolicy]:
    """The shipped policies."""
    return [LearnedPolicy.load(PRETRAINED / name) for name in names()]


def find(policy: str) -> LearnedPolicy:
    """A shipped policy by name, or any by the path of its files.

    Raises:
        ValueError: there is neither.
    """
    if policy in names():
        return LearnedPolicy.load(PRETRAINED / policy)
    try:
        return LearnedPolicy.load(Path(policy))
    except FileNotFoundError as error:
        raise unknown_name("policy (no such file either)", policy, names()) from error
