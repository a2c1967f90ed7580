"""One network for what the teacher said in several runs of imitation: `python -m agents.training.combine RUN ...`.

Runs of one setting with different seeds fly different episodes, each with networks of its own. A network that is
fitted to all of their answers has seen more than one run has time for.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
import tyro

from agents.training.imitation import ImitationSettings, fit, policy_of
from agents.training.run import summary, validate
from agents.training.teacher import Answers, answers
from baselines.command import cli
from baselines.command.provenance import result_head
from satid_gym.config import check_integer


@dataclass(frozen=True, kw_only=True)
class Combination:
    """Which runs."""

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of finished runs of `python -m agents.imitate` that differ in their seed."""
    run: Path | None = None
    """Folder to write to; runs/NAME-combined-SEED by default."""
    seed: int = 0
    """Seed of the network and of the order of the answers."""
    epochs: int = 12
    """Passes over all answers."""


def settings_of(runs: Sequence[Path]) -> list[ImitationSettings]:
    """The settings of runs that differ in their seed alone.

    Raises:
        ValueError: there is no run, or two differ in more than their seed, or do not differ.
    """
    if not runs:
        raise ValueError("name at least one run of agents.imitate")
    settings = [ImitationSettings.of_run(run) for run in runs]
    for run, own in zip(runs, settings, strict=True):
        if dataclasses.replace(own, seed=settings[0].seed) != settings[0]:
            raise ValueError(f"{run} has other settings than {runs[0]}: combine runs that differ in their seed alone")
    if len({own.seed for own in settings}) < len(runs):
        raise ValueError("two of the runs have the same seed and with it the same answers: name each once")
    return settings


def answers_of(runs: Sequence[Path], rounds: int) -> list[Answers]:
    """What the teacher said in all rounds of all runs.

    Raises:
        ValueError: a run is not finished, or a file of it is damaged.
    """
    said: list[Answers] = []
    for run in runs:
        own = answers(run, rounds)
        if len(own) < rounds:
            raise ValueError(
                f"{run} has {len(own)} of its {rounds} rounds: "
                f"go on with it by python -m agents.imitate --run {run} --resume"
            )
        said += own
    return said


def main(combination: Combination) -> None:
    """Command line."""
    with cli.user_errors():
        check_integer("epochs", combination.epochs)
        own = settings_of(combination.runs)
        settings = dataclasses.replace(own[0], seed=combination.seed, epochs=combination.epochs)
        folder = combination.run or Path("runs") / f"{settings.name}-combined-{settings.seed}"
        if any((folder / name).exists() for name in ("run.json", "policy.json")):
            raise ValueError(f"{folder} holds a run already: choose another --run")
        said = answers_of(combination.runs, settings.rounds)
    torch.set_num_threads(1)
    start = time.perf_counter()
    policy = policy_of(fit(said, settings, settings.epochs), settings)
    seconds, decisions = time.perf_counter() - start, sum(len(x) for x, _ in said)
    rows = validate(policy, settings, settings.evaluation_episodes)
    policy.details = {
        "trained": {
            "method": "imitation",
            **result_head("agents.training.combine", settings.to_dict()),
            "combined_seeds": [each.seed for each in own],
            "decisions": decisions,
            "seconds": round(seconds, 1),
        },
        "validation": rows,
    }
    policy.save(folder / "policy")
    print(f"{decisions / 1e3:.0f} k decisions of the teacher fitted in {seconds:.0f} s")
    print(summary(rows))
    print(f"policy: {folder / 'policy'}.safetensors")


if __name__ == "__main__":
    cli.run(main)
