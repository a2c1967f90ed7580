"""Fly the vector environment for as many decisions as a training run takes, and longer.

    python -m tests.qa.long_haul --decisions 100000000
    python -m tests.qa.long_haul --decisions 100000000 --resume        go on after a stop

Memory must not grow, speed must not fall and nothing may be NaN. Prints figures and writes them as JSON; the state
is kept next to it from time to time, so that a run can be stopped at any moment.
"""

from __future__ import annotations

import json
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from baselines.command import cli
from baselines.command.provenance import result_head
from satid_gym import SatInertiaIDVectorEnv
from satid_gym.config import check_integer
from satid_gym.files import check_writable, write_json

SAMPLES = 200  # of memory and speed over the run
_HOLD = 5  # decisions that an action is held
_PAGE = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True, kw_only=True)
class LongHaul:
    """What to fly."""

    decisions: int = 100_000_000
    """Decisions of all environments together."""
    envs: int = 1024
    """Environments side by side."""
    threads: int | None = 2
    """The most threads to use; all cores where None."""
    seed: int = 0
    """Of environments and actions."""
    resume: bool = False
    """Go on with the run whose state lies next to the output."""
    output: Path = Path("results/long_haul.json")
    """Where figures go."""

    @property
    def state_file(self) -> Path:
        """Where the state is kept until the run is done."""
        return self.output.with_suffix(".npz")


def resident() -> int:
    """Bytes of memory that this process holds now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * _PAGE


def actions(chance: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Small for half the environments, which reach their horizon; bang-bang at full torque for the others."""
    drawn = chance.uniform(-0.05, 0.05, shape)
    drawn[::2] = np.sign(drawn[::2])
    return drawn.astype(np.float32)


class Haul:
    """One run, with what has been seen of it so far."""

    def __init__(self, settings: LongHaul) -> None:
        check_integer("decisions", settings.decisions, low=settings.envs * SAMPLES)
        self.settings = settings
        self.env = SatInertiaIDVectorEnv(
            settings.envs, satellite="random", num_threads=settings.threads, autoreset_mode="NextStep", stagger=True
        )
        self.env.reset(seed=settings.seed)
        self.steps = 0
        self.seen: dict[str, Any] = {"samples": [], "episodes": 0, "terminated": 0, "reward": 0.0}
        if settings.resume:
            self._load()

    @property
    def total(self) -> int:
        """Steps of the vector environment in all."""
        return -(-self.settings.decisions // self.settings.envs)

    def run(self) -> None:
        """Fly to the end.

        Raises:
            FloatingPointError: an observation, a reward or an error was not finite.
        """
        every = self.total // SAMPLES
        last, first = time.perf_counter(), self.steps
        shape = self.env.action_space.shape
        assert shape is not None
        drawn = np.zeros(shape, np.float32)
        with tqdm(
            total=self.settings.decisions, initial=first * self.settings.envs, unit=" decisions", unit_scale=True
        ) as bar:
            while self.steps < self.total:
                if self.steps % _HOLD == 0 or self.steps == first:
                    block = self.steps // _HOLD  # drawn from where the run is, so that a resumed one is the same
                    drawn = actions(np.random.default_rng((self.settings.seed, block)), (shape[0], shape[1]))
                self._step(drawn)
                bar.update(self.settings.envs)
                if self.steps % every == 0:
                    now = time.perf_counter()
                    self.seen["samples"].append(
                        {"decisions": self.steps * self.settings.envs, "bytes": resident(), "seconds": now - last}
                    )
                    self._save()
                    last = time.perf_counter()

    def _step(self, drawn: np.ndarray) -> None:
        observations, rewards, terminations, truncations, infos = self.env.step(drawn)
        for name, values in (("observation", observations), ("reward", rewards), ("nees", infos["nees"])):
            if not np.isfinite(values).all():
                rows = np.unique(np.argwhere(~np.isfinite(values))[:, 0]).tolist()
                raise FloatingPointError(f"{name} of environments {rows} is not finite at step {self.steps}")
        self.seen["episodes"] += int((terminations | truncations).sum())
        self.seen["terminated"] += int(terminations.sum())
        self.seen["reward"] += float(rewards.sum())
        self.steps += 1

    def _save(self) -> None:
        notes = json.dumps({"steps": self.steps, "settings": self._identity(), **self.seen})
        path = self.settings.state_file
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.with_suffix(".tmp").open("wb") as file:
            np.savez(file, notes=np.array(notes), **self.env.state())
        path.with_suffix(".tmp").replace(path)

    def _load(self) -> None:
        path = self.settings.state_file
        if not path.exists():
            raise ValueError(f"there is no run to resume: {path} is missing")
        with np.load(path) as kept:
            notes = json.loads(str(kept["notes"]))
            if notes.pop("settings") != self._identity():
                raise ValueError(f"{path} is of a run with other settings; give the same ones, or no --resume")
            self.env.restore({name: kept[name] for name in kept.files if name != "notes"})
        self.steps = notes.pop("steps")
        self.seen = notes

    def _identity(self) -> list[int]:
        return [self.settings.decisions, self.settings.envs, self.settings.seed]

    def figures(self) -> dict[str, Any]:
        """What came out; of speed and memory the first sample is left out, for it holds the start-up."""
        samples = self.seen["samples"][1:]
        decisions = np.array([s["decisions"] for s in samples], float)
        memory = np.array([s["bytes"] for s in samples], float)
        rate = np.diff([self.seen["samples"][0]["decisions"], *decisions]) / [s["seconds"] for s in samples]
        tenth = max(1, len(samples) // 10)
        return {
            "decisions": self.steps * self.settings.envs,
            "episodes": self.seen["episodes"],
            "terminated": self.seen["terminated"],
            "mean_reward": self.seen["reward"] / (self.steps * self.settings.envs),
            "decisions_per_s": float(len(rate) / np.sum(1.0 / rate)),
            "last_tenth_over_first": float(np.median(rate[-tenth:]) / np.median(rate[:tenth])),
            "resident_mb": {"first": samples[0]["bytes"] / 1e6, "last": samples[-1]["bytes"] / 1e6},
            "bytes_per_million_decisions": float(np.polyfit(decisions / 1e6, memory, 1)[0]),
        }


@cli.on_interrupt("go on with the same command and --resume")
def main(settings: LongHaul) -> int:
    """Fly what the command line asks for; the exit code."""
    with cli.user_errors():
        haul = Haul(settings)
    check_writable(settings.output.parent)
    try:
        haul.run()
    finally:
        haul.env.close()
    figures = haul.figures()
    for name, value in figures.items():
        print(f"{name:32s} {value}")
    results = {**result_head("tests.qa.long_haul"), **figures}
    write_json(settings.output, {**results, "samples": haul.seen["samples"]})
    settings.state_file.unlink()
    print(f"written to {settings.output}")
    return 0


if __name__ == "__main__":
    cli.run(main)
