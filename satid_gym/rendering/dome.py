"""Dome of the sky: a map of all directions round one of the body, and cones about that."""

from __future__ import annotations

import abc
from typing import TYPE_CHECKING

import numpy as np

from satid_gym.rendering.canvas import BACKGROUND, Canvas, Colour, shade

if TYPE_CHECKING:
    from satid_gym.rendering.scene import Scene

SUN: Colour = (255, 214, 110)
EARTH: Colour = (74, 128, 206)
_NEAR = np.radians(15.0)  # of a direction, within which a cone hides what is drawn along it
_AROUND = np.linspace(0.0, 2.0 * np.pi, 73)


class Dome(abc.ABC):
    """Directions round an axis of the body (3,), which is in the middle of the map; half the field of view in rad.

    The map is azimuthal and equidistant: the further out, the larger the angle to the axis.
    """

    def __init__(self, axis: np.ndarray, half: float) -> None:
        self._axis, self._half = axis, half

    @abc.abstractmethod
    def state(self) -> tuple[str, Colour]:
        """Description of its state, and the colour of the text."""

    def cone(self, scene: Scene) -> None:
        """Draw the field of view, outward from the body."""
        axis, colour = self._axis, self.state()[1]
        start = scene.scale * 0.5 * float(np.abs(axis) @ scene.edges) * axis
        length = 0.55 * scene.radius
        aside, across = frame(axis)
        rim = np.cos(_AROUND)[:, None] * aside + np.sin(_AROUND)[:, None] * across
        end = start + length * axis + length * np.tan(self._half) * rim
        apex, ring = scene.place(scene.to_view @ start), scene.place(end @ scene.to_view.T)
        for i in range(1, len(ring)):
            scene.canvas.polygon([apex, ring[i - 1], ring[i]], colour, 0.04)
        scene.canvas.line(ring, shade(colour, BACKGROUND, 0.2), 0.9, closed=True)
        along, out = ring - apex, ring[:-1].mean(axis=0) - apex
        offset = along[:, 0] * out[1] - along[:, 1] * out[0]  # the line from the apex to the ring's middle
        for edge in (np.argmax(offset), np.argmin(offset)):
            scene.canvas.line([apex, ring[edge]], shade(colour, BACKGROUND, 0.2), 0.9)

    def width(self, axis: np.ndarray, distance: float) -> float:
        """Half the cone's width at a distance along a unit vector of the body; 0 where it points elsewhere."""
        return distance * float(np.tan(self._half)) if angle_between(axis, self._axis) < _NEAR else 0.0

    def _rim(self, middle: np.ndarray, radius: float) -> np.ndarray:
        return middle + radius * np.column_stack([np.cos(_AROUND), np.sin(_AROUND)])

    def _cross(self, canvas: Canvas, middle: np.ndarray, colour: Colour) -> None:
        """Mark the axis."""
        for along in (np.array([1.0, 0.0]), np.array([0.0, 1.0])):
            canvas.line([middle - 5.0 * along, middle + 5.0 * along], BACKGROUND, 2.6)
            canvas.line([middle - 4.0 * along, middle + 4.0 * along], colour, 1.2)

    def _place(self, middle: np.ndarray, radius: float, directions: np.ndarray) -> np.ndarray:
        """Places (N, 2) on the map of directions (N, 3) of the body: azimuthal, equidistant."""
        axis = self._axis
        aside, across = frame(axis)
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
        colour: Colour = EARTH,
    ) -> None:
        """Fill what is within an angle of a direction."""
        aside, across = frame(towards)
        ring = np.cos(_AROUND)[:, None] * aside + np.sin(_AROUND)[:, None] * across
        edge = self._place(middle, radius, np.cos(size) * towards + np.sin(size) * ring)
        fill = shade(colour, BACKGROUND, dark)
        if np.pi - angle_between(towards, self._axis) >= size:
            canvas.polygon(edge, fill)
            return
        out = edge - middle  # it holds the direction opposite to the boresight, which is all of the map's rim
        rim = middle + radius * out / np.linalg.norm(out, axis=1, keepdims=True)
        for i in range(1, len(edge)):
            canvas.polygon([edge[i - 1], edge[i], rim[i], rim[i - 1]], fill)


def angle_between(one: np.ndarray, other: np.ndarray) -> float:
    """Angle between two unit vectors, rad."""
    return float(np.arccos(np.clip(one @ other, -1.0, 1.0)))


def frame(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors across an axis, and across each other."""
    aside = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    aside /= np.linalg.norm(aside)
    return aside, np.cross(axis, aside)
