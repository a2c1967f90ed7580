"""Policies of the user's own code by module:name, alone or among the learned ones, and digests of policies."""

from __future__ import annotations

import copy
import hashlib
import inspect
import sys
from pathlib import Path
from typing import get_args

from satid_gym.policies.learned.policy import LearnedPolicy, check_name
from satid_gym.policies.learned.shipped import find, renamed
from satid_gym.policy import Kind, Policy
from satid_gym.sources import imported, in_module, made


def custom(text: str) -> Policy:
    """The policy that module:name stands for; a class or function is called without arguments.

    Raises:
        ValueError: it cannot be imported or made, or has no `reset`, call, name or kind of a policy.
    """
    found = imported(text)
    policy = made(found, f"policy {text}") if isinstance(found, type) or not hasattr(found, "reset") else found
    if not callable(policy) or not callable(getattr(policy, "reset", None)):
        raise ValueError(
            f"policy {text} must be an object with reset(mission, seeds) and a call for each decision, see "
            f"satid_gym.policy.Policy, or a class or function that makes one; got {policy!r}"
        )
    check_name(getattr(policy, "name", ""))
    if getattr(policy, "kind", None) not in get_args(Kind):
        raise ValueError(f"policy {text}: kind must be one of {', '.join(get_args(Kind))}")
    own = copy.copy(policy)  # the module's object keeps its name
    own.found_in = sys.modules[text.partition(":")[0]].__file__
    return own


def find_any(policy: str) -> Policy:
    """Learned policy as of `find`, or the user's own by module:name, whose code is run; NAME= before it renames either.

    Raises:
        ValueError: as of `find` and `custom`.
    """
    name, text = renamed(policy)
    if not in_module(text):
        return find(policy)
    own = custom(text)
    if name is not None:
        check_name(name)
        own.name = name
    return own


def digest(policy: Policy) -> str:
    """SHA-256 of what decides a policy's flights: settings and weights of a learned one, else the code of its class.

    The code is the whole file that holds the class, and the one that `custom` found it by, which may have its settings;
    what these read or import is not in it.
    """
    if not isinstance(policy, LearnedPolicy):
        own = inspect.getfile(type(policy))
        files = dict.fromkeys([own, getattr(policy, "found_in", own)])
        return hashlib.sha256(b"".join(Path(file).read_bytes() for file in files)).hexdigest()
    network = policy.network
    settings = [*policy.settings.items(), network.activation, network.squashed]
    found = hashlib.sha256(repr(settings[1:]).encode())  # without the name
    for name, tensor in sorted(network.tensors().items()):
        found.update(f"{name} {tensor.shape} {tensor.dtype}".encode() + tensor.tobytes())
    return found.hexdigest()
