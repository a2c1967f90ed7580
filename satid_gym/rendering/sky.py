"""Sky of a scene with a star tracker: where it looks, whether it tracks, and how near Sun and Earth are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from satid_gym.rendering.canvas import ALARM, BACKGROUND, MUTED, RULE, TEXT, Canvas, Colour, shade
from satid_gym.rendering.history import History
from satid_gym.star_tracker import StarTracker, earth_angle

if TYPE_CHECKING:
    from satid_gym.rendering.scene import Scene

TRACKS: Colour = (94, 217, 165)
ACQUIRES: Colour = (240, 196, 92)
_SUN: Colour = (255, 214, 110)
_EARTH: Colour = (74, 128, 206)
_SUN_RADIUS = np.radians(6.0)  # as it is drawn; really 0.27 degrees
_AROUND = np.linspace(0.0, 2.0 * np.pi, 73)
_CONE = np.radians(9.0)  # half the field of view, as it is drawn


class Sky:
    """Star tracker at the last entry of a history, which has one."""

    def __init__(self, history: History, tracker: StarTracker) -> None:
        self._history, self._tracker = history, tracker
        self._limb = earth_angle(history.orbit_rate)
        self.sun = history.to_body(history.sun) if tracker.sun_exclusion is not None else None
        self.earth = history.to_body(history.earth) if tracker.earth_exclusion is not None else None

    def state(self) -> tuple[str, Colour]:
        """Whether it tracks, or what blinds it, in words; and their colour."""
        tracker = self._tracker
        if self._history.tracks[-1]:
            return "tracks", TRACKS
        if self.sun is not None and _angle(self.sun, tracker.boresight) < (tracker.sun_exclusion or 0.0):
            return "blind: Sun", ALARM
        earth = self._limb + (tracker.earth_exclusion or 0.0)
        if self.earth is not None and _angle(self.earth, tracker.boresight) < earth:
            return "blind: Earth", ALARM
        rate = float(np.linalg.norm(self._history.rate[-1]))
        if tracker.rate_limit is not None and rate > tracker.rate_limit:
            return "blind: too fast", ALARM
        return "finds its stars", ACQUIRES

    def cone(self, scene: Scene) -> None:
        """Draw the field of view, outward from the body."""
        axis = self._tracker.boresight
        start = scene.scale * 0.5 * float(np.abs(axis) @ scene.edges) * axis
        length, colour = 0.55 * scene.radius, self.state()[1]
        aside, across = _frame(axis)
        rim = np.cos(_AROUND)[:, None] * aside + np.sin(_AROUND)[:, None] * across
        end = start + length * axis + length * np.tan(_CONE) * rim
        apex, ring = scene.place(scene.to_view @ start), scene.place(end @ scene.to_view.T)
        for i in range(1, len(ring)):
            scene.canvas.polygon([apex, ring[i - 1], ring[i]], colour, 0.04)
        scene.canvas.line(ring, shade(colour, BACKGROUND, 0.2), 0.9, closed=True)
        along, out = ring - apex, ring[:-1].mean(axis=0) - apex
        beside = along[:, 0] * out[1] - along[:, 1] * out[0]  # the line from the apex to the ring's middle
        for edge in (np.argmax(beside), np.argmin(beside)):
            scene.canvas.line([apex, ring[edge]], shade(colour, BACKGROUND, 0.2), 0.9)

    def map(self, canvas: Canvas, centre: tuple[float, float], radius: float) -> None:
        """Draw all directions round the boresight, which is in the middle: the further out, the larger the angle to it.

        Sun and Earth have their exclusions about them; where one covers the middle, the tracker is blind.
        """
        middle = np.array(centre)
        rim = middle + radius * np.column_stack([np.cos(_AROUND), np.sin(_AROUND)])
        canvas.polygon(rim, shade(BACKGROUND, RULE, 0.25))
        if self.earth is not None:
            self._disc(canvas, middle, radius, self.earth, self._limb + (self._tracker.earth_exclusion or 0.0), 0.72)
            self._disc(canvas, middle, radius, self.earth, self._limb, 0.35)
        if self.sun is not None:
            self._disc(canvas, middle, radius, self.sun, self._tracker.sun_exclusion or 0.0, 0.72, _SUN)
            self._disc(canvas, middle, radius, self.sun, _SUN_RADIUS, 0.0, _SUN)
        canvas.line(rim, RULE, 0.8, closed=True)
        words, colour = self.state()
        for along in (np.array([1.0, 0.0]), np.array([0.0, 1.0])):
            canvas.line([middle - 5.0 * along, middle + 5.0 * along], BACKGROUND, 2.6)
            canvas.line([middle - 4.0 * along, middle + 4.0 * along], colour, 1.2)
        canvas.text(middle + np.array([0.0, radius + 9.0]), words, colour, 10.0, "centre")
        if self.sun is not None:
            canvas.text(middle + np.array([-4.0, radius + 21.0]), "Sun", _SUN, 9.0, "right")
        if self.earth is not None:
            canvas.text(middle + np.array([4.0, radius + 21.0]), "Earth", shade(_EARTH, TEXT, 0.3), 9.0)
        canvas.text(middle + np.array([0.0, -radius - 8.0]), "star tracker", MUTED, 10.0, "centre")

    def _place(self, middle: np.ndarray, radius: float, directions: np.ndarray) -> np.ndarray:
        """Places (N, 2) on the map of directions (N, 3) of the body: azimuthal, equidistant."""
        axis = self._tracker.boresight
        aside, across = _frame(axis)
        angle = np.arccos(np.clip(directions @ axis, -1.0, 1.0)) / np.pi
        azimuth = np.arctan2(directions @ across, directions @ aside)
        return middle + radius * angle[:, None] * np.column_stack([np.cos(azimuth), -np.sin(azimuth)])

    def _disc(
        self,
        canvas: Canvas,
        middle: np.ndarray,
        radius: float,
        towards: np.ndarray,
        size: float,
        dark: float,
        colour: Colour = _EARTH,
    ) -> None:
        """Fill what is within an angle of a direction."""
        aside, across = _frame(towards)
        ring = np.cos(_AROUND)[:, None] * aside + np.sin(_AROUND)[:, None] * across
        edge = self._place(middle, radius, np.cos(size) * towards + np.sin(size) * ring)
        fill = shade(colour, BACKGROUND, dark)
        if np.pi - _angle(towards, self._tracker.boresight) >= size:
            canvas.polygon(edge, fill)
            return
        out = edge - middle  # it holds the direction opposite to the boresight, which is all of the map's rim
        rim = middle + radius * out / np.linalg.norm(out, axis=1, keepdims=True)
        for i in range(1, len(edge)):
            canvas.polygon([edge[i - 1], edge[i], rim[i], rim[i - 1]], fill)


def _angle(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.arccos(np.clip(one @ other, -1.0, 1.0)))


def _frame(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors across an axis, and across each other."""
    aside = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    aside /= np.linalg.norm(aside)
    return aside, np.cross(axis, aside)
