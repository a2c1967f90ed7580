"""Evolution of the score of corners: `python -m agents.evolution`, half an hour on two cores.

A score is a weighted sum of features of a corner (`satid_gym.control.corners.features`). It begins as another tour, or
as the baseline `corner_tour`, by how long the axes that a corner reverses have waited, and what the turn there tells of
the inertia; CMA-ES (Hansen, "The CMA Evolution Strategy: A Tutorial", 2016) changes the weights of all features.
A generation flies the same tuning episodes under random inertia laws, of all three satellites or of many drawn at
random; what counts is the error that the filter expects, in the mean over the flight and geometrically over episodes,
and the costs. No teacher, no truth and no gradient: costs and what the filter says are all it sees.

The policy has the mean of what the last generations found: one alone is noise for a good part.
Each generation is kept in `generations.npz` in the run's folder, with the revision that flew it; stopped, the same
command goes on, and says where that is of another revision.
"""

from __future__ import annotations

import csv
import dataclasses
import itertools
import json
import time
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import cma
import numpy as np
from tqdm import tqdm

from agents.evolution.judge import Judges
from agents.evolution.settings import Evolution
from baselines.command import cli
from baselines.command.provenance import result_head, revision
from baselines.scenarios.flights import AnyCell, flown
from satid_gym.evaluation import seeds
from satid_gym.files import DamagedFileError, check_writable, replacing, write_text
from satid_gym.laws import INERTIA_MODES
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.policies.learned.shipped import RATE_PRETRAINED

_DRAWN_VALIDATED = 8
_ANOTHER = "give another --output, or remove generations.npz"


@dataclass
class Generations:
    """Generations that were flown: weights (population, features) and scores (population,), by which revision, and the
    seconds that each took, nan where an older file does not say."""

    asked: list[np.ndarray] = field(default_factory=list)
    judged: list[np.ndarray] = field(default_factory=list)
    revisions: list[str] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def add(self, points: np.ndarray, scores: np.ndarray, flown_by: str, seconds: float) -> None:
        """Note one more."""
        self.asked.append(points)
        self.judged.append(scores)
        self.revisions.append(flown_by)
        self.seconds.append(seconds)


def main(settings: Evolution) -> int:
    """Evolve, and write policy, curve and settings to the run's folder."""
    folder = settings.folder
    folder.mkdir(parents=True, exist_ok=True)
    check_writable(folder)
    with cli.user_errors():
        kept = _kept(settings)
    first, now = settings.first, revision()
    if others := sorted(set(kept.revisions) - {now}):
        print(f"{folder} has generations of revision {', '.join(others)}, this is {now}: to start again, {_ANOTHER}")
    options = {"popsize": settings.population, "seed": settings.seed + 1, "verbose": -9, "maxiter": 10**9}
    search = cma.CMAEvolutionStrategy(first, settings.step, options)
    rows, means = _curve(folder)[: len(kept.judged)], []
    with cli.on_interrupt(f"{folder} is kept: the same command goes on"), closing(Judges(settings)) as judge:
        for generation in tqdm(range(settings.generations), desc=settings.name, unit="generation"):
            points = np.array(search.ask())
            if generation >= len(kept.judged):
                began = time.perf_counter()
                scores = judge([*points, search.mean, first], generation)
                kept.add(points, np.array(scores[:-2]), now, time.perf_counter() - began)
                score, start = scores[-2:]
                rows.append({"generation": generation, "mean": score, "start": start, "step": float(search.sigma)})
                _keep(settings, kept, rows)
            elif not np.allclose(points, kept.asked[generation], rtol=1e-6, atol=1e-9):
                raise cli.UserError(
                    f"{folder} holds weights that this version of cma would not try: finish it with the version that "
                    "began it, or give another --output"
                )
            search.tell(list(kept.asked[generation]), kept.judged[generation].tolist())
            means.append(search.mean.copy())
    head = result_head("agents.evolution", {**dataclasses.asdict(settings), "output": folder.name})
    head["revisions"] = list(dict.fromkeys(kept.revisions[: settings.generations]))  # of the generations
    taken = sum(kept.seconds[: settings.generations])
    head["seconds"] = round(taken, 1) if np.isfinite(taken) else None
    policy = settings.policy(np.mean(means[-settings.averaged :], axis=0), training=head)
    for path in (folder / "policy", *([RATE_PRETRAINED / settings.name] if settings.ship else [])):
        policy.save(path)
    for line in validated(policy, settings):
        print(line)
    return 0


def validated(policy: LearnedPolicy, settings: Evolution) -> Iterator[str]:
    """Scores on validation seeds, one line a cell."""
    flies = enumerate(settings.flies("validation", _DRAWN_VALIDATED))
    for scenario, (i, satellite), inertia in itertools.product(settings.scenarios, flies, INERTIA_MODES):
        cell = AnyCell(scenario=scenario, satellite=satellite, inertia=inertia)
        flight = flown(cell, policy, seeds("validation", settings.validation, 1000 * i * settings.is_drawn))
        expected, cost = flight.expected.mean(), flight.costs.mean(axis=0).max()
        name = satellite if isinstance(satellite, str) else satellite.name
        scores = f"expected error {expected:.4%} cost {cost:.2%} NEES {flight.nees.mean():.2f}"
        yield f"{scenario:11} {name:16} {inertia:9} {scores}"


def _same(settings: Evolution) -> str:
    """What a run that goes on must have in common with the one that was stopped."""
    free = ("name", "generations", "averaged", "output", "ship", "workers", "validation")
    return json.dumps({name: value for name, value in dataclasses.asdict(settings).items() if name not in free})


def _kept(settings: Evolution) -> Generations:
    """The generations that were flown before.

    Raises:
        ValueError: they are of a run with other settings, or their file is damaged.
    """
    path = settings.folder / "generations.npz"
    if not path.is_file():
        return Generations()
    try:
        with np.load(path, allow_pickle=False) as file:
            same, asked, judged = str(file["settings"]), list(file["asked"]), list(file["judged"])
            revisions = file["revisions"].tolist() if "revisions" in file else ["unknown"] * len(asked)  # older files
            seconds = file["seconds"].tolist() if "seconds" in file else [np.nan] * len(asked)
    except (ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise DamagedFileError(f"{path} is damaged ({error}): {_ANOTHER}") from error
    if same != _same(settings):
        raise ValueError(f"{path} is of a run with other settings: {_ANOTHER}")
    return Generations(asked, judged, revisions, seconds)


def _keep(settings: Evolution, kept: Generations, rows: list[dict[str, float]]) -> None:
    """Write the generations that were flown, and the learning curve."""
    with replacing(settings.folder / "generations.npz", ".npz") as path:
        asked, judged, revisions = np.array(kept.asked), np.array(kept.judged), np.array(kept.revisions)
        np.savez(path, settings=_same(settings), asked=asked, judged=judged, revisions=revisions, seconds=kept.seconds)
    lines = ["generation,mean,start,step", *(",".join(f"{value:.6g}" for value in row.values()) for row in rows)]
    write_text(settings.folder / "curve.csv", "\n".join(lines) + "\n")


def _curve(folder: Path) -> list[dict[str, float]]:
    """Rows of the learning curve that were written before."""
    path = folder / "curve.csv"
    if not path.is_file():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
