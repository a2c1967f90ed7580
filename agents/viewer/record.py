"""Video of two policies side by side in the same episode: `python -m agents.record POLICY`.

The frames are those of render_mode="rgb_array"; the relative errors of both are drawn below them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from tqdm import tqdm

from agents.viewer.rollout import Pairing, Rollout
from baselines.command import cli
from satid_gym.rendering import video
from satid_gym.rendering.canvas import ALARM, BACKGROUND, MUTED, RULE, TEXT, Canvas, Colour
from satid_gym.rendering.strip import Strip

COLOURS: tuple[Colour, Colour] = ((255, 205, 92), (150, 166, 200))  # of the first and of the second policy
_GAP = 8.0  # between the frames, in units of which a frame has 480
_LOG_ERROR_RANGE = (-5.0, -0.5)  # log10 of the relative errors in the chart


@dataclass(frozen=True, kw_only=True)
class VideoSettings:
    """Settings of the video."""

    pairing: Annotated[Pairing, tyro.conf.arg(name="")]
    output: Path | None = None
    """File of the video, .mp4 or .gif; results/POLICY_against_OTHER.mp4 if not given."""
    every: int = 2
    """Decisions per frame."""
    fps: int = 12
    """Frames per second."""
    size: int = 480
    """Width and height of each policy's part, pixels."""

    @property
    def path(self) -> Path:
        """File of the video."""
        names = "_against_".join(_called(text) for text in (self.pairing.policy, self.pairing.against))
        return self.output or Path("results") / f"{names}.mp4"

    def check(self) -> None:
        """Check the settings before any work.

        Raises:
            ValueError: a number is not positive, or the video's ending is unknown.
            OSError: the video cannot be written there.
        """
        for name in ("every", "fps"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        video.check_path(self.path)


def _called(text: str) -> str:
    """NAME of NAME=PATH, or the last part of a path or name."""
    name, sign, _ = text.partition("=")
    return name if sign else Path(text).name


def frames(rollouts: Sequence[Rollout], every: int) -> Iterator[np.ndarray]:
    """Pictures of the start, of every `every`-th decision and of the end."""
    yield compose(rollouts)
    decision = 0
    while not all(rollout.over for rollout in rollouts):
        for rollout in rollouts:
            rollout.step()
        decision += 1
        if decision % every == 0 or all(rollout.over for rollout in rollouts):
            yield compose(rollouts)


def compose(rollouts: Sequence[Rollout]) -> np.ndarray:
    """Picture (height, width, 3), uint8: names and errors, the frames side by side, and errors over time."""
    parts = [rollout.picture() for rollout in rollouts]
    size = parts[0].shape[0]
    scale = size / 480.0
    gap = np.full((size, round(_GAP * scale), 3), BACKGROUND, np.uint8)
    middle = np.concatenate([parts[0], gap, parts[1]], axis=1)
    width = middle.shape[1] / scale
    return np.concatenate([_titles(rollouts, width, scale), middle, _errors(rollouts, width, scale)])


def _titles(rollouts: Sequence[Rollout], width: float, scale: float) -> np.ndarray:
    canvas = Canvas(width, 46.0, scale)
    for i, (rollout, colour) in enumerate(zip(rollouts, COLOURS, strict=True)):
        left, right = i * (480.0 + _GAP) + 10.0, i * (480.0 + _GAP) + 470.0
        name = canvas.text((left, 24.0), rollout.name, colour, 22.0)
        canvas.text((left + name + 10.0, 27.0), rollout.policy.kind.replace("_", " "), MUTED, 12.0)
        canvas.text((right, 17.0), f"error {100 * rollout.error:.3f} %", colour, 16.0, "right")
        status = f"outside rate limit {100 * rollout.outside:.1f} % of the time"
        if rollout.terminated:
            status = rollout.ending
        canvas.text((right, 36.0), status, ALARM if rollout.terminated else MUTED, 11.0, "right")
    return canvas.pixels()


def _errors(rollouts: Sequence[Rollout], width: float, scale: float) -> np.ndarray:
    """Relative errors over the episode so far, on a logarithmic scale."""
    canvas = Canvas(width, 128.0, scale)
    scenario = rollouts[0].env.problem.scenario
    tolerances = scenario.tolerances
    unit = "" if tolerances is None or not tolerances.wheel_inertia else ", in units of the rotors'"
    canvas.text((10.0, 12.0), f"relative error of the inertia{unit}", TEXT, 12.0)
    for i, (rollout, colour) in enumerate(zip(rollouts, COLOURS, strict=True)):
        words = f"{rollout.name}: mean {100 * rollout.mean_error:.3f} %"
        canvas.text((470.0 + i * (480.0 + _GAP), 12.0), words, colour, 12.0, "right")
    strip = Strip(
        canvas=canvas, x=44.0, y=24.0, width=width - 54.0, height=84.0, horizon=scenario.horizon,
        low=_LOG_ERROR_RANGE[0], high=_LOG_ERROR_RANGE[1],
    )  # fmt: skip
    strip.ground()
    for power, words in ((-1.0, "10 %"), (-2.0, "1 %"), (-3.0, "0.1 %"), (-4.0, "0.01 %")):
        strip.level(power, RULE)
        strip.value_label(power, words)
    for rollout, colour in reversed(list(zip(rollouts, COLOURS, strict=True))):
        error = np.array(rollout.history["relative_error"])
        strip.curve(scenario.decision_period * np.arange(len(error)), np.log10(error), colour, 1.6)
    strip.time_labels()
    return canvas.pixels()


def write_video(settings: VideoSettings) -> Path:
    """Fly both policies and write the video; returns its path.

    Raises:
        ValueError: a name is unknown or a number is not valid.
        OSError: the video cannot be written.
    """
    settings.check()
    pairing = settings.pairing
    rollouts = pairing.rollouts("rgb_array", settings.size)
    count = 1 + -(-rollouts[0].env.problem.scenario.decisions // settings.every)
    pictures = tqdm(frames(rollouts, settings.every), total=count, desc="recording", unit="frame")
    video.write(settings.path, pictures, settings.fps)
    return settings.path


@cli.on_interrupt("no video was written")
def main(settings: VideoSettings) -> int:
    """Record the video of the command line; returns the exit code."""
    with cli.user_errors():
        path = write_video(settings)
    print(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")
    return 0
