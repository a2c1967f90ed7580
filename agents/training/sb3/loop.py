"""Training loop of Stable-Baselines3's algorithms: validation, checkpoints and timing on the way to the run's end."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from tqdm import tqdm

from agents.training.run import Run
from agents.training.sb3.switches import SwitchedVecEnv
from agents.training.settings import RLSettings
from satid_gym.evaluation import seeds
from satid_gym.files import write_json
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.sb3 import RateCommandVecEnv

_LOGGED = ("final_error", "mean_error", "outside_fraction", "reward")


class AfterUpdate:
    """Mixin for algorithms: times updates and calls `after_update` after each, which is when a run can be saved."""

    after_update: Callable[[], None]
    update_seconds = 0.0

    def train(self, *arguments: Any, **named: Any) -> None:
        """One update."""
        start = time.perf_counter()
        super().train(*arguments, **named)  # type: ignore[misc]
        self.update_seconds += time.perf_counter() - start
        self.after_update()


def environment(settings: RLSettings) -> RateCommandVecEnv:
    """Environments to train in, side by side."""
    s = settings
    given = {
        "margin": s.margin if s.control == "rate" else None,
        "stagger": True,
        "satellite": s.pool(),
        "inertia": s.inertia,
        "scenario": s.scenario,
        "reward": s.reward,
        "include_covariance": s.include_covariance,
        "control": s.actions,
        "observation": s.observation,
        "include_walk": s.include_walk,
        "spares_modes": s.spares_modes,
    }
    if s.switches:
        return SwitchedVecEnv(s.num_envs, repeat=s.repeat, reversals=s.reversals, **given)
    return RateCommandVecEnv(s.num_envs, **given)


class Training:
    """Training of a model to the end of its run.

    Args:
        run: of which the checkpoint is restored, if it has one.
        model: an algorithm with `AfterUpdate`.
        env: in which it learns.
        policy_of: the model as a policy.
    """

    def __init__(self, run: Run, model: Any, env: RateCommandVecEnv, policy_of: Callable[[Any], LearnedPolicy]) -> None:
        self.run, self.model, self.env, self.policy_of = run, model, env, policy_of
        s: RLSettings = run.settings  # type: ignore[assignment]
        self.settings = s
        # after the model, which has seeded the environments in its own way: runs 0 and 1 would share all but one
        env.seed(seeds("training", s.num_envs, s.seed * s.num_envs)[0])
        model.set_logger(configure(str(run.folder / "tensorboard"), ["tensorboard"]))
        model.after_update = self._after_update
        notes = run.restore(model, env)
        self.seconds = notes.get("seconds", {"total": 0.0, "environment": 0.0, "update": 0.0, "evaluation": 0.0})

    def learn(self) -> None:
        """Train with a progress bar; nothing if the run has had its decisions."""
        run, model, steps = self.run, self.model, self.settings.steps
        left = steps - model.num_timesteps
        if left <= 0:
            print(f"{run.folder} has had its {steps} decisions already")
            return
        with run.progress(steps, model.num_timesteps, "decisions") as bar:
            self._before, self._start = dict(self.seconds), time.perf_counter()
            if not run.curve:
                self._evaluate()
            model.learn(left, callback=_Progress(bar), reset_num_timesteps=False, log_interval=10)
            self._count_seconds()
            if run.curve[-1]["steps"] != model.num_timesteps:
                self._evaluate()
            run.save(model, self.env, seconds=self.seconds)
        self._report()

    def _after_update(self) -> None:
        self._count_seconds()
        if self.model.num_timesteps - self.run.curve[-1]["steps"] >= self.settings.evaluate_every:
            self._evaluate()
            self.run.save(self.model, self.env, seconds=self.seconds)

    def _count_seconds(self) -> None:
        before = self._before
        self.seconds["total"] = before["total"] + time.perf_counter() - self._start
        self.seconds["environment"] = before["environment"] + self.env.seconds
        self.seconds["update"] = before["update"] + self.model.update_seconds

    def _evaluate(self) -> None:
        start = time.perf_counter()
        policy = self.policy_of(self.model)
        rows = self.run.evaluate(policy, steps=self.model.num_timesteps, seconds=round(self.seconds["total"], 1))
        self.run.keep(policy)
        self.seconds["evaluation"] += time.perf_counter() - start
        for row in rows:
            for name in _LOGGED:
                self.model.logger.record(f"validation_{row['satellite']}/{name}", row[name])

    def _report(self) -> None:
        s, steps, folder = self.seconds, self.model.num_timesteps, self.run.folder
        rollout = s["total"] - s["environment"] - s["update"] - s["evaluation"]
        parts = {"environment": s["environment"], "policy and buffer": rollout, "update": s["update"]}
        parts["evaluation"] = s["evaluation"]
        split = ", ".join(f"{name} {value:.0f} s" for name, value in parts.items())
        print(f"{steps} decisions in {s['total']:.0f} s: {steps / s['total']:.0f} a second ({split})")
        print(f"policy with the best validation score: {folder / 'policy'}.safetensors")
        timing = {"decisions": steps, "decisions_per_s": steps / s["total"], "seconds": {**s, "rollout": rollout}}
        write_json(folder / "timing.json", timing)


class _Progress(BaseCallback):
    """Moves the progress bar."""

    def __init__(self, bar: tqdm) -> None:
        super().__init__()
        self._bar = bar

    def _on_step(self) -> bool:
        self._bar.update(self.training_env.num_envs)
        return True
