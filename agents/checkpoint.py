"""Checkpoints: one file of plain arrays, written whole or not at all, read without unpickling."""

from __future__ import annotations

import json
import os
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO

from agents.rate_env import RateCommandVecEnv


def save(path: Path, model: PPO, env: RateCommandVecEnv, notes: dict[str, Any]) -> None:
    """Write all that the run needs to go on as if it had never stopped."""
    arrays: dict[str, np.ndarray] = {f"env.{k}": v for k, v in env.state().items()}
    for key, tensor in model.policy.state_dict().items():
        arrays[f"policy.{key}"] = tensor.numpy()
    optimizer = model.policy.optimizer.state_dict()
    for i, state in optimizer["state"].items():
        for key, tensor in state.items():
            arrays[f"optimizer.{i}.{key}"] = tensor.numpy()
    _, keys, position, *_ = np.random.get_state()  # noqa: NPY002 - Stable-Baselines3 shuffles with it
    arrays["random.numpy"], arrays["random.torch"] = keys, torch.get_rng_state().numpy()
    arrays["last.observation"], arrays["last.starts"] = model._last_obs, model._last_episode_starts
    head = {
        "timesteps": model.num_timesteps,
        "updates": model._n_updates,
        "numpy_position": int(position),
        "notes": notes,
    }
    arrays["head"] = np.frombuffer(json.dumps(head).encode(), np.uint8)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(path.name + ".part")
    with temporary.open("wb") as file:
        np.savez(file, **arrays)
        file.flush()
        os.fsync(file.fileno())
    os.replace(temporary, path)


def load(path: Path, model: PPO, env: RateCommandVecEnv) -> dict[str, Any]:
    """Put a model and its environment where `save` found them; returns the notes.

    Raises:
        ValueError: the file is damaged or of other settings; nothing is used of it.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {key: file[key] for key in file.files}
        head = json.loads(arrays["head"].tobytes())
    except (EOFError, OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path} is not a whole checkpoint ({error}); delete it and start the run again") from error
    try:
        env.restore(_under(arrays, "env."))
        tensors = {k: torch.from_numpy(v) for k, v in _under(arrays, "policy.").items()}
        model.policy.load_state_dict(tensors)
        optimizer = model.policy.optimizer.state_dict()
        states: dict[int, dict[str, torch.Tensor]] = {}
        for key, value in _under(arrays, "optimizer.").items():
            index, name = key.split(".")
            states.setdefault(int(index), {})[name] = torch.from_numpy(value)
        model.policy.optimizer.load_state_dict({**optimizer, "state": states})
    except (RuntimeError, ValueError) as error:
        raise ValueError(f"{path} is of other settings: {error}") from error
    np.random.set_state(("MT19937", arrays["random.numpy"], head["numpy_position"]))  # noqa: NPY002
    torch.set_rng_state(torch.from_numpy(arrays["random.torch"]))
    model._last_obs, model._last_episode_starts = arrays["last.observation"], arrays["last.starts"]
    model.num_timesteps, model._n_updates = head["timesteps"], head["updates"]
    return head["notes"]


def _under(arrays: dict[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    return {key.removeprefix(prefix): value for key, value in arrays.items() if key.startswith(prefix)}
