"""Minari data sets: written from flights, and read as what a policy was shown and what it did."""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Iterable, Mapping, Sequence
from types import ModuleType
from typing import Any

import numpy as np
from gymnasium.envs.registration import EnvSpec

from agents.dataset.flights import Episode
from baselines.command.cli import UserError

HEAD = "satid_gym"
"""Key of a data set's metadata under which this project's is: command, revision, versions, settings and seeds."""

Flown = tuple[Mapping[str, str], Sequence[Episode]]  # options of the environment's reset, and episodes with them


def library() -> ModuleType:
    """Minari.

    Raises:
        UserError: it is not installed.
    """
    try:
        import minari
    except ModuleNotFoundError as error:
        raise UserError('data sets need Minari, which is not installed: pip install "minari[hdf5]>=0.5.4"') from error
    return minari


def check_free(name: str) -> None:
    """Refuse the name of an existing data set.

    Raises:
        ValueError: there is one, or Minari does not accept the name.
    """
    minari = library()
    minari.dataset.minari_dataset.parse_dataset_id(name)
    folder = minari.storage.datasets_root_dir.get_dataset_path(name)
    if folder.exists():
        raise ValueError(f"{folder} holds a data set already: choose another --namespace, or remove it")


def write(name: str, spec: EnvSpec, head: Mapping[str, Any], policy: str, flown: Iterable[Flown]) -> Any:
    """Write a data set, cell by cell as they are flown; nothing is left of one that is interrupted.

    Args:
        name: Minari's name of it, NAMESPACE/NAME-vN.
        spec: of the environment that it is of.
        head: what is said of it; written last, so that one without it was not finished.
        policy: who flew.
        flown: episodes with the options of their reset.

    Returns:
        The `MinariDataset`.
    """
    minari = library()
    folder = minari.storage.datasets_root_dir.get_dataset_path(name)
    text = f"Flights of {policy} in SatInertiaID-v0. {head['command']}, revision {head['revision']}."
    try:
        with warnings.catch_warnings():  # of authors and links that are the user's to add
            warnings.filterwarnings("ignore", message="`(code_permalink|author|author_email|eval_env)` is set to None")
            dataset = minari.create_dataset_from_buffers(
                name,
                [],
                env=spec,
                algorithm_name=policy,
                description=text,
                requirements=[f"satid-gym=={head['versions']['satid-gym']}"],
            )
        for options, episodes in flown:
            dataset.storage.update_episodes([_buffer(minari, options, episode) for episode in episodes])
        dataset.storage.update_metadata({HEAD: dict(head)})
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return minari.load_dataset(name)


def _buffer(minari: ModuleType, options: Mapping[str, str], episode: Episode) -> Any:
    return minari.data_collector.EpisodeBuffer(
        seed=episode.seed,
        options=dict(options),
        observations=episode.observations,
        actions=episode.actions,
        rewards=episode.rewards,
        terminations=episode.terminations,
        truncations=episode.truncations,
        infos={**episode.infos},
    )


def load(name: str) -> tuple[Any, dict[str, Any]]:
    """A data set and what its `write` was told of it.

    Raises:
        ValueError: no data set has that name, it is of another project, or was not written to its end.
    """
    minari = library()
    try:
        dataset = minari.load_dataset(name)
    except FileNotFoundError as error:
        raise ValueError(f"{error.args[0].partition('.')[0]}: python -m agents.dataset writes data sets") from error
    head = dataset.storage.metadata.get(HEAD)
    if head is None:
        raise ValueError(f"data set {name} was not written to its end by python -m agents.dataset: remove it")
    return dataset, head


def check_commands(name: str) -> Any:
    """A data set of body rates that policies commanded, shown what the networks of imitation are.

    Raises:
        ValueError: there is no such data set, or its actions or observations are others.
    """
    dataset, head = load(name)
    expected = {"control": "rate", "include_covariance": True, "observation": "wheels", "include_walk": False}
    for setting, value in expected.items():
        if (own := head["environment"][setting]) != value:
            raise ValueError(
                f"imitation learns from flights with {setting}={value!r}, and those of data set {name} have {own!r}: "
                "write them by python -m agents.dataset --control rate"
            )
    return dataset


def commands(name: str) -> tuple[np.ndarray, np.ndarray]:
    """What a policy was shown and the body rates that it commanded: observations (D, size) and actions (D, 3).

    Raises:
        ValueError: see `check_commands`.
    """
    episodes = list(check_commands(name).iterate_episodes())
    return (
        np.concatenate([episode.observations[:-1] for episode in episodes]),
        np.concatenate([episode.actions for episode in episodes]),
    )
