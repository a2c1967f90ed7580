"""Training loop of Stable-Baselines3's algorithms: validation, checkpoints and timing on the way to the run's end."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from tqdm import tqdm

from agents.training.run import SHOWN, Run
from agents.training.sb3 import checkpoint
from agents.training.sb3.switches import SwitchedVecEnv
from agents.training.settings import RLSettings
from satid_gym.evaluation import seeds
from satid_gym.files import write_json
from satid_gym.policies.learned import LearnedPolicy
from satid_gym.sb3 import RateCommandVecEnv

_LOGGED = (*SHOWN, "reward")


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
    make: Callable[..., RateCommandVecEnv] = RateCommandVecEnv
    if s.switches:
        make = partial(SwitchedVecEnv, repeat=s.repeat, reversals=s.reversals)
    return make(
        s.num_envs,
        margin=s.margin if s.control == "rate" else None,
        stagger=True,
        satellite=s.pool(),
        inertia=s.inertia,
        scenario=s.scenario,
        reward=s.reward,
        include_covariance=s.include_covariance,
        control=s.actions,
        observation=s.observation,
        include_walk=s.include_walk,
        spares_modes=s.spares_modes,
    )


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
        self.seconds = {"total": 0.0, "environment": 0.0, "update": 0.0, "evaluation": 0.0}
        self.restore()

    @property
    def _checkpoint(self) -> Path:
        return self.run.folder / "checkpoint.npz"

    def save(self) -> None:
        """Write curve and checkpoint, from which `restore` goes on as if the run had never stopped."""
        self.run.write_curve()
        notes = {"curve": self.run.curve, "best": self.run.best, "seconds": self.seconds}
        checkpoint.save(self._checkpoint, self.model, self.env, notes)

    def restore(self) -> None:
        """Put run, model and environment where the last `save` found them; without a checkpoint they stay as they are.

        Raises:
            DamagedFileError: the checkpoint and the one before it are damaged, or of other settings.
        """
        if not checkpoint.exists(self._checkpoint):  # a run that was stopped before its first one starts again
            return
        notes = checkpoint.load(self._checkpoint, self.model, self.env)
        self.run.curve, self.run.best, self.seconds = notes["curve"], notes["best"], notes["seconds"]

    def learn(self) -> None:
        """Train with a progress bar, which counts decisions; nothing if the run has had its commands."""
        run, model, steps, repeat = self.run, self.model, self.settings.steps, self.settings.repeat
        left = steps - model.num_timesteps
        if left <= 0:
            print(f"{run.folder} has had its {steps * repeat} decisions already")
            return
        with run.progress(steps * repeat, model.num_timesteps * repeat, "decisions") as bar:
            self._before, self._start = dict(self.seconds), time.perf_counter()
            if not run.curve:
                self._evaluate()
            model.learn(left, callback=_Progress(bar, repeat), reset_num_timesteps=False, log_interval=10)
            self._count_seconds()
            if run.curve[-1]["steps"] != model.num_timesteps:
                self._evaluate()
            self.save()
        self._report()

    def _after_update(self) -> None:
        self._count_seconds()
        if self.model.num_timesteps - self.run.curve[-1]["steps"] >= self.settings.evaluate_every:
            self._evaluate()
            self.save()

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
        self._count_seconds()  # of which it is a part, even if it is the last
        for row in rows:
            for name in _LOGGED:
                self.model.logger.record(f"validation_{row['satellite']}/{name}", row[name])
        self.model.logger.dump(self.model.num_timesteps)  # now: the algorithm's own dumps are at later steps, if any

    def _kept_after(self) -> int:
        """Decisions after which the kept policy was; its file says so, also of a run that was stopped."""
        return LearnedPolicy.load(self.run.folder / "policy").details["trained"]["steps"] * self.settings.repeat

    def _report(self) -> None:
        s, folder = self.seconds, self.run.folder
        decisions = self.model.num_timesteps * self.settings.repeat
        rollout = s["total"] - s["environment"] - s["update"] - s["evaluation"]
        parts = {"environment": s["environment"], "policy and buffer": rollout, "update": s["update"]}
        parts["evaluation"] = s["evaluation"]
        split = ", ".join(f"{name} {value:.0f} s" for name, value in parts.items())
        print(f"{decisions} decisions in {s['total']:.0f} s: {decisions / s['total']:.0f} a second ({split})")
        kept = self._kept_after()
        print(f"policy with the best validation score, after {kept} decisions: {folder / 'policy'}.safetensors")
        if kept == 0:
            print("warning: that is the network from before training, and no later one was better", file=sys.stderr)
        rate = decisions / s["total"]
        timing = {"decisions": decisions, "decisions_per_s": rate, "seconds": {**s, "rollout": rollout}}
        write_json(folder / "timing.json", timing)


class _Progress(BaseCallback):
    """Moves the progress bar by the decisions of each step."""

    def __init__(self, bar: tqdm, repeat: int) -> None:
        super().__init__()
        self._bar, self._repeat = bar, repeat

    def _on_step(self) -> bool:
        self._bar.update(self.training_env.num_envs * self._repeat)
        return True
