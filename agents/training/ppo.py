"""Train an excitation policy with Stable-Baselines3's PPO.

    python -m agents.train --settings ppo                   the shipped PPO policy, anew
    python -m agents.train --satellite microsat --steps 200000
    python -m agents.train --run runs/ppo-0 --resume        go on after a stop

Every run has a folder: settings, versions, revision, learning curve, TensorBoard, checkpoint and policy. A run
that is stopped at any moment resumes from its last checkpoint with the same result.
"""

from __future__ import annotations

import argparse
import csv
import io
import shlex
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import tyro
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from tqdm import tqdm

from agents.training import checkpoint
from agents.training.settings import Task, TrainSettings, named
from baselines.command.cli import ended
from baselines.command.provenance import command, revision, versions
from satid_gym.evaluation import benchmark_scenario, fly, seeds
from satid_gym.files import PART, write_json, write_text
from satid_gym.metrics import BEYOND_MAX, beyond_envelope
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.sb3 import RateCommandVecEnv

CURVE_FIELDS = (
    "steps",
    "seconds",
    "satellite",
    "reward",
    "final_error",
    "mean_error",
    "outside_fraction",
    "saturated_fraction",
    "nees",
)


class ExcitationPPO(PPO):
    """PPO that tells when an update is done, which is when a run can be saved."""

    after_update: Any = None
    update_seconds = 0.0

    def train(self) -> None:
        """One update."""
        start = time.perf_counter()
        super().train()
        self.update_seconds += time.perf_counter() - start
        if self.after_update is not None:
            self.after_update()


def network_of(layers: Iterable[torch.nn.Module]) -> Network:
    """The linear ones of torch's layers, in order."""
    linear = [layer for layer in layers if isinstance(layer, torch.nn.Linear)]
    weights = tuple(layer.weight.detach().numpy().copy() for layer in linear)
    return Network(weights, tuple(layer.bias.detach().numpy().copy() for layer in linear))


def learned_policy(model: PPO, settings: TrainSettings) -> LearnedPolicy:
    """The model's mean action as a policy."""
    network, s = network_of([*model.policy.mlp_extractor.policy_net, model.policy.action_net]), settings
    return LearnedPolicy(s.name, network, s.control, s.margin, s.include_covariance)


def validate(policy: LearnedPolicy, settings: Task, episodes: int) -> list[dict[str, Any]]:
    """Mean scores on validation seeds and the paper's laws, one row a satellite."""
    rows = []
    for satellite in settings.satellites:
        flight = fly(
            policy,
            satellite=satellite,
            inertia=settings.inertia,
            seeds=seeds("validation", episodes),
            scenario=benchmark_scenario(settings.scenario),
        )
        scores = {name: float(np.mean(value)) for name, value in flight.scores().items()}
        rows.append({"satellite": satellite.name, **{k: scores[k] for k in CURVE_FIELDS if k in scores}})
    return rows


def merit(rows: list[dict[str, Any]]) -> float:
    """Lower is better: geometric mean of final and mean error over satellites, and first to keep to the envelope."""
    errors = [row[name] for row in rows for name in ("final_error", "mean_error")]
    beyond = max(beyond_envelope(row["outside_fraction"], row["saturated_fraction"]) for row in rows)
    return float(np.exp(np.mean(np.log(errors)))) * max(1.0, beyond / BEYOND_MAX)


def summary(rows: list[dict[str, Any]]) -> str:
    """Validation scores in a line."""
    shown = ("final_error", "mean_error", "outside_fraction")
    text = "  ".join(" ".join([r["satellite"], *(f"{100 * r[name]:.3f}" for name in shown)]) for r in rows)
    return f"final, mean error and outside in %:  {text}"


def write_curve(folder: Path, fields: Sequence[str], curve: list[dict[str, Any]]) -> None:
    """Write curve.csv."""
    table = io.StringIO()
    writer = csv.DictWriter(table, fields, lineterminator="\n")
    writer.writeheader()
    writer.writerows(curve)
    write_text(folder / "curve.csv", table.getvalue())


