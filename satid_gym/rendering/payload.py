"""Payload of a scene: where it looks, its next target, whether a window is open and kept, and the Sun's keep-out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from satid_gym.operations import Operations
from satid_gym.rendering.canvas import ALARM, BACKGROUND, MUTED, RULE, TEXT, Canvas, Colour, shade
from satid_gym.rendering.dome import SUN, Dome, angle_between
from satid_gym.rendering.history import History
from satid_gym.rendering.sky import TRACKS

if TYPE_CHECKING:
    from satid_gym.rendering.strip import Strip

WAITS: Colour = (154, 178, 232)
_CONE = np.radians(4.0)  # half the field of view, as it is drawn
_SUN_RADIUS = np.radians(6.0)  # as it is drawn


class Payload(Dome):
    """Payload at the last entry of a history, whose scenario has operations."""

    def __init__(self, history: History, operations: Operations) -> None:
        super().__init__(operations.boresight, _CONE)
        self._history, self._operations = history, operations
        self.sun, self.target = history.to_body(history.sun), history.to_body(history.target)

    def state(self) -> tuple[str, Colour]:
        """Description of its state, and the colour of the text."""
        opens, closes = self._history.windows[-1]
        now = self._history.time[-1]
        if angle_between(self.sun, self._axis) < self._operations.keep_out:
            return "too near the Sun", ALARM
        if now < opens:
            return f"window in {opens - now:.0f} s", WAITS
        off = angle_between(self.target, self._axis) > self._operations.pointing
        if off or np.linalg.norm(self._history.rate[-1]) > self._operations.steadiness:
            return "off its target" if off else "not steady", ALARM
        return f"images, {closes - now:.0f} s left", TRACKS

    def map(self, canvas: Canvas, centre: tuple[float, float], radius: float) -> None:
        """Draw all directions round the boresight with the target, a ring, and the keep-out about the Sun."""
        middle = np.array(centre)
        rim = self._rim(middle, radius)
        canvas.polygon(rim, shade(BACKGROUND, RULE, 0.25))
        if self._operations.keep_out > 0.0:
            self._disc(canvas, middle, radius, self.sun, self._operations.keep_out, 0.72, SUN)
        self._disc(canvas, middle, radius, self.sun, _SUN_RADIUS, 0.0, SUN)
        canvas.line(rim, RULE, 0.8, closed=True)
        words, colour = self.state()
        (place,) = self._place(middle, radius, self.target[None])
        canvas.line([middle, place], shade(TEXT, BACKGROUND, 0.5), 0.7)
        canvas.dot(place, 4.0, TEXT)
        canvas.dot(place, 2.6, BACKGROUND)
        self._cross(canvas, middle, colour)
        canvas.text(middle + np.array([0.0, radius + 9.0]), words, colour, 10.0, "centre")
        canvas.text(middle + np.array([0.0, radius + 21.0]), "Sun", SUN, 9.0, "centre")
        canvas.text(middle + np.array([0.0, -radius - 8.0]), "payload", MUTED, 10.0, "centre")

    def windows(self, strip: Strip) -> None:
        """Draw the windows so far as bands over a strip, red where one was missed."""
        history = self._history
        time, missed = history.time, history.missed
        for opens, closes in dict.fromkeys(map(tuple, history.windows.tolist())):
            span = np.clip([opens, closes], 0.0, time[-1])
            strip.band(span, np.full(2, strip.low), np.full(2, strip.high), TRACKS, 0.14)
        for i in np.flatnonzero(missed > 0.0):
            strip.band(time[[i - 1, i]], np.full(2, strip.low), np.full(2, strip.high), ALARM, 0.4)
