"""Scene of a frame: the satellite's box and wheels, body and inertial axes, momentum and rate.

Seen from a fixed direction of the inertial frame, without perspective. The momentum keeps its direction while the
body turns, because only a small external torque acts on the satellite.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from satid_gym.reaction_wheels import ReactionWheels
from satid_gym.rendering.appendages import Appendages, extent
from satid_gym.rendering.canvas import ALARM, MUTED, RULE, TEXT, Canvas, Colour, series_colour, shade
from satid_gym.rendering.dome import Dome
from satid_gym.rendering.history import History
from satid_gym.satellite import Satellite

MOMENTUM_COLOUR: Colour = (255, 205, 92)
RATE_COLOUR: Colour = (224, 134, 255)
_GLASS: Colour = (126, 150, 196)
_TOWARDS = np.array([0.52, -0.74, 0.43]) / np.linalg.norm([0.52, -0.74, 0.43])  # from the body to the viewer
_RIGHT = np.cross([0.0, 0.0, 1.0], _TOWARDS) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], _TOWARDS))
_VIEW = np.stack([_RIGHT, np.cross(_TOWARDS, _RIGHT), _TOWARDS])  # inertial to right, up, towards the viewer
_LIGHT = np.array([0.25, -0.45, 0.86])
_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 33)[:-1]
_WHEEL_TURN = 2.5  # rad per decision by which a wheel at its speed limit is drawn to turn; really hundreds
_MOMENTUM_UNIT = 0.2  # of the wheels' capacity: momentum whose arrow has the length of a rate at its limit
_ARROW_MAX = 1.25  # of that length
_REACH, _SMALLEST = 1.2, 0.2  # radii to the tip of a panel, and share of its size to which it may make the box shrink
_ASIDE = 9.0  # of an axis label from the edge of a cone


def box(satellite: Satellite) -> tuple[np.ndarray, np.ndarray]:
    """Edges (3,) of the satellite's box and its axes in the body frame, the columns of (3, 3).

    The edges are the satellite's size, m, if it is given; otherwise those of the uniform box with the same inertia,
    J_x = m (b^2 + c^2) / 12 and so on, up to a factor.
    """
    if satellite.size is not None:
        return satellite.size, np.eye(3)
    moments, axes = np.linalg.eigh(satellite.inertia)
    squares = moments.sum() - 2.0 * moments
    edges = np.sqrt(np.maximum(squares, 0.0025 * squares.max()))  # a flat plate is drawn 1/20 thick
    return edges, axes


def capacity(wheels: ReactionWheels) -> float:
    """Angular momentum of all wheels at their speed limits, N m s, about the body axis with the largest."""
    return float(wheels.momentum_reach.max())


class Scene:
    """View of the last entry of a history.

    Args:
        canvas: the canvas to draw on.
        centre: (2,) place of the satellite's centre on the canvas.
        radius: largest distance of its corners from there.
        history: history of the episode.
    """

    def __init__(self, canvas: Canvas, centre: tuple[float, float], radius: float, history: History) -> None:
        self.canvas, self.history, self.radius = canvas, history, radius
        self.centre = np.array(centre)
        self.edges, axes = box(history.satellite)
        self.scale = 2.0 * radius / float(np.linalg.norm(self.edges))  # canvas units per unit of the edges
        reach = extent(history.satellite.oscillators, self.edges)
        if history.satellite.size is not None and reach > 0.0:
            self.scale *= max(_SMALLEST, min(1.0, _REACH * radius / (reach * self.scale)))
        self.to_view = _VIEW @ Rotation.from_quat(history.attitude[-1]).as_matrix()
        self.box_to_view = self.to_view @ axes
        self.light = _VIEW @ _LIGHT

    def place(self, view: np.ndarray) -> np.ndarray:
        """Coordinates (..., 2) on the canvas of points (..., 3) in the view frame."""
        return self.centre + view[..., :2] * np.array([1.0, -1.0])

    def draw(self, *cones: Dome | None) -> None:
        """Draw everything, from back to front, with the fields of view of star tracker and payload."""
        appendages = Appendages(self)
        self.inertial_axes()
        appendages.panels(front=False)
        self.faces(front=False)
        wheels = self.history.satellite.wheels
        centres = self.wheel_centres(wheels)
        for k in np.argsort((self.to_view @ centres)[2]):
            self.wheel(int(k), centres[:, k], wheels.axes[:, k])
        appendages.masses()
        self.faces(front=True)
        appendages.panels(front=True)
        seen = [cone for cone in cones if cone is not None]
        for cone in seen:
            cone.cone(self)
        self.body_axes(seen)
        self.vectors()

    def deflection(self, x: float, y: float) -> None:
        """Write the largest deflection over its limit from (x, y) on, if there is a limit."""
        share = Appendages(self).share()
        if share is not None:
            said = f"deflection {100.0 * share:.0f} % of its limit"
            self.canvas.text((x, y), said, ALARM if share > 1.0 else MUTED, 10.0)

    def inertial_axes(self) -> None:
        """Draw the triad of the inertial axes next to the satellite."""
        origin = self.centre + np.array([-1.34, 1.05]) * self.radius
        for i, name in enumerate("XYZ"):
            along = _VIEW[:2, i] * np.array([1.0, -1.0])
            self.canvas.arrow(origin, origin + 20.0 * along, MUTED, 1.0)
            self.canvas.text(origin + 27.0 * along, name, MUTED, 9.0, "centre")

    def faces(self, front: bool) -> None:
        """Draw the three faces of the box in front, or the three at the back."""
        half = 0.5 * self.edges * self.scale
        for i in range(3):
            normal = self.box_to_view[:, i]
            sign = 1.0 if (normal[2] > 0.0) == front else -1.0
            j, k = (i + 1) % 3, (i + 2) % 3
            corners = np.zeros((4, 3))
            corners[:, i] = sign * half[i]
            corners[:, j] = half[j] * np.array([-1.0, 1.0, 1.0, -1.0])
            corners[:, k] = half[k] * np.array([-1.0, -1.0, 1.0, 1.0])
            outline = self.place(corners @ self.box_to_view.T)
            brightness = 0.5 + 0.5 * float(sign * normal @ self.light)
            if front:
                self.canvas.polygon(outline, shade((60, 78, 120), (205, 222, 255), brightness), 0.26)
                self.canvas.line(outline, shade(_GLASS, TEXT, 0.35), 1.0, closed=True)
            else:
                self.canvas.polygon(outline, shade((22, 30, 50), (54, 70, 106), brightness))
                self.canvas.line(outline, (74, 91, 128), 0.5, closed=True)

    def wheel_centres(self, wheels: ReactionWheels) -> np.ndarray:
        """Centres (3, n) of the wheels: on their axes, 0.60 of the way to the nearest face of the box."""
        half = 0.5 * self.edges.min() * self.scale
        return 0.60 * half * wheels.axes

    def wheel(self, k: int, centre: np.ndarray, axis: np.ndarray) -> None:
        """Draw a wheel as a thick disc with turning spokes."""
        speed, limit = self.history.wheel_speed[:, k], self.history.satellite.wheels.max_speed[k]
        angle = _WHEEL_TURN * float(speed[1:].sum()) / limit
        aside = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        aside /= np.linalg.norm(aside)
        frame = self.to_view @ np.stack([aside, np.cross(axis, aside), axis], axis=1)
        if frame[2, 2] < 0.0:
            frame[:, 2] *= -1.0  # the near side of the disc
        radius = 0.29 * self.edges.min() * self.scale
        middle, half = self.to_view @ centre, 0.16 * radius * frame[:, 2]
        rim = radius * (np.cos(_CIRCLE)[:, None] * frame[:, 0] + np.sin(_CIRCLE)[:, None] * frame[:, 1])
        far, near = self.place(middle - half + rim), self.place(middle + half + rim)
        colour = series_colour(k)
        dark = shade(colour, (10, 14, 24), 0.6)
        self.canvas.polygon(far, dark)
        for i in range(len(rim)):
            self.canvas.polygon([far[i - 1], far[i], near[i], near[i - 1]], dark)
        self.canvas.polygon(near, shade(colour, (10, 14, 24), 0.25))
        hub = self.place(middle + half)
        self.canvas.polygon(hub + 0.80 * (near - hub), dark)
        spokes = angle + np.arange(3) * 2.0 * np.pi / 3.0
        ends = radius * (np.cos(spokes)[:, None] * frame[:, 0] + np.sin(spokes)[:, None] * frame[:, 1])
        for end in self.place(middle + half + 0.86 * ends):
            self.canvas.line([hub, end], colour, 0.16 * radius)
        self.canvas.polygon(hub + 0.24 * (near - hub), colour)

    def body_axes(self, cones: Sequence[Dome]) -> None:
        """Draw the body axes, from the faces of the box outward, with their names next to the cones."""
        for i, name in enumerate("xyz"):
            axis = self.to_view[:, i]
            reach = self.scale * 0.5 * float(np.abs(self.box_to_view.T @ axis) @ self.edges)
            start, end = self.place(reach * axis), self.place((reach + 0.2 * self.radius) * axis)
            self.canvas.line([start, end], series_colour(i), 1.5)
            label, beyond = self.place((reach + 0.30 * self.radius) * axis), 0.30 * self.radius
            if width := max((cone.width(np.eye(3)[i], beyond) for cone in cones), default=0.0):
                across = np.array([end[1] - start[1], start[0] - end[0]])
                label += (width + _ASIDE) * across / max(float(np.hypot(*across)), 1e-9)
            self.canvas.text(label, name, series_colour(i), 11.0, "centre")

    def vectors(self) -> None:
        """Draw momentum and rate from the centre of mass."""
        satellite = self.history.satellite
        momentum = self.history.momentum[-1] / (_MOMENTUM_UNIT * capacity(satellite.wheels))
        rate = self.history.rate[-1] / satellite.rate_limit
        for vector, name, colour in ((momentum, "M", MOMENTUM_COLOUR), (rate, "ω", RATE_COLOUR)):
            length = float(np.linalg.norm(vector))
            shown = self.to_view @ vector * self.radius * min(1.0, _ARROW_MAX / max(length, 1e-12))
            tip = self.place(shown)
            self.canvas.arrow(self.centre, tip, colour, 2.4)
            if np.hypot(*(tip - self.centre)) > 14.0:
                beyond = (tip - self.centre) / np.hypot(*(tip - self.centre))
                self.canvas.text(tip + 9.0 * beyond, name, colour, 13.0, "centre")
        self.canvas.dot(self.centre, 2.4, TEXT)

    def scale_bar(self, x: float, y: float) -> None:
        """Draw a scale bar of a round length that ends at `x`, if the satellite's size is given."""
        if self.history.satellite.size is None:
            return
        power = 10.0 ** np.floor(np.log10(float(self.edges.max())))
        length = max(m * power for m in (1.0, 2.0, 5.0) if m * power <= self.edges.max())
        width = length * self.scale
        self.canvas.line([(x - width, y), (x, y)], MUTED, 1.0)
        for end in (x - width, x):
            self.canvas.line([(end, y - 3.0), (end, y + 3.0)], MUTED, 1.0)
        self.canvas.text((x - 0.5 * width, y - 9.0), f"{length:g} m", MUTED, 9.0, "centre")


def stars(canvas: Canvas, x: float, y: float, width: float, height: float) -> None:
    """Draw a few dim stars, fixed in the inertial frame."""
    for across, down, size in np.random.default_rng(7).random((36, 3)):
        canvas.dot((x + across * width, y + down * height), 0.5 + 0.5 * size, shade(RULE, MUTED, 0.5 * size))