class Run:
    """A training run and its folder."""

    def __init__(self, settings: TrainSettings, folder: Path, *, resume: bool, command: str) -> None:
        self.settings, self.folder = settings, folder
        self.checkpoint = folder / "checkpoint.npz"
        if checkpoint.exists(self.checkpoint) and not resume:
            raise ValueError(f"{folder} holds a run already: add --resume to go on with it, or choose another --run")
        if resume and not (folder / "run.json").exists():
            raise ValueError(f"{folder} holds no run to resume")
        torch.set_num_threads(1)  # numba's threads and torch's would fight for the cores
        margin = settings.margin if settings.control == "rate" else None
        self.env = RateCommandVecEnv(
            settings.num_envs,
            margin=margin,
            stagger=True,
            satellite=settings.pool(),
            inertia=settings.inertia,
            scenario=settings.scenario,
            reward=settings.reward,
            include_covariance=settings.include_covariance,
        )
        self.model = self._new_model()
        # after the model, which has seeded the environments in its own way: runs 0 and 1 would share all but one
        self.env.seed(seeds("training", settings.num_envs, settings.seed * settings.num_envs)[0])
        self.model.after_update = self._after_update
        self.curve: list[dict[str, Any]] = []
        self.best = np.inf
        self.seconds = {"total": 0.0, "environment": 0.0, "update": 0.0, "evaluation": 0.0}
        folder.mkdir(parents=True, exist_ok=True)
        if checkpoint.exists(self.checkpoint):  # a run that was stopped before its first one starts anew
            notes = checkpoint.load(self.checkpoint, self.model, self.env)
            self.curve, self.best, self.seconds = notes["curve"], notes["best"], notes["seconds"]
        head = {"command": command, "revision": revision(), "versions": versions(), "settings": settings.to_dict()}
        if not resume:
            write_json(folder / "run.json", head)
        for part in folder.glob(f".*{PART}"):  # what was being written when the process was killed
            part.unlink()
        self.model.set_logger(configure(str(folder / "tensorboard"), ["tensorboard"]))

    def _new_model(self) -> ExcitationPPO:
        s = self.settings

        def learning_rate(remaining: float) -> float:
            return s.final_learning_rate + remaining * (s.learning_rate - s.final_learning_rate)

        return ExcitationPPO(
            "MlpPolicy",
            self.env,
            learning_rate=learning_rate,
            n_steps=s.rollout,
            batch_size=s.batch_size,
            n_epochs=s.epochs,
            gamma=s.gamma,
            gae_lambda=s.gae_lambda,
            clip_range=s.clip_range,
            ent_coef=s.entropy,
            use_sde=True,
            sde_sample_freq=s.hold,
            policy_kwargs={"net_arch": list(s.hidden), "log_std_init": s.log_std},
            seed=s.seed,
            device="cpu",
        )

    def learn(self) -> None:
        """Train to the end, with a progress bar."""
        left = self.settings.steps - self.model.num_timesteps
        if left <= 0:
            print(f"{self.folder} has had its {self.settings.steps} decisions already")
            return
        with tqdm(
            total=self.settings.steps, initial=self.model.num_timesteps, unit=" decisions", unit_scale=True
        ) as bar:
            self._bar = bar
            self._saved, self._start = dict(self.seconds), time.perf_counter()
            if not self.curve:
                self._evaluate()
            self.model.learn(left, callback=_Progress(bar), reset_num_timesteps=False, log_interval=10)
            self._count_seconds()
            if self.curve[-1]["steps"] != self.model.num_timesteps:
                self._evaluate()
            self._save()
        self._report()

    def _count_seconds(self) -> None:
        now = time.perf_counter()
        self.seconds["total"] = self._saved["total"] + now - self._start
        self.seconds["environment"] = self._saved["environment"] + self.env.seconds
        self.seconds["update"] = self._saved["update"] + self.model.update_seconds

    def _after_update(self) -> None:
        self._count_seconds()
        done = self.curve[-1]["steps"] if self.curve else 0
        if self.model.num_timesteps - done >= self.settings.evaluate_every:
            self._evaluate()
            self._save()

    def _evaluate(self) -> None:
        start = time.perf_counter()
        policy = learned_policy(self.model, self.settings)
        rows = validate(policy, self.settings, self.settings.evaluation_episodes)
        self.seconds["evaluation"] += time.perf_counter() - start
        at = {"steps": self.model.num_timesteps, "seconds": round(self.seconds["total"], 1)}
        self.curve += [{**at, **row} for row in rows]
        for row in rows:
            for name in ("final_error", "mean_error", "outside_fraction", "reward"):
                self.model.logger.record(f"validation_{row['satellite']}/{name}", row[name])
        score = merit(rows)
        self._bar.write(f"{at['steps'] / 1e6:6.2f} M  {summary(rows)}")
        policy.details = {
            "trained": {"method": "ppo", "settings": self.settings.to_dict(), "seed": self.settings.seed, **at},
            "validation": rows,
        }
        policy.save(self.folder / "last")
        if score < self.best:
            self.best = score
            policy.save(self.folder / "policy")

    def _save(self) -> None:
        notes = {"curve": self.curve, "best": self.best, "seconds": self.seconds}
        write_curve(self.folder, CURVE_FIELDS, self.curve)
        checkpoint.save(self.checkpoint, self.model, self.env, notes)

    def _report(self) -> None:
        s, steps = self.seconds, self.model.num_timesteps
        rollout = s["total"] - s["environment"] - s["update"] - s["evaluation"]
        parts = {"environment": s["environment"], "policy and buffer": rollout, "update": s["update"]}
        parts["evaluation"] = s["evaluation"]
        split = ", ".join(f"{name} {value:.0f} s" for name, value in parts.items())
        print(f"{steps} decisions in {s['total']:.0f} s: {steps / s['total']:.0f} a second ({split})")
        print(f"policy with the best validation score: {self.folder / 'policy'}.safetensors")
        timing = {"decisions": steps, "decisions_per_s": steps / s["total"], "seconds": {**s, "rollout": rollout}}
        write_json(self.folder / "timing.json", timing)


