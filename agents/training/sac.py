"""Soft Actor-Critic (Haarnoja et al., 2018) by Stable-Baselines3: `python -m agents.train --settings sac`."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from typing import ClassVar

from stable_baselines3 import SAC

from agents.training.run import Run
from agents.training.sb3.loop import AfterUpdate, Training, environment
from agents.training.settings import RLSettings, policy_of
from satid_gym.config import check_integer, check_number
from satid_gym.policies.learned import LearnedPolicy, Network


@dataclass(frozen=True, eq=False, kw_only=True)
class SACSettings(RLSettings):
    """Everything that decides what a run of Soft Actor-Critic learns."""

    algorithm: ClassVar[str] = "sac"

    name: str = "sac"
    """What tables call the policy."""
    steps: int = 200_000
    """Decisions to train for, all environments together."""
    num_envs: int = 16
    """Environments side by side."""
    batch_size: int = 256
    """Decisions in a minibatch."""
    evaluate_every: int = 20_000
    """Decisions between evaluations on validation seeds."""
    rollout: int = 4
    """Decisions of each environment between two updates."""
    gradient_steps: int = 8
    """Minibatches of an update."""
    buffer: int = 200_000
    """Decisions in the replay buffer."""
    warmup: int = 5_000
    """Decisions at random before the first update."""
    learning_rate: float = 1e-3
    """Learning rate of actor, critics and entropy weight."""
    tau: float = 0.005
    """Share by which the target critics follow the critics in a gradient step."""
    entropy: float = 0.05
    """First weight of the entropy; it is learned."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("rollout", "gradient_steps", "warmup"):
            check_integer(name, getattr(self, name))
        check_integer("buffer", self.buffer, low=self.num_envs)
        for name in ("learning_rate", "entropy"):
            check_number(name, getattr(self, name), strict=True)
        check_number("tau", self.tau, strict=True, high=1.0)


class ExcitationSAC(AfterUpdate, SAC):
    """SAC that tells when an update is done."""


def learned_policy(model: SAC, settings: SACSettings) -> LearnedPolicy:
    """The model's mean action, squashed by tanh, as a policy."""
    network = Network.of_layers([*model.actor.latent_pi, model.actor.mu], activation="relu", squashed=True)
    return policy_of(network, settings)


def train(run: Run) -> SAC:
    """Train to the end of the run; the model."""
    s: SACSettings = run.settings  # type: ignore[assignment]
    with closing(environment(s)) as env:
        model = ExcitationSAC(
            "MlpPolicy",
            env,
            learning_rate=s.learning_rate,
            buffer_size=s.buffer,
            learning_starts=s.warmup,
            batch_size=s.batch_size,
            tau=s.tau,
            gamma=s.gamma,
            train_freq=s.rollout,
            gradient_steps=s.gradient_steps,
            ent_coef=f"auto_{s.entropy}",
            policy_kwargs={"net_arch": list(s.hidden)},
            seed=s.seed,
            device="cpu",
        )
        Training(run, model, env, lambda m: learned_policy(m, s)).learn()
    return model
