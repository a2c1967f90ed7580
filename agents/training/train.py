"""Training of an excitation policy: `python -m agents.train`.

    python -m agents.train --settings ppo                   the shipped PPO policy again
    python -m agents.train --settings sac                   Soft Actor-Critic
    python -m agents.train --satellite microsat --steps 200000
    python -m agents.train --run runs/ppo-0 --resume        go on after a stop

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
from satid_gym.config import unknown_name
from satid_gym.files import read_json

CONFIGS = Path(__file__).parent / "configs"
SETTINGS: dict[str, type[Task]] = {c.algorithm: c for c in (PPOSettings, SACSettings, ImitationSettings)}
TRAIN: dict[str, Callable[[Run], Any]] = {"ppo": ppo.train, "sac": sac.train, "imitation": imitation.train}


def named(name: str) -> Task:
    """Settings kept in agents/training/configs/NAME.json; its "algorithm" says of which one, PPO by default.

    Raises:
        ValueError: there are none of that name.
    """
    names = sorted(path.stem for path in CONFIGS.glob("*.json"))
    if name not in names:
        raise unknown_name("training settings", name, names)
    values = read_json(CONFIGS / f"{name}.json", "restore it from the repository")
    return SETTINGS[values.pop("algorithm", "ppo")].from_dict(values)


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

    settings: str | None = None
    """Named settings to start from (agents/training/configs/*.json); they also choose the algorithm."""
    training: Annotated[PPOSettings | SACSettings | ImitationSettings, tyro.conf.arg(name="")] = field(
        default_factory=PPOSettings
    )

    @classmethod
    def parse(cls, arguments: Sequence[str]) -> Self:
        """Options of a command line, whose algorithm decides which settings there are.

        Raises:
            ValueError: a setting is not valid, or --resume comes with other settings.
        """
        parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
        parser.add_argument("--settings")
        parser.add_argument("--run", type=Path)
        parser.add_argument("--resume", action="store_true")
        known, others = parser.parse_known_args(arguments)
        if known.resume:
            if known.run is None or others or known.settings:
                raise ValueError("--resume needs --run FOLDER and nothing else: the run keeps its settings")
            training = resumed(known.run)
        else:
            training = named(known.settings) if known.settings else PPOSettings()
        start = cls(training=training)  # type: ignore[arg-type]
        config = (tyro.conf.AvoidSubcommands,)  # the algorithm is chosen already
        return tyro.cli(cls, args=arguments, default=start, description=__doc__, config=config)


def main(options: TrainingOptions) -> int:
    """Train; the exit code."""
    settings = options.training
    return options.start(TRAIN[settings.algorithm], settings, "agents.train")
