"""Evolution of the score of corners: `python -m agents.evolution`, about 20 minutes on two cores.

Begins as the baseline `corner_tour`, whose score of a corner is how long the axes that it reverses have waited, and
changes the weights of all its features (`satid_gym.control.corners.FEATURES`) by CMA-ES (Hansen, "The CMA Evolution
Strategy: A Tutorial", 2016).
A generation flies the same tuning episodes, of all three satellites under random inertia laws; what counts is the
error that the filter expects, in the mean over the flight and geometrically over episodes, and the costs.
No teacher, no truth and no gradient: costs and what the filter says are all it sees.

Each generation is kept in `generations.npz` in the run's folder; stopped, the same command goes on.
"""

from __future__ import annotations

import csv
import dataclasses
import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cma
import numpy as np
from tqdm import tqdm

from baselines.command import cli
from baselines.command.provenance import result_head
from baselines.scenarios.flights import Cell, expected_error, flown
from satid_gym.config import check_integer, check_names, check_number
from satid_gym.control.corners import FEATURES, CornerTour
from satid_gym.evaluation import seeds
from satid_gym.files import check_writable, replacing, write_text
from satid_gym.gym_api import COSTS
from satid_gym.laws import INERTIA_MODES
from satid_gym.policies.learned import LearnedPolicy, check_name
from satid_gym.policies.network import Network
from satid_gym.policies.shipped import RATE_PRETRAINED
from satid_gym.policy import missions
from satid_gym.satellite import SATELLITES
from satid_gym.scenario_catalogue import SCENARIOS
from satid_gym.vector import SatInertiaIDVectorEnv

_FREE, _PRICE = 0.002, 5.0  # share of the time beyond a limit that costs nothing; log error by share beyond that


@dataclass(frozen=True, kw_only=True)
class Evolution:
    """Settings of a run."""

    name: str = "tank_tour"
    """What tables call the policy."""
    scenario: str = "slosh"
    """Scenario that is flown."""
    satellites: tuple[str, ...] = ("cubesat", "microsat", "smallsat")
    """Satellites that fly, the same policy on all."""
    generations: int = 80
    """Generations to evolve for."""
    population: int = 14
    """Sets of weights in a generation."""
    episodes: int = 63
    """Episodes that judge each of them, the same for all of a generation."""
    step: float = 0.15
    """First standard deviation of the weights."""
    margin: float = 3.5
    """Margin of the rates, see `satid_gym.control.rate_loop.RateMargin`."""
    seed: int = 0
    """Seed of the evolution."""
    workers: int = 2
    """Threads that fly weights side by side."""
    validation: int = 24
    """Episodes of each cell that judge the result, validation seeds."""
    ship: bool = False
    """Save the policy among the shipped ones too."""
    output: Path | None = None
    """Folder of the run. Default: runs/NAME-SEED."""

    def __post_init__(self) -> None:
        check_names("scenario", [self.scenario], SCENARIOS)
        check_names("satellite", self.satellites, SATELLITES)
        check_name(self.name)
        for name in ("generations", "episodes", "workers", "validation"):
            check_integer(name, getattr(self, name))
        check_integer("population", self.population, low=4)
        check_integer("seed", self.seed, low=0)
        check_number("step", self.step, strict=True)

    @property
    def folder(self) -> Path:
        """Folder of the run."""
        return self.output or Path("runs") / f"{self.name}-{self.seed}"

    def policy(self, weights: np.ndarray, **details: Any) -> LearnedPolicy:
        """Policy of some weights (features,)."""
        network = Network((weights[None].astype(np.float32),), (np.zeros(1, np.float32),))
        given = {"observation": "body", "tours_corners": True}
        return LearnedPolicy(self.name, network, "rate", self.margin, details=details, **given)


class Judge:
    """Flies weights on tuning seeds."""

    def __init__(self, settings: Evolution) -> None:
        self._env = SatInertiaIDVectorEnv(
            settings.episodes,
            list(settings.satellites),
            "random",
            settings.scenario,
            control="rate",
            observation="body",
            num_threads=1,
        )
        self._tour = CornerTour(missions(self._env.problem), settings.margin)
        self._settings = settings

    def close(self) -> None:
        """Close the environment."""
        self._env.close()

    def __call__(self, weights: np.ndarray, generation: int) -> float:
        """Mean of the log of the expected error, and what being beyond a limit costs; the lower the better."""
        count, env = self._settings.episodes, self._env
        observation, _ = env.reset(seed=seeds("tuning", count, generation * count))
        self._tour.assign(env.satellite_index)
        self._tour.begin(count)
        score, world = self._settings.policy(weights).score, env.problem.scenario
        alive, expected, cost = np.ones(count, bool), np.zeros(count), np.zeros(count)
        for _ in range(world.decisions):
            observation, _, terminated, _, info = env.step(self._tour(observation, score))
            expected += np.where(alive, expected_error(env), world.prior_std)  # as little is known as at first
            cost += np.where(alive, np.max([info["costs"][name] for name in COSTS], axis=0), 1.0)
            alive &= ~terminated
        beyond = max(0.0, cost.mean() / world.decisions - _FREE)
        return float(np.log(expected / world.decisions).mean() + _PRICE * beyond)


