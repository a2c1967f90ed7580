"""Teach a network what model-predictive excitation would do: `python -m agents.imitate`.

DAgger (Ross, Gordon and Bagnell, AISTATS 2011): the network flies, the planner says for every decision of those
flights to which side it would turn each axis and what that is worth, and the network is fitted to all it has said so
far, each decision with the weight of its worth: as AggreVaTe (Ross and Bagnell, 2014) it minimises what its choices
cost, not their number that differ. The planner takes a thousand times as long as the network,
and is told what the network has to find out from its observations: how the inertia varies.

A run's folder holds settings, versions, revision, the learning curve, what the teacher said in each round and the
policy. A run that is stopped at any moment goes on from its last whole round with --resume, with the same result.
"""

from __future__ import annotations

import io
import itertools
import os
import shlex
import sys
import time
import zipfile
import zlib
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import tyro
from tqdm import tqdm

from agents.training.ppo import network_of, summary, validate, write_curve
from agents.training.settings import ANEW, ImitationSettings
from baselines.command.cli import ended
from baselines.command.provenance import command, revision, versions
from satid_gym import SatInertiaIDVectorEnv
from satid_gym.control.rate_loop import RateLoop
from satid_gym.evaluation import seeds
from satid_gym.files import read_json, write_bytes, write_json
from satid_gym.laws import INERTIA_MODES
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.policies.mpc import MPCPolicy
from satid_gym.policy import missions
from satid_gym.problem import problem
from satid_gym.satellite import Satellite

CURVE_FIELDS = (
    "round",
    "decisions",
    "seconds",
    "satellite",
    "final_error",
    "mean_error",
    "outside_fraction",
    "saturated_fraction",
    "nees",
)
Answers = tuple[np.ndarray, np.ndarray]  # observations (D, size) and advantages of the plus side (D, 3)
_CLOCKS = (3, 6, 10, 15, 22, 30)  # decisions before the end at which units of the first layer begin to switch
_HEAVIEST = 10.0  # weight of a decision, over the mean
_GAIN = 16.0  # from log odds to the command, which is cut to [-1, 1]: all but undecided ones go to the limit


def teach(network: Network | None, satellite: Satellite, settings: ImitationSettings, flown: int) -> Answers:
    """Fly episodes, shared evenly among the inertia modes, and ask the teacher at every decision.

    Args:
        network: flies all but the share that the teacher does; None lets the teacher fly all.
        satellite: to fly.
        settings: of the run.
        flown: how many of the training seeds to pass over, for others have had them.

    Returns:
        Observations (D, size) and the advantages (D, 3) of the plus side, see `Planner.side_value`; float32.
    """
    chosen, modes = seeds("training", settings.episodes, flown), settings.modes
    shares = [(mode, chosen[i :: len(modes)]) for i, mode in enumerate(modes)]
    said = [_teach(network, satellite, mode, settings, share) for mode, share in shares]
    return np.concatenate([x for x, _ in said]), np.concatenate([y for _, y in said])


def _teach(
    network: Network | None, satellite: Satellite, mode: str, settings: ImitationSettings, chosen: Sequence[int]
) -> Answers:
    """Episodes of one inertia mode, of which the teacher is told."""
    env = SatInertiaIDVectorEnv(len(chosen), satellite, mode, settings.scenario, num_threads=1, include_covariance=True)
    (mission,) = missions(env.problem)
    loop = RateLoop([mission], settings.margin)
    walk = settings.walks[INERTIA_MODES.index(mode) if mode in INERTIA_MODES else 0]  # type: ignore[arg-type]
    teacher = MPCPolicy(steps=settings.steps, edits=settings.edits, margin=settings.margin, walk=walk)
    teacher.reset(mission, chosen)
    observation, _ = env.reset(seed=chosen)
    taught = np.random.default_rng([chosen[0], 5]).random((len(chosen), 1)) < settings.taught
    alive = np.ones(len(chosen), bool)
    observations, advantages = [], []
    for _ in range(mission.scenario.decisions):
        wanted, side_value = teacher.weigh(observation)
        observations.append(observation[alive])
        advantages.append(side_value[alive].astype(np.float32))
        command = wanted if network is None else np.where(taught, wanted, network(observation))
        observation, _, terminated, *_ = env.step(loop(observation, command))
        alive &= ~terminated
    env.close()
    return np.concatenate(observations), np.concatenate(advantages)


