"""A video of two policies side by side, in the same episode: `python -m agents.record POLICY`.

Frames are those of render_mode="rgb_array"; below them the relative error of both.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from tqdm import tqdm

from agents import video
from agents.pilot import Pairing, Pilot
from baselines.ending import ended, refusal
from satid_gym.rendering.canvas import ALARM, BACKGROUND, MUTED, RULE, TEXT, Canvas, Colour
from satid_gym.rendering.strip import Strip

COLOURS: tuple[Colour, Colour] = ((255, 205, 92), (150, 166, 200))  # the policy's, and the other's
_GAP = 8.0  # between the frames, in units of which a frame has 480
_LOWEST, _HIGHEST = -5.0, -0.5  # log10 of the relative errors that the chart shows


@dataclass(frozen=True, kw_only=True)
class Recording:
    """What to record, and where to."""

    pairing: Annotated[Pairing, tyro.conf.arg(name="")]
    output: Path | None = None
    """The video, .mp4 or .gif; results/POLICY_beside_OTHER.mp4 where not given."""
    every: int = 2
    """Decisions a frame."""
    fps: int = 12
    """Frames a second."""
    size: int = 480
    """Width and height of each policy's part, pixels."""

    @property
    def path(self) -> Path:
        """Where the video goes."""
        names = "_beside_".join(_called(text) for text in (self.pairing.policy, self.pairing.beside))
        return self.output or Path("results") / f"{names}.mp4"

    def check(self) -> None:
        """Refuse what cannot be recorded.

        Raises:
            ValueError: a number is not positive, or the video's ending is unknown.
            OSError: the video cannot be written there.
        """
        for name in ("every", "fps"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        video.check_path(self.path)


def _called(text: str) -> str:
    """The NAME of NAME=PATH, or the last part of a path or name."""
    name, sign, _ = text.partition("=")
    return name if sign else Path(text).name


def frames(pilots: Sequence[Pilot], every: int) -> Iterator[np.ndarray]:
    """A picture of the start, one of every so many decisions, and one of the end."""
    yield compose(pilots)
    decision = 0
    while not all(pilot.over for pilot in pilots):
        for pilot in pilots:
            pilot.step()
        decision += 1
        if decision % every == 0 or all(pilot.over for pilot in pilots):
            yield compose(pilots)


def compose(pilots: Sequence[Pilot]) -> np.ndarray:
    """Names and errors above, the policies' frames side by side, errors over time below."""
    parts = [pilot.env.render() for pilot in pilots]
    size = parts[0].shape[0]
    scale = size / 480.0
    gap = np.full((size, round(_GAP * scale), 3), BACKGROUND, np.uint8)
    middle = np.concatenate([parts[0], gap, parts[1]], axis=1)
    width = middle.shape[1] / scale
    return np.concatenate([_titles(pilots, width, scale), middle, _errors(pilots, width, scale)])


def _titles(pilots: Sequence[Pilot], width: float, scale: float) -> np.ndarray:
    canvas = Canvas(width, 46.0, scale)
    for i, (pilot, colour) in enumerate(zip(pilots, COLOURS, strict=True)):
        left, right = i * (480.0 + _GAP) + 10.0, i * (480.0 + _GAP) + 470.0
        name = canvas.text((left, 24.0), pilot.name, colour, 22.0)
        canvas.text((left + name + 10.0, 27.0), pilot.policy.kind.replace("_", " "), MUTED, 12.0)
        canvas.text((right, 17.0), f"error {100 * pilot.error:.3f} %", colour, 16.0, "right")
        status = f"outside limits {100 * pilot.outside:.1f} % of the time"
        if pilot.terminated:
            status = "ended: far outside the rate limits"
        canvas.text((right, 36.0), status, ALARM if pilot.terminated else MUTED, 11.0, "right")
    return canvas.pixels()


def _errors(pilots: Sequence[Pilot], width: float, scale: float) -> np.ndarray:
    """Relative errors over the episode so far, on a logarithmic scale."""
    canvas = Canvas(width, 128.0, scale)
    scenario = pilots[0].env.problem.scenario
    canvas.text((10.0, 12.0), "relative error of the inertia", TEXT, 12.0)
    for i, (pilot, colour) in enumerate(zip(pilots, COLOURS, strict=True)):
        words = f"{pilot.name}: mean {100 * pilot.mean_error:.3f} %"
        canvas.text((470.0 + i * (480.0 + _GAP), 12.0), words, colour, 12.0, "right")
    strip = Strip(
        canvas=canvas, x=44.0, y=24.0, width=width - 54.0, height=84.0, horizon=scenario.horizon,
        low=_LOWEST, high=_HIGHEST,
    )  # fmt: skip
    strip.ground()
    for power, words in ((-1.0, "10 %"), (-2.0, "1 %"), (-3.0, "0.1 %"), (-4.0, "0.01 %")):
        strip.level(power, RULE)
        strip.value_label(power, words)
    for pilot, colour in reversed(list(zip(pilots, COLOURS, strict=True))):
        error = np.array(pilot.history["relative_error"])
        strip.curve(scenario.decision_period * np.arange(len(error)), np.log10(error), colour, 1.6)
    strip.time_labels()
    return canvas.pixels()


def record(recording: Recording) -> Path:
    """Fly both policies and write the video; where it is.

    Raises:
        ValueError: a name is unknown or a number is not valid.
        OSError: the video cannot be written.
    """
    recording.check()
    pairing = recording.pairing
    pilots = pairing.pilots("rgb_array", recording.size)
    count = 1 + -(-pilots[0].env.problem.scenario.decisions // recording.every)
    pictures = tqdm(frames(pilots, recording.every), total=count, desc="recording", unit="frame")
    video.write(recording.path, pictures, recording.fps)
    return recording.path


def main() -> int:
    """Record what the command line asks for; the exit code."""
    recording = tyro.cli(Recording, description=__doc__)
    with refusal():
        path = record(recording)
    print(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")
    return 0


if __name__ == "__main__":
    sys.exit(ended(main, "no video was written"))
