"""Strip chart: curves over the time of an episode."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from satid_gym.rendering.canvas import MUTED, PANEL, RULE, Canvas, Colour


@dataclass(frozen=True, kw_only=True)
class Strip:
    """Chart with its place on a canvas and the values at its edges.

    Attributes:
        canvas: the canvas to draw on.
        x, y, width, height: its place, in units of the canvas.
        horizon: time at the right edge, s; the left edge is 0 s.
        low, high: values at the lower and upper edge.
    """

    canvas: Canvas
    x: float
    y: float
    width: float
    height: float
    horizon: float
    low: float
    high: float

    def ground(self) -> None:
        """Draw the background."""
        self.canvas.rectangle(self.x, self.y, self.width, self.height, PANEL, 3.0)

    def _across(self, time: np.ndarray) -> np.ndarray:
        return self.x + self.width * time / self.horizon

    def _up(self, value: np.ndarray) -> np.ndarray:
        # values far outside are moved just outside, so that they are clipped and coordinates do not overflow
        share = np.clip((value - self.low) / (self.high - self.low), -2.0, 3.0)
        return self.y + self.height * (1.0 - share)

    def _clipped(self) -> None:
        self.canvas.clip(self.x, self.y, self.width, self.height)

    def curve(self, time: np.ndarray, value: np.ndarray, colour: Colour, width: float = 1.2) -> None:
        """Draw a curve (N,) with a dot at its end."""
        across, up = self._across(time), self._up(value)
        self._clipped()
        if len(time) > 1:
            self.canvas.line(np.stack([across, up], axis=1), colour, width)
        self.canvas.dot((across[-1], up[-1]), 1.2 * width, colour)
        self.canvas.unclip()

    def band(self, time: np.ndarray, low: np.ndarray, high: np.ndarray, colour: Colour, opacity: float = 0.3) -> None:
        """Fill the area between two curves (N,)."""
        if len(time) < 2:
            return
        across = self._across(time)
        lower, upper = np.stack([across, self._up(low)], axis=1), np.stack([across, self._up(high)], axis=1)
        self._clipped()
        self.canvas.polygon(np.concatenate([lower, upper[::-1]]), colour, opacity)
        self.canvas.unclip()

    def level(self, value: float, colour: Colour = RULE, dashes: int = 0) -> None:
        """Draw a horizontal line, with `dashes` dashes or solid if 0."""
        (up,) = self._up(np.array([value]))
        if not dashes:
            self.canvas.line([(self.x, up), (self.x + self.width, up)], colour, 0.5)
            return
        step = self.width / dashes
        for i in range(dashes):
            start = self.x + (i + 0.2) * step
            self.canvas.line([(start, up), (start + 0.6 * step, up)], colour, 0.75)

    def value_label(self, value: float, words: str) -> None:
        """Draw text at a value's height, left of the chart."""
        (up,) = self._up(np.array([value]))
        self.canvas.text((self.x - 4.0, up), words, MUTED, 9.0, "right")

    def edge_labels(self, form: str) -> None:
        """Draw the values at the upper and lower edge, left of the chart."""
        for value, y in ((self.high, self.y + 5.0), (self.low, self.y + self.height - 5.0)):
            self.canvas.text((self.x - 4.0, y), format(value, form), MUTED, 9.0, "right")

    def time_labels(self) -> None:
        """Draw round times below the chart."""
        step = next(s for s in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10**9) if self.horizon <= 4 * s)
        for time in np.arange(0.0, self.horizon + 1e-9, step):
            (across,) = self._across(np.array([time]))
            self.canvas.text((across, self.y + self.height + 8.0), f"{time:g}", MUTED, 9.0, "centre")
