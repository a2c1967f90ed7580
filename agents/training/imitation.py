"""Imitation of model-predictive excitation: `python -m agents.imitate`.

DAgger (Ross, Gordon and Bagnell, AISTATS 2011): the network flies, the planner says for every decision of those
flights to which side it would turn each axis and what that is worth, and the network is fitted to all it has said so
far, each decision with the weight of its worth: as AggreVaTe (Ross and Bagnell, 2014) it minimises what its choices
cost, not their number that differ.

A run's folder holds settings, versions, revision, the learning curve, what the teacher said in each round and the
policy. A run that is stopped at any moment goes on from its last whole round with --resume, with the same result.

With --data it flies nothing, and is behaviour cloning: the network is fitted to the body rates that policies commanded
in data sets of `python -m agents.dataset --control rate`: to the side of each axis, weighted by its magnitude.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, ClassVar

import numpy as np
import torch
import tyro
from tqdm import tqdm

from agents.dataset.storage import check_commands, commands
from agents.training.clocks import set_clocks
from agents.training.run import Run, RunOptions
from agents.training.settings import RESTART
from agents.training.teacher import Answers, TeacherSettings, answers, fly_round, save_round
from baselines.command import cli
from satid_gym.config import check_integer, check_number
from satid_gym.files import read_json, write_json
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.problem import problem

_HEAVIEST = 10.0  # weight of a decision, over the mean
_GAIN = 16.0  # from log odds to the command, which is cut to [-1, 1]: all but undecided ones go to the limit


@dataclass(frozen=True, eq=False, kw_only=True)
class ImitationSettings(TeacherSettings):
    """Everything that decides what is learned from model-predictive excitation."""

    algorithm: ClassVar[str] = "imitation"

    name: str = "generalist"
    """What tables call the policy."""
    hidden: tuple[int, ...] = (128, 128)
    """Layers of the network."""
    wheel_scales: tuple[float, ...] = (1.0, 0.1)
    """Factors on the wheels' speed limit; each satellite is flown with each (0.1: as in scenario "tight", which
    has that factor already and takes 1 alone)."""
    margin: float = 2.75
    """Margin of the rate loop, in standard deviations of one decision's noise."""
    epochs: int = 20
    """Passes over all decisions in the last fit."""
    round_epochs: int = 6
    """Passes over them in the fit after any other round."""
    batch_size: int = 1024
    """Decisions in a minibatch."""
    learning_rate: float = 2e-3
    """At the start of a fit; falls linearly to a hundredth."""
    evaluation_episodes: int = 64
    """Episodes of an evaluation on validation seeds, on each satellite."""
    data: tuple[str, ...] = ()
    """Data sets of `python -m agents.dataset --control rate` to learn from in place of a teacher: Minari's names."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("epochs", "round_epochs", "batch_size"):
            check_integer(name, getattr(self, name))
        check_number("learning_rate", self.learning_rate, strict=True)

    @property
    def actions(self) -> str:
        """What actions of the environment are, its `control`: those of data sets are body rates."""
        return "rate" if self.data else super().actions


def fit(said: Sequence[Answers], settings: ImitationSettings, epochs: int) -> Network:
    """A network whose commands have the advantages' signs, by logistic regression with Adam; magnitudes are weights.

    Args:
        said: what the teacher said, in as many pieces as there are.
        settings: of the run.
        epochs: passes over the decisions.
    """
    observations, advantages = (np.concatenate(parts) for parts in zip(*said, strict=True))
    posed = problem(settings.pool(), scenario=settings.scenario, **settings.observed)
    torch.manual_seed(settings.seed)
    widths = [observations.shape[1], *settings.hidden]
    layers: list[torch.nn.Module] = []
    for width, following in zip(widths, [*widths[1:], 3], strict=True):
        layers += [torch.nn.Linear(width, following), torch.nn.Tanh()]
    model = torch.nn.Sequential(*layers[:-1])
    set_clocks(model[0], posed)
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
    network = Network.of_layers(model)
    return Network(
        (*network.weights[:-1], _GAIN * network.weights[-1]), (*network.biases[:-1], _GAIN * network.biases[-1])
    )


def policy_of(network: Network, settings: ImitationSettings) -> LearnedPolicy:
    """The network as a policy: it commands rates and sees what the teacher was told of."""
    observed = {name: value for name, value in settings.observed.items() if name != "control"}
    return LearnedPolicy(settings.name, network, "rate", settings.margin, **observed)


def train(run: Run) -> None:
    """Fly and fit, round by round, to the end of the run; or fit to data sets."""
    s: ImitationSettings = run.settings  # type: ignore[assignment]
    if s.data:
        with cli.user_errors():
            data = [commands(name) for name in s.data]
        clone(run, data)
        return
    said = answers(run.folder, s.rounds)
    if len(said) == s.rounds:
        print(f"{run.folder} has had its {s.rounds} rounds already")
        return
    notes = run.folder / "curve.json"
    curve = read_json(notes, RESTART, keys=["curve"])["curve"] if notes.exists() else []
    run.curve = [row for row in curve if row["round"] < len(said)]  # not of a round that was not saved
    flights = sum(len(s.places(i)) for i in range(s.rounds))
    flown = sum(len(s.places(i)) for i in range(len(said)))
    start = time.perf_counter() - (run.curve[-1]["seconds"] if run.curve else 0.0)
    network = fit(said, s, s.round_epochs) if said else None
    with run.progress(flights, flown, "flights") as bar:
        for i in range(len(said), s.rounds):
            said.append(fly_round(network, s, i, bar.update))
            last = i == s.rounds - 1
            network = fit(said, s, s.epochs if last else s.round_epochs)
            policy = policy_of(network, s)
            decisions = sum(len(observations) for observations, _ in said)
            run.evaluate(policy, round=i, decisions=decisions, seconds=round(time.perf_counter() - start, 1))
            run.write_curve()
            write_json(notes, {"curve": run.curve})
            policy.save(run.folder / ("policy" if last else "last"))
            save_round(run.folder, i, said[-1])
    print(f"{run.curve[-1]['decisions']} decisions of the teacher in {run.curve[-1]['seconds']:.0f} s")
    print(f"policy: {run.folder / 'policy'}.safetensors")


def clone(run: Run, flown: Sequence[Answers]) -> None:
    """Fit a network to observations and commands of flights."""
    s: ImitationSettings = run.settings  # type: ignore[assignment]
    start = time.perf_counter()
    with run.progress(1, 0, "fits") as bar:
        policy = policy_of(fit(flown, s, s.epochs), s)
        decisions = sum(len(observations) for observations, _ in flown)
        run.evaluate(policy, decisions=decisions, seconds=round(time.perf_counter() - start, 1))
        bar.update()
    run.write_curve()
    policy.save(run.folder / "policy")
    print(f"policy: {run.folder / 'policy'}.safetensors")


@dataclass(frozen=True, kw_only=True)
class ImitationOptions(RunOptions):
    """Where the run goes, and any of its settings by its name."""

    training: Annotated[ImitationSettings, tyro.conf.arg(name="")] = field(default_factory=ImitationSettings)

    def check(self) -> None:
        """Refuse settings for a run that has its own, and data sets of other flights.

        Raises:
            ValueError: --resume comes with other settings than the folder, or a data set cannot be learned from.
        """
        if self.resume and (self.run is None or self.training != ImitationSettings()):
            raise ValueError("--resume needs --run FOLDER and nothing else: the run keeps its settings")
        for name in self.training.data:
            check_commands(name)


def main(options: ImitationOptions) -> int:
    """Imitate; the exit code."""
    with cli.user_errors():
        settings = ImitationSettings.of_run(options.run) if options.resume and options.run else options.training
    return options.start(train, settings, "agents.imitate")
