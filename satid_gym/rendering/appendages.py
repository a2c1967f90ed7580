"""Panels and slosh masses of a scene, with deflections drawn larger than they are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from satid_gym.oscillators import Oscillator, Panel, SloshMass
from satid_gym.rendering.canvas import ALARM, MUTED, TEXT, Colour, shade

if TYPE_CHECKING:
    from satid_gym.rendering.scene import Scene

_CELLS: Colour = (52, 88, 168)
_PROPELLANT: Colour = (86, 196, 178)
_DRAWN_AT_LIMIT = np.radians(20.0)  # angle at which a panel at its limit of deflection is drawn
_DRAWN_TRAVEL = 0.25  # of the least edge, by which a mass at its limit is drawn
_FARTHEST = 1.5  # limits, at which a larger deflection is drawn
_FACTOR = 20.0  # on deflections without a limit
_HALF_WIDTH = 0.4  # of a panel, of the body's edge along it
_TANK, _BALL = 0.24, 0.13  # radii of the least edge


def extent(oscillators: tuple[Oscillator, ...], edges: np.ndarray) -> float:
    """Distance of the furthest corner of a panel from the body's origin, m; `edges` (3,) are those of the body, m."""
    tips = [
        o.hinge + 2.0 * o.arm + side * half_width(o, edges)
        for o in oscillators
        if isinstance(o, Panel)
        for side in (-1.0, 1.0)
    ]
    return max((float(np.linalg.norm(tip)) for tip in tips), default=0.0)


def half_width(panel: Panel, edges: np.ndarray) -> np.ndarray:
    """From the middle of a panel's edge to its corner as drawn (3,), m."""
    return _HALF_WIDTH * float(np.abs(panel.axis) @ edges) * panel.axis


class Appendages:
    """Panels and slosh masses at the last entry of a scene's history; none where the satellite has no size, m."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        satellite, deflection = scene.history.satellite, scene.history.deflection
        self._each: list[tuple[Oscillator, float, float]] = []  # with its side, 1 or -1 of a mirror, and deflection
        sides = [(o, side) for o in satellite.oscillators for side in ((1.0, -1.0) if o.mirrored else (1.0,))]
        if satellite.size is not None:
            self._each = [(o, side, float(q)) for (o, side), q in zip(sides, deflection[-1], strict=True)]

    def share(self) -> float | None:
        """Largest deflection over its limit; None where there is no limit."""
        shares = [abs(q) / o.deflection_limit for o, _, q in self._each if o.deflection_limit is not None]
        return max(shares, default=None)

    def panels(self, front: bool) -> None:
        """Draw the panels in front of the body's centre, or those behind it."""
        for o, side, q in self._each:
            if not isinstance(o, Panel):
                continue
            turned = Rotation.from_rotvec(_drawn(o, q, _DRAWN_AT_LIMIT) * o.axis).as_matrix()
            tip = side * (o.hinge + 2.0 * turned @ o.arm)
            across = half_width(o, self._scene.edges)
            if ((self._scene.to_view @ (side * o.hinge + tip))[2] > 0.0) != front:
                continue
            root = side * o.hinge
            corners = np.array([root - across, root + across, tip + across, tip - across])
            outline = self._view(corners)
            normal = self._scene.to_view @ np.cross(o.axis, turned @ o.arm) / float(np.linalg.norm(o.arm))
            bright = 0.35 + 0.3 * abs(float(normal @ self._scene.light))
            self._scene.canvas.polygon(outline, shade((16, 24, 48), _CELLS, bright), 0.92)
            for part in (0.25, 0.5, 0.75):
                a, b = outline[0] + part * (outline[3] - outline[0]), outline[1] + part * (outline[2] - outline[1])
                self._scene.canvas.line([a, b], shade(_CELLS, MUTED, 0.3), 0.6)
            beyond = o.deflection_limit is not None and abs(q) > o.deflection_limit
            self._scene.canvas.line(outline, ALARM if beyond else shade(_CELLS, TEXT, 0.45), 1.0, closed=True)

    def masses(self) -> None:
        """Draw each slosh mass in its tank."""
        least = float(self._scene.edges.min())
        for o, side, q in self._each:
            if not isinstance(o, SloshMass):
                continue
            place = side * (o.position + _drawn(o, q, _DRAWN_TRAVEL * least) * o.direction)
            around = np.linspace(0.0, 2.0 * np.pi, 33)[:-1]
            ring = np.stack([np.cos(around), np.sin(around)], axis=1) * self._scene.scale * least
            tank, ball = self._view(side * o.position[None])[0], self._view(place[None])[0]
            self._scene.canvas.line(tank + _TANK * ring, shade(_PROPELLANT, MUTED, 0.5), 0.8, closed=True)
            beyond = o.deflection_limit is not None and abs(q) > o.deflection_limit
            self._scene.canvas.polygon(ball + _BALL * ring, ALARM if beyond else _PROPELLANT, 0.85)

    def _view(self, points: np.ndarray) -> np.ndarray:
        """Places on the canvas of points (..., 3) of the body, m."""
        return self._scene.place(self._scene.scale * points @ self._scene.to_view.T)


def _drawn(o: Oscillator, q: float, at_limit: float) -> float:
    """Deflection as it is drawn, rad or m, so large that one at the limit is `at_limit`."""
    if o.deflection_limit is None:
        return _FACTOR * q
    return at_limit * min(max(q / o.deflection_limit, -_FARTHEST), _FARTHEST)
