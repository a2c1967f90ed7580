"""Proximal Policy Optimization (Schulman et al., 2017) by Stable-Baselines3: `python -m agents.train`."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from typing import ClassVar

import torch
from stable_baselines3 import PPO

from agents.training.clocks import set_clocks
from agents.training.run import Run
from agents.training.sb3.loop import AfterUpdate, Training, environment
from agents.training.sb3.switches import FIRST_LOGIT, with_reversals, with_switches
from agents.training.settings import RLSettings, policy_of
from satid_gym.config import check_integer, check_number
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.sb3 import RateCommandVecEnv


@dataclass(frozen=True, eq=False, kw_only=True)
class PPOSettings(RLSettings):
    """Everything that decides what a run of PPO learns."""

    algorithm: ClassVar[str] = "ppo"

    name: str = "ppo"
    """What tables call the policy."""
    rollout: int = 50
    """Commands of each environment between two updates."""
    epochs: int = 5
    """Passes over a rollout."""
    learning_rate: float = 2e-3
    """Learning rate at the start."""
    final_learning_rate: float = 5e-5
    """Learning rate at the end; linear between."""
    gae_lambda: float = 0.8
    """Lambda of generalised advantage estimation."""
    clip_range: float = 0.2
    """Clip range of PPO's ratio."""
    entropy: float = 0.0
    """Weight of the entropy bonus."""
    log_std: float = 0.5
    """First logarithm of the exploration's standard deviation."""
    hold: int = 15
    """Decisions for which state-dependent exploration keeps its direction."""
    clocks: bool = True
    """Whether actor and critic begin with clocks of the episode's last half minute, see `agents.training.clocks`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, low in (("rollout", 1), ("epochs", 1), ("batch_size", 2)):
            check_integer(name, getattr(self, name), low=low)
        for name in ("learning_rate", "clip_range"):
            check_number(name, getattr(self, name), strict=True)
        for name in ("final_learning_rate", "entropy"):
            check_number(name, getattr(self, name))
        check_number("gae_lambda", self.gae_lambda, high=1.0)
        if (self.num_envs * self.rollout) % self.batch_size:
            raise ValueError(
                f"batch_size must divide num_envs * rollout = {self.num_envs * self.rollout}, got {self.batch_size}"
            )


class ExcitationPPO(AfterUpdate, PPO):
    """PPO that tells when an update is done."""


def learned_policy(model: PPO, settings: RLSettings) -> LearnedPolicy:
    """The model's mean action as a policy."""
    network, s = Network.of_layers([*model.policy.mlp_extractor.policy_net, model.policy.action_net]), settings
    if s.reversals:
        env = model.get_env()
        assert isinstance(env, RateCommandVecEnv)
        network = with_reversals(network, env.vector_env.problem.layout["command"])
    elif s.switches:
        network = with_switches(network)
    return policy_of(network, s)


def train(run: Run) -> PPO:
    """Train to the end of the run; the model."""
    s: PPOSettings = run.settings  # type: ignore[assignment]

    def learning_rate(remaining: float) -> float:
        return s.final_learning_rate + remaining * (s.learning_rate - s.final_learning_rate)

    with closing(environment(s)) as env:
        model = ExcitationPPO(
            "MlpPolicy",
            env,
            learning_rate=learning_rate,
            n_steps=s.rollout,
            batch_size=s.batch_size,
            n_epochs=s.epochs,
            gamma=s.gamma,
            gae_lambda=s.gae_lambda,
            clip_range=s.clip_range,
            ent_coef=s.entropy,
            use_sde=not s.switches,
            sde_sample_freq=s.hold,
            policy_kwargs={"net_arch": list(s.hidden), "log_std_init": s.log_std},
            seed=s.seed,
            device="cpu",
        )
        if s.reversals:
            logits = model.policy.action_net
            assert isinstance(logits, torch.nn.Linear)
            torch.nn.init.constant_(logits.bias, FIRST_LOGIT)
        if s.clocks:
            for net in (model.policy.mlp_extractor.policy_net, model.policy.mlp_extractor.value_net):
                set_clocks(net[0], env.vector_env.problem)
        Training(run, model, env, lambda m: learned_policy(m, s)).learn()
    return model