class _Progress(BaseCallback):
    """Moves the progress bar."""

    def __init__(self, bar: tqdm) -> None:
        super().__init__()
        self._bar = bar

    def _on_step(self) -> bool:
        self._bar.update(self.training_env.num_envs)
        return True


@dataclass(frozen=True, kw_only=True)
class Options:
    """Where settings come from, where the run goes, and any training setting by its name."""

    settings: str | None = None
    """Named settings to start from (agents/training/configs/*.json)."""
    run: Path | None = None
    """Folder of the run; runs/NAME-SEED by default."""
    resume: bool = False
    """Go on with the run in that folder, by the settings it was started with."""
    training: Annotated[TrainSettings, tyro.conf.arg(name="")] = field(default_factory=TrainSettings)


def _base(arguments: list[str]) -> TrainSettings:
    """The settings that the command line starts from: named ones, or those of the run to resume."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--settings")
    parser.add_argument("--run", type=Path)
    parser.add_argument("--resume", action="store_true")
    known, others = parser.parse_known_args(arguments)
    if not known.resume:
        return named(known.settings) if known.settings else TrainSettings()
    if known.run is None or others or known.settings:
        raise ValueError("--resume needs --run FOLDER and nothing else: the run keeps its settings")
    return TrainSettings.of_run(known.run)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        start = Options(training=_base(arguments))
        options = tyro.cli(Options, args=arguments, default=start, description=__doc__)
        settings = options.training
        folder = options.run or Path("runs") / f"{settings.name}-{settings.seed}"
        run = Run(settings, folder, resume=options.resume, command=command("agents.train", arguments))
    except OSError as error:
        sys.exit(f"agents.train: {error.filename or folder}: {error.strerror or error}")
    except ValueError as error:
        sys.exit(f"agents.train: {error}")
    again = shlex.join(["python", "-m", "agents.train", "--run", str(folder), "--resume"])
    try:
        code = ended(run.learn, f"go on with: {again}")
    finally:
        run.env.close()
    if code:
        sys.exit(code)


if __name__ == "__main__":
    sys.exit(ended(main))
