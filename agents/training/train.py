"""Training of an excitation policy: `python -m agents.train`.

    python -m agents.train --settings ppo                   the shipped PPO policy again
    python -m agents.train --settings sac                   Soft Actor-Critic
    python -m agents.train --settings mine.json             settings of your own, like agents/training/configs/*.json
    python -m agents.train --satellite microsat --steps 200000
    python -m agents.train --run runs/ppo-0 --resume        go on after a stop
    python -m agents.train --settings ppo sac --seeds 0 1 2 --ray auto   six runs, on a Ray cluster

Every run has a folder: settings, versions, revision, learning curve, TensorBoard, checkpoint and policy. A run
that is stopped at any moment resumes from its last checkpoint with the same result.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Self

import tyro

from agents.training import imitation, ppo, sac
from agents.training.imitation import ImitationSettings
from agents.training.ppo import PPOSettings
from agents.training.run import Run, RunOptions
from agents.training.sac import SACSettings
from agents.training.settings import Task, head_of
from baselines.command import cli
from baselines.command.cluster import RayAddress, each
from satid_gym.config import unknown_name
from satid_gym.files import read_json

CONFIGS = Path(__file__).parent / "configs"
SETTINGS: dict[str, type[Task]] = {c.algorithm: c for c in (PPOSettings, SACSettings, ImitationSettings)}
TRAIN: dict[str, Callable[[Run], Any]] = {"ppo": ppo.train, "sac": sac.train, "imitation": imitation.train}


def named(name: str) -> Task:
    """Settings by name, of agents/training/configs/NAME.json, or from the path of a .json file.

    A file's "algorithm" says of which one they are, PPO by default, and its "name" what the policy is called, that of
    the file by default.

    Raises:
        ValueError: there are none of that name, or the file is missing or has invalid content.
    """
    path, names = Path(name), sorted(path.stem for path in CONFIGS.glob("*.json"))
    if path.suffix.lower() != ".json":
        if name not in names:
            raise ValueError(f"{unknown_name('training settings', name, names)} Or the path of a .json file.")
        path = CONFIGS / f"{name}.json"
    values = {"name": path.stem, **read_json(path, f"give a .json file of training settings, or one of {names}")}
    algorithm = values.pop("algorithm", "ppo")
    if algorithm not in list(SETTINGS):
        raise unknown_name(f"algorithm in {path}", algorithm, SETTINGS)
    try:
        return SETTINGS[algorithm].from_dict(values)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def resumed(folder: Path) -> Task:
    """Settings of the run in a folder.

    Raises:
        ValueError: the folder holds no run, or its run.json is damaged.
    """
    algorithm = head_of(folder).get("algorithm", "ppo")
    if algorithm not in SETTINGS:
        raise unknown_name("algorithm", algorithm, SETTINGS)
    return SETTINGS[algorithm].of_run(folder)


@dataclass(frozen=True, kw_only=True)
class TrainingOptions(RunOptions):
    """Where settings come from, where the run goes, and any training setting by its name."""

    settings: tuple[str, ...] = ()
    """Settings to start from: names (agents/training/configs/*.json), or paths of .json files like those; they also
    choose the algorithm. Several: a run of each."""
    seeds: tuple[int, ...] = ()
    """A run of each of these seeds, in place of --seed. Of several runs, the same command again goes on with those that
    were stopped."""
    ray: RayAddress = None
    """Train on a Ray cluster, a run on a core: auto, HOST:PORT, ray://HOST:PORT, or local for one of this machine. The
    runs' folders are to be where all machines see them."""
    training: Annotated[PPOSettings | SACSettings | ImitationSettings, tyro.conf.arg(name="")] = field(
        default_factory=PPOSettings
    )
    runs: tuple[Task, ...] = field(init=False, default=())
    """Settings of each run."""

    @property
    def several(self) -> bool:
        """Whether runs are trained as tasks, each in the folder that its name and seed say."""
        return len(self.runs) > 1 or self.ray is not None

    @classmethod
    def parse(cls, arguments: Sequence[str]) -> Self:
        """Options of a command line, whose algorithm decides which settings there are.

        Raises:
            ValueError: a setting is not valid, --resume comes with other settings, or several runs would have one
                folder.
        """
        parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
        parser.add_argument("--settings", nargs="+")
        parser.add_argument("--run", type=Path)
        parser.add_argument("--resume", action="store_true")
        known, others = parser.parse_known_args(arguments)
        if known.resume:
            if known.run is None or others or known.settings:
                raise ValueError("--resume needs --run FOLDER and nothing else: the run keeps its settings")
            starts = [resumed(known.run)]
        else:
            starts = [named(name) for name in known.settings or ()] or [PPOSettings()]
        config = (tyro.conf.AvoidSubcommands,)  # the algorithm is chosen already
        options = [
            tyro.cli(  # type: ignore[arg-type]
                cls,
                prog=cli.program(),
                args=arguments,
                default=cls(training=start),  # type: ignore[arg-type]
                description=__doc__,
                config=config,
            )
            for start in starts
        ]
        runs = [o.training.replace(seed=seed) for o in options for seed in o.seeds or (o.training.seed,)]
        object.__setattr__(options[0], "runs", tuple(runs))
        options[0].check()
        return options[0]

    def check(self) -> None:
        """Refuse several runs with one folder.

        Raises:
            ValueError: --run is given, or two have the same name and seed.
        """
        folders = [folder_of(run) for run in self.runs]
        if self.several and self.run is not None:
            raise ValueError("--run is the folder of one run: of several, or with --ray, each is in runs/NAME-SEED")
        for folder in folders:
            if folders.count(folder) > 1:
                raise ValueError(f"two runs would be in {folder}: give each settings a name of its own, and seeds once")


def main(options: TrainingOptions) -> int:
    """Train; the exit code."""
    if not options.several:
        return options.start(TRAIN[options.training.algorithm], options.training, "agents.train")
    with cli.user_errors():
        for settings in options.runs:
            check_folder(settings)
    calls = [(settings, folder_of(settings).resolve()) for settings in options.runs]
    with cli.on_interrupt("the same command goes on"):
        for folder in each(train, calls, options.ray, keep=False, desc="training", unit="run"):
            if not (folder / "policy.safetensors").exists():
                raise cli.UserError(f"{folder} is not here: run from a folder that all machines of the cluster see")
    return 0


def folder_of(settings: Task) -> Path:
    """Folder of one of several runs."""
    return Path("runs") / f"{settings.name}-{settings.seed}"


def check_folder(settings: Task) -> None:
    """Refuse a folder that holds a run of other settings.

    Raises:
        ValueError: it does, or its run.json is damaged.
    """
    folder = folder_of(settings)
    if (folder / "run.json").exists() and resumed(folder) != settings:
        raise ValueError(f"{folder} holds a run of other settings: give this one another --name, or remove it")


def train(settings: Task, folder: Path) -> Path:
    """One of several runs, from its start or from where it was stopped, by a signal or with its machine; its folder."""
    resume = (folder / "run.json").exists()
    TRAIN[settings.algorithm](Run(settings, folder, resume=resume, module="agents.train"))
    return folder
