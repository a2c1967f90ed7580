"""Files of a learned policy: its network as safetensors, its settings as JSON; reading them executes no code.

Files may come from untrusted sources: their sizes, names, shapes and values are checked before use.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from satid_gym.files import read_json, write_bytes, write_text
from satid_gym.policies.learned.network import Network

FORMAT = 1
FILE_SIZE_MAX = 64 * 2**20  # bytes of a policy's file; the shipped ones have a thousandth of it
_OTHERS = ("format", "activation", "squashed", "sha256")  # what the JSON file has in addition to settings and details


def write_policy(path: Path | str, settings: Mapping[str, Any], network: Network, details: Mapping[str, Any]) -> None:
    """Write `path`.safetensors and `path`.json, each atomically; the second has the first's checksum."""
    path = Path(path)
    tensors = save({name: np.ascontiguousarray(v) for name, v in network.tensors().items()})
    last = {"activation": network.activation, "squashed": network.squashed}
    head = {"format": FORMAT, **settings, **last, "sha256": hashlib.sha256(tensors).hexdigest()}
    write_bytes(_with_ending(path, ".safetensors"), tensors)
    write_text(_with_ending(path, ".json"), json.dumps({**head, **details}, indent=2) + "\n")


def files_of(path: Path | str) -> tuple[Path, Path]:
    """Files of network and settings; `path` with or without an ending."""
    path = Path(path)
    base = path.with_suffix("") if path.suffix in (".safetensors", ".json") else path
    return _with_ending(base, ".safetensors"), _with_ending(base, ".json")


def read_policy(path: Path | str, settings: Sequence[str]) -> tuple[dict[str, Any], Network, dict[str, Any]]:
    """Settings of these names, network and details from the files that `write_policy` wrote.

    Args:
        path: with or without an ending.
        settings: names of those that a policy may have; all else is details.

    Raises:
        FileNotFoundError: one of the two files is missing.
        ValueError: a file is damaged, of another format, without the checksum, or has invalid content.
    """
    tensors, text = files_of(path)
    for file in (tensors, text):
        if not file.is_file():
            raise FileNotFoundError(f"no policy at {path}: {file} is missing; a policy is a pair of files")
        if file.stat().st_size > FILE_SIZE_MAX:
            raise ValueError(f"{file} has {file.stat().st_size} bytes, a policy at most {FILE_SIZE_MAX}")
    found = read_json(text, "copy the policy again", keys=["format", "sha256"])
    if found["format"] != FORMAT:
        raise ValueError(f"{text} is not a policy of format {FORMAT}; train it again with this version")
    content = tensors.read_bytes()
    if found["sha256"] != hashlib.sha256(content).hexdigest():
        raise ValueError(f"{tensors} is damaged or not of {text.name}: its checksum differs; copy both again")
    try:
        choices = found.get("activation", "tanh"), found.get("squashed", False)  # older files lack them
        network = Network.from_tensors(load(content), *choices)
    except (SafetensorError, ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{tensors} holds no network: {error}; copy the policy again") from error
    details = {name: value for name, value in found.items() if name not in (*settings, *_OTHERS)}
    return {name: found[name] for name in settings if name in found}, network, details


def _with_ending(path: Path, ending: str) -> Path:
    return path.with_name(path.name + ending)
