"""Checkpoints: one file of plain arrays and their checksum, written atomically, read without unpickling.

The one before is kept next to it, for the day the newest turns out to be damaged.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer

from agents.training.settings import RESTART
from satid_gym.files import DamagedFileError, write_bytes
from satid_gym.sb3 import RateCommandVecEnv

_DIGEST = hashlib.sha256().digest_size
_REPLAY = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def save(path: Path, model: BaseAlgorithm, env: RateCommandVecEnv, notes: dict[str, Any]) -> None:
    """Write all that the run needs to go on as if it had never stopped."""
    arrays: dict[str, np.ndarray] = {f"env.{k}": v for k, v in env.state().items()}
    for name, state in model.get_parameters().items():
        if name.endswith("optimizer"):
            state = {f"{i}.{key}": tensor for i, tensors in state["state"].items() for key, tensor in tensors.items()}
        arrays |= {f"{name}/{key}": tensor.numpy() for key, tensor in state.items()}
    for name in _variables(model):
        arrays[f"variable/{name}"] = getattr(model, name).detach().numpy()
    buffer = getattr(model, "replay_buffer", None)
    if buffer is not None:
        arrays |= {f"replay/{name}": getattr(buffer, name)[: buffer.size()] for name in _REPLAY}
    drawn = np.random.get_state(legacy=False)["state"]  # noqa: NPY002 - Stable-Baselines3 shuffles with it
    arrays["random.numpy"], arrays["random.torch"] = drawn["key"], torch.get_rng_state().numpy()
    observation, starts = model._last_obs, model._last_episode_starts
    assert isinstance(observation, np.ndarray)
    assert starts is not None
    arrays["last.observation"], arrays["last.starts"] = observation, starts
    head = {
        "timesteps": model.num_timesteps,
        "updates": model._n_updates,
        "numpy_position": int(drawn["pos"]),
        "replay_position": 0 if buffer is None else buffer.pos,
        "notes": notes,
    }
    arrays["head"] = np.frombuffer(json.dumps(head).encode(), np.uint8)
    file = io.BytesIO()
    np.savez(file, **arrays)  # type: ignore[arg-type]  # no array is named allow_pickle
    content = file.getvalue()
    if path.exists():
        os.replace(path, previous(path))
    write_bytes(path, content + hashlib.sha256(content).digest())  # numpy reads it all the same


def previous(path: Path) -> Path:
    """Where the checkpoint before the newest is."""
    return path.with_suffix(".previous.npz")


def exists(path: Path) -> bool:
    """Whether there is something to go on from."""
    return path.exists() or previous(path).exists()


def load(path: Path, model: BaseAlgorithm, env: RateCommandVecEnv) -> dict[str, Any]:
    """Put a model and its environment where `save` found them; returns the notes.

    A damaged checkpoint is renamed, with a line on standard error, and the one before it is used: training is
    repeatable, so nothing but time is lost.

    Raises:
        DamagedFileError: neither is whole, or it is of other settings.
    """
    try:
        head, arrays = _read(path)
    except DamagedFileError as error:
        if not previous(path).exists():
            raise
        print(f"{error}; going on from the checkpoint before it", file=sys.stderr)
        head, arrays = _read(previous(path))
        if path.exists():
            os.replace(path, path.with_suffix(".damaged.npz"))
    try:
        env.restore(_under(arrays, "env."))
        parameters = {}
        for name, state in model.get_parameters().items():
            tensors = {key: torch.from_numpy(value) for key, value in _under(arrays, f"{name}/").items()}
            parameters[name] = {**state, "state": _by_index(tensors)} if name.endswith("optimizer") else tensors
        model.set_parameters(parameters)  # type: ignore[arg-type]  # its annotation lacks optimizers
        for name in _variables(model):
            getattr(model, name).data = torch.from_numpy(arrays[f"variable/{name}"])
        buffer = getattr(model, "replay_buffer", None)
        if buffer is not None:
            _refill(buffer, _under(arrays, "replay/"), head["replay_position"])
    except (RuntimeError, ValueError, KeyError) as error:
        raise DamagedFileError(f"{path} is of other settings ({error}): {RESTART}") from error
    drawn = {"key": arrays["random.numpy"], "pos": head["numpy_position"]}
    np.random.set_state({"bit_generator": "MT19937", "state": drawn})  # noqa: NPY002
    torch.set_rng_state(torch.from_numpy(arrays["random.torch"]))
    model._last_obs, model._last_episode_starts = arrays["last.observation"], arrays["last.starts"]
    model.num_timesteps, model._n_updates = head["timesteps"], head["updates"]
    return head["notes"]


def _read(path: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The head and the arrays of a checkpoint whose checksum fits; a file that is damaged is not even parsed."""
    try:
        whole = path.read_bytes()
    except FileNotFoundError as error:
        raise DamagedFileError(f"{path} is missing") from error
    content, digest = whole[:-_DIGEST], whole[-_DIGEST:]
    if hashlib.sha256(content).digest() != digest:
        raise DamagedFileError(f"{path} is not a whole checkpoint: its checksum does not fit")
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            arrays = {key: file[key] for key in file.files}
        return json.loads(arrays["head"].tobytes()), arrays
    except (ValueError, KeyError, TypeError, AttributeError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise DamagedFileError(f"{path} is intact but is not a checkpoint") from error


def _variables(model: BaseAlgorithm) -> list[str]:
    """Names of tensors that a model learns and no module has."""
    return model._get_torch_save_params()[1]


def _by_index(tensors: dict[str, torch.Tensor]) -> dict[int, dict[str, torch.Tensor]]:
    """State of an optimizer from tensors named INDEX.NAME."""
    state: dict[int, dict[str, torch.Tensor]] = {}
    for key, tensor in tensors.items():
        index, name = key.split(".")
        state.setdefault(int(index), {})[name] = tensor
    return state


def _refill(buffer: ReplayBuffer, arrays: dict[str, np.ndarray], position: int) -> None:
    """Put back the decisions that a replay buffer held."""
    count = len(arrays["rewards"])
    for name in _REPLAY:
        getattr(buffer, name)[:count] = arrays[name]
    buffer.pos, buffer.full = position, count == buffer.buffer_size


def _under(arrays: dict[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    return {key.removeprefix(prefix): value for key, value in arrays.items() if key.startswith(prefix)}
