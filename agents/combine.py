"""One network for what the teacher said in several runs of imitation: `python -m agents.combine RUN ...`.

Runs of one setting with different seeds fly different episodes, each with networks of its own. A network that is
fitted to all of their answers has seen more than one run has time for.
"""

from __future__ import annotations

import dataclasses
import itertools
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import tyro

from agents.imitate import answers, fit
from agents.learned import LearnedPolicy
from agents.settings import ImitationSettings
from agents.train import summary, validate
from baselines.ending import ended, refusal
from baselines.provenance import command, revision, versions, write_json
from satid_gym.config import check_whole


@dataclass(frozen=True, kw_only=True)
class Options:
    """Which runs."""

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of finished runs of `python -m agents.imitate` that differ in their seed."""
    run: Path | None = None
    """Folder to write to; runs/NAME-combined-SEED by default."""
    seed: int = 0
    """Of the network and the order of the answers."""
    epochs: int = 12
    """Passes over all answers."""


def common_settings(runs: Sequence[Path]) -> ImitationSettings:
    """The settings that runs share, which may differ in their seed.

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
    return settings[0]


def combine(runs: Sequence[Path], settings: ImitationSettings) -> LearnedPolicy:
    """The policy of a network that is fitted to the answers of all runs, with its scores on validation seeds.

    Raises:
        ValueError: a run is not finished, or a file of it is damaged.
    """
    torch.set_num_threads(1)
    start = time.perf_counter()
    said = [answers(run, settings.rounds) for run in runs]
    for run, rounds in zip(runs, said, strict=True):
        if len(rounds) < settings.rounds:
            raise ValueError(
                f"{run} has {len(rounds)} of its {settings.rounds} rounds: "
                f"go on with it by python -m agents.imitate --run {run} --resume"
            )
    observations, advantages = (np.concatenate(parts) for parts in zip(*itertools.chain(*said), strict=True))
    network = fit(observations, advantages, settings, settings.epochs)
    policy = LearnedPolicy(settings.name, network, "rate", settings.margin, include_covariance=True)
    policy.details = {
        "trained": {
            "method": "imitation",
            "settings": settings.to_dict(),
            "combined_seeds": [ImitationSettings.of_run(run).seed for run in runs],
            "decisions": len(observations),
            "seconds": round(time.perf_counter() - start, 1),
        },
        "validation": validate(policy, settings, settings.evaluation_episodes),
    }
    return policy


def main() -> None:
    """Command line."""
    options = tyro.cli(Options, description=__doc__)
    with refusal():
        check_whole("epochs", options.epochs)
        settings = dataclasses.replace(common_settings(options.runs), seed=options.seed, epochs=options.epochs)
        folder = options.run or Path("runs") / f"{settings.name}-combined-{settings.seed}"
        if any((folder / name).exists() for name in ("run.json", "policy.json")):
            raise ValueError(f"{folder} holds a run already: choose another --run")
        policy = combine(options.runs, settings)
    trained = policy.details["trained"]
    print(f"{trained['decisions'] / 1e3:.0f} k decisions of the teacher fitted in {trained['seconds']:.0f} s")
    print(summary(policy.details["validation"]))
    head = {"command": command("agents.combine"), "revision": revision(), "versions": versions()}
    write_json(folder / "combined.json", {**head, "settings": settings.to_dict()})
    policy.save(folder / "policy")
    print(f"policy: {folder / 'policy'}.safetensors")


if __name__ == "__main__":
    sys.exit(ended(main))