class Judges:
    """Judges that fly side by side."""

    def __init__(self, settings: Evolution) -> None:
        self._judges = [Judge(settings) for _ in range(settings.workers)]
        self._pool = ThreadPoolExecutor(settings.workers)

    def close(self) -> None:
        """Wait for what flies, and close."""
        self._pool.shutdown()
        for judge in self._judges:
            judge.close()

    def __call__(self, points: Sequence[np.ndarray], generation: int) -> list[float]:
        """Scores of weights."""
        count, scores = len(self._judges), [0.0] * len(points)

        def fly_share(k: int) -> None:
            for i in range(k, len(points), count):
                scores[i] = self._judges[k](points[i], generation)

        list(self._pool.map(fly_share, range(count)))
        return scores


def main(settings: Evolution) -> int:
    """Evolve, and write policy, curve and settings to the run's folder."""
    folder = settings.folder
    folder.mkdir(parents=True, exist_ok=True)
    check_writable(folder)
    asked, judged = _kept(settings)
    first = np.eye(len(FEATURES))[FEATURES.index("waited")]
    options = {"popsize": settings.population, "seed": settings.seed + 1, "verbose": -9, "maxiter": 10**9}
    search = cma.CMAEvolutionStrategy(first, settings.step, options)
    rows, weights = _curve(folder), first
    with cli.on_interrupt(f"{folder} is kept: the same command goes on"), closing(Judges(settings)) as judge:
        for generation in tqdm(range(settings.generations), desc=settings.name, unit="generation"):
            points = np.array(search.ask())
            if generation >= len(judged):
                scores = judge([*points, search.mean, first], generation)
                asked.append(points)
                judged.append(np.array(scores[:-2]))
                score, start = scores[-2:]
                rows.append({"generation": generation, "mean": score, "start": start, "step": float(search.sigma)})
                _keep(settings, asked, judged, rows)
            elif not np.allclose(points, asked[generation], rtol=1e-6, atol=1e-9):
                raise ValueError(
                    f"{folder} holds weights that this version of cma would not try: finish it with the version that "
                    "began it, or give another --output"
                )
            search.tell(list(asked[generation]), judged[generation].tolist())
            weights = search.mean
    head = result_head("agents.evolution", {**dataclasses.asdict(settings), "output": folder.name})
    policy = settings.policy(weights, training=head, features=list(FEATURES))
    for path in (folder / "policy", *([RATE_PRETRAINED / settings.name] if settings.ship else [])):
        policy.save(path)
    for row in validated(policy, settings):
        print("{satellite:9} {inertia:9} expected error {expected:.4%} cost {cost:.2%} NEES {nees:.2f}".format(**row))
    return 0


def validated(policy: LearnedPolicy, settings: Evolution) -> list[dict[str, Any]]:
    """Scores on validation seeds, one row a cell."""
    rows = []
    for satellite in settings.satellites:
        for inertia in INERTIA_MODES:
            cell = Cell(scenario=settings.scenario, satellite=satellite, inertia=inertia)
            flight = flown(cell, policy, seeds("validation", settings.validation))
            scores = {"expected": flight.expected.mean(), "cost": flight.costs.mean(axis=0).max()}
            rows.append({"satellite": satellite, "inertia": inertia, **scores, "nees": flight.nees.mean()})
    return rows


def _same(settings: Evolution) -> str:
    """What a run that goes on must have in common with the one that was stopped."""
    free = ("name", "generations", "output", "ship", "workers", "validation")
    return json.dumps({name: value for name, value in dataclasses.asdict(settings).items() if name not in free})


def _kept(settings: Evolution) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Weights and scores of the generations that were flown before."""
    path = settings.folder / "generations.npz"
    if not path.is_file():
        return [], []
    with np.load(path, allow_pickle=False) as file:
        if str(file["settings"]) != _same(settings):
            raise ValueError(f"{path} is of a run with other settings: give another --output, or delete it")
        return list(file["asked"]), list(file["judged"])


def _keep(settings: Evolution, asked: list[np.ndarray], judged: list[np.ndarray], rows: list[dict[str, float]]) -> None:
    """Write the generations that were flown, and the learning curve."""
    with replacing(settings.folder / "generations.npz", ".npz") as path:
        np.savez(path, settings=_same(settings), asked=np.array(asked), judged=np.array(judged))
    lines = ["generation,mean,start,step", *(",".join(f"{value:.6g}" for value in row.values()) for row in rows)]
    write_text(settings.folder / "curve.csv", "\n".join(lines) + "\n")


def _curve(folder: Path) -> list[dict[str, float]]:
    """Rows of the learning curve that were written before."""
    path = folder / "curve.csv"
    if not path.is_file():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