def fit(said: Sequence[Answers], settings: ImitationSettings, epochs: int) -> Network:
    """A network whose commands have the advantages' signs, by logistic regression with Adam; magnitudes are weights.

    Args:
        said: what the teacher said, in as many pieces as there are.
        settings: of the run.
        epochs: passes over the decisions.
    """
    observations, advantages = (np.concatenate(parts) for parts in zip(*said, strict=True))
    posed = problem(settings.pool(), scenario=settings.scenario, include_covariance=True)
    torch.manual_seed(settings.seed)
    widths = [observations.shape[1], *settings.hidden]
    layers: list[torch.nn.Module] = []
    for width, following in zip(widths, [*widths[1:], 3], strict=True):
        layers += [torch.nn.Linear(width, following), torch.nn.Tanh()]
    model = torch.nn.Sequential(*layers[:-1])
    _set_clocks(model[0], posed.layout["time_left"].start, posed.scenario.decisions)
    x, y = torch.from_numpy(observations), torch.from_numpy((advantages > 0.0).astype(np.float32))
    weight = np.abs(advantages)
    weight = torch.from_numpy(np.minimum(weight / weight.mean(), _HEAVIEST))
    adam = torch.optim.Adam(model.parameters(), settings.learning_rate)
    size = min(settings.batch_size, len(x))
    count = epochs * (len(x) // size)
    decay = torch.optim.lr_scheduler.LinearLR(adam, 1.0, 0.01, count)
    for _ in tqdm(range(epochs), desc="fit", unit=" epochs", leave=False, disable=None):
        for rows in torch.randperm(len(x))[: len(x) // size * size].split(size):
            adam.zero_grad()
            torch.nn.functional.binary_cross_entropy_with_logits(model(x[rows]), y[rows], weight[rows]).backward()
            adam.step()
            decay.step()
    network = network_of(model)
    return Network(
        (*network.weights[:-1], _GAIN * network.weights[-1]), (*network.biases[:-1], _GAIN * network.biases[-1])
    )


def _set_clocks(layer: torch.nn.Module, clock: int, horizon: int) -> None:
    """Let the first units of a layer tell the last decisions apart, of which a fraction of the horizon says little."""
    assert isinstance(layer, torch.nn.Linear)
    with torch.no_grad():
        for i, left in enumerate(_CLOCKS[: layer.out_features]):
            width = 0.35 * left
            layer.weight[i] = 0.0
            layer.weight[i, clock] = -horizon / width
            layer.bias[i] = left / width


def policy_of(network: Network, settings: ImitationSettings) -> LearnedPolicy:
    """The network as a policy: it commands rates and sees what the teacher was told of."""
    return LearnedPolicy(settings.name, network, "rate", settings.margin, include_covariance=True)


def answers(folder: Path, rounds: int) -> list[Answers]:
    """What the teacher said in the whole rounds of a run, in the order they were flown.

    Raises:
        ValueError: a round's file is damaged.
    """
    files = (_round(folder, i) for i in range(rounds))
    return [_load(file) for file in itertools.takewhile(Path.exists, files)]


def _round(folder: Path, i: int) -> Path:
    return folder / f"round-{i:02d}.npz"


def _save(file: Path, observations: np.ndarray, advantages: np.ndarray) -> None:
    buffer = io.BytesIO()
    np.savez(buffer, observations=observations, advantages=advantages)
    write_bytes(file, buffer.getvalue())


def _load(file: Path) -> Answers:
    try:
        with np.load(file, allow_pickle=False) as said:
            return said["observations"], said["advantages"]
    except (ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise ValueError(
            f"{file} is damaged ({error}): remove it, and the run goes on from the round before"
        ) from error


class Imitation:
    """A run and its folder.

    Args:
        settings: of the run.
        folder: of the run.
        resume: whether to go on with the run in it.
        command: that started it.

    Raises:
        ValueError: the folder holds a run already, or a file in it is damaged.
    """

    def __init__(self, settings: ImitationSettings, folder: Path, *, resume: bool, command: str) -> None:
        self.settings, self.folder = settings, folder
        if (folder / "run.json").exists() and not resume:
            raise ValueError(f"{folder} holds a run already: add --resume to go on with it, or choose another --run")
        torch.set_num_threads(1)
        self.curve: list[dict[str, Any]] = []
        if resume:
            notes = folder / "curve.json"
            self.curve = read_json(notes, ANEW, keys=["curve"])["curve"] if notes.exists() else []
        else:
            folder.mkdir(parents=True, exist_ok=True)
            head = {"command": command, "revision": revision(), "versions": versions(), "settings": settings.to_dict()}
            write_json(folder / "run.json", head)
        self._rounds = answers(folder, settings.rounds)
        self.curve = [row for row in self.curve if row["round"] < len(self._rounds)]  # of a round that was not saved

    def learn(self) -> None:
        """Fly and fit, round by round, with a progress bar."""
        s, pool, rounds = self.settings, self.settings.pool(), self._rounds
        if len(rounds) == s.rounds:
            print(f"{self.folder} has had its {s.rounds} rounds already")
            return
        start = time.perf_counter() - (self.curve[-1]["seconds"] if self.curve else 0.0)
        network = fit(rounds, s, s.round_epochs) if rounds else None
        with tqdm(total=s.rounds * len(pool), initial=len(rounds) * len(pool), unit=" flights") as bar:
            for i in range(len(rounds), s.rounds):
                rounds.append(self._fly(network, i, bar))
                last = i == s.rounds - 1
                network = fit(rounds, s, s.epochs if last else s.round_epochs)
                policy = policy_of(network, s)
                self._note(policy, i, sum(len(x) for x, _ in rounds), time.perf_counter() - start, bar)
                policy.save(self.folder / ("policy" if last else "last"))
                _save(_round(self.folder, i), *rounds[-1])
        print(f"{self.curve[-1]['decisions']} decisions of the teacher in {self.curve[-1]['seconds']:.0f} s")
        print(f"policy: {self.folder / 'policy'}.safetensors")

    def _fly(self, network: Network | None, i: int, bar: tqdm) -> Answers:
        """One round's flights, satellites side by side; what was observed and what the teacher said."""
        s, pool = self.settings, self.settings.pool()

        def fly(place: int) -> Answers:
            said = teach(network, pool[place], s, ((s.seed * s.rounds + i) * len(pool) + place) * s.episodes)
            bar.update()
            return said

        with ThreadPoolExecutor(os.cpu_count()) as executor:
            flights = [executor.submit(fly, place) for place in range(len(pool))]
            try:
                said = [flight.result() for flight in flights]
            except BaseException:
                executor.shutdown(cancel_futures=True)  # who interrupts waits for the flights under way alone
                raise
        return np.concatenate([x for x, _ in said]), np.concatenate([y for _, y in said])

    def _note(self, policy: LearnedPolicy, i: int, decisions: int, seconds: float, bar: tqdm) -> None:
        """Score the policy on validation seeds."""
        s = self.settings
        rows = validate(policy, s, s.evaluation_episodes)
        at = {"round": i, "decisions": decisions, "seconds": round(seconds, 1)}
        self.curve += [{**at, **{k: row[k] for k in CURVE_FIELDS if k in row}} for row in rows]
        policy.details = {"trained": {"method": "imitation", "settings": s.to_dict(), **at}, "validation": rows}
        bar.write(f"{decisions / 1e3:6.0f} k  {summary(rows)}")
        write_curve(self.folder, CURVE_FIELDS, self.curve)
        write_json(self.folder / "curve.json", {"curve": self.curve})


@dataclass(frozen=True, kw_only=True)
class Options:
    """Where the run goes, and any of its settings by its name."""

    run: Path | None = None
    """Folder of the run; runs/NAME-SEED by default."""
    resume: bool = False
    """Go on with the run in that folder, by the settings it was started with."""
    training: Annotated[ImitationSettings, tyro.conf.arg(name="")] = field(default_factory=ImitationSettings)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        options = tyro.cli(Options, args=arguments, description=__doc__)
        settings = options.training
        folder = options.run or Path("runs") / f"{settings.name}-{settings.seed}"
        if options.resume:
            if options.run is None or settings != ImitationSettings():
                raise ValueError("--resume needs --run FOLDER and nothing else: the run keeps its settings")
            settings = ImitationSettings.of_run(folder)
        run = Imitation(settings, folder, resume=options.resume, command=command("agents.imitate", arguments))
    except OSError as error:
        sys.exit(f"agents.imitate: {error.filename or folder}: {error.strerror or error}")
    except ValueError as error:
        sys.exit(f"agents.imitate: {error}")
    again = shlex.join(["python", "-m", "agents.imitate", "--run", str(folder), "--resume"])
    code = ended(run.learn, f"go on with: {again}")
    if code:
        sys.exit(code)


if __name__ == "__main__":
    sys.exit(ended(main))
