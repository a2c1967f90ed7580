"""Canvas for smooth shapes and text, in units that are independent of the pixels."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Literal

import gymnasium
import numpy as np

try:
    import pygame
    import pygame.gfxdraw
except ImportError as error:
    raise gymnasium.error.DependencyNotInstalled(
        'pygame is not installed: pip install "satid-gym[render]", or pip install pygame-ce'
    ) from error

Colour = tuple[int, int, int]
Align = Literal["left", "centre", "right"]
Point = np.ndarray | tuple[float, float]
Points = np.ndarray | Sequence[Point]

_OVERSAMPLING = 2  # factor by which shapes are drawn larger, before pixels are averaged

BACKGROUND: Colour = (13, 18, 30)
PANEL: Colour = (20, 27, 43)
RULE: Colour = (52, 63, 88)
MUTED: Colour = (139, 152, 180)
TEXT: Colour = (226, 232, 244)
ALARM: Colour = (255, 92, 92)
SERIES: tuple[Colour, ...] = (  # x, y, z; then wheels beyond the third
    (255, 138, 101),
    (94, 217, 165),
    (108, 170, 255),
    (240, 214, 100),
    (214, 140, 255),
    (120, 224, 236),
)


def shade(colour: Colour, other: Colour, share: float) -> Colour:
    """Mixture of `colour` with a `share` of `other`."""
    return tuple(round((1.0 - share) * a + share * b) for a, b in zip(colour, other, strict=True))  # type: ignore[return-value]


def series_colour(index: int) -> Colour:
    """Colour of an axis or a wheel."""
    return SERIES[index % len(SERIES)]


@functools.cache
def _font(height: int) -> pygame.font.Font:
    pygame.font.init()
    pygame.register_quit(_font.cache_clear)  # fonts do not outlive pygame.quit(), which HumanRendering calls
    return pygame.font.Font(None, height)


class Canvas:
    """Drawing area of a frame; coordinates are in units, x to the right and y down.

    Args:
        width, height: size in units.
        pixels_per_unit: pixels per unit.
    """

    def __init__(self, width: float, height: float, pixels_per_unit: float = 1.0) -> None:
        self._scale = _OVERSAMPLING * pixels_per_unit
        self._size = round(width * pixels_per_unit), round(height * pixels_per_unit)
        self._surface = pygame.Surface((_OVERSAMPLING * self._size[0], _OVERSAMPLING * self._size[1]), depth=32)
        self._surface.fill(BACKGROUND)

    def _points(self, points: Points) -> list[list[float]]:
        # gfxdraw's 16 bit coordinates overflow beyond this
        return np.clip(np.asarray(points, dtype=float) * self._scale, -16000.0, 16000.0).tolist()

    def clip(self, x: float, y: float, width: float, height: float) -> None:
        """Restrict the following shapes to a rectangle."""
        self._surface.set_clip(pygame.Rect(*(round(v * self._scale) for v in (x, y, width, height))))

    def unclip(self) -> None:
        """Remove the restriction of `clip`."""
        self._surface.set_clip(None)

    def rectangle(self, x: float, y: float, width: float, height: float, colour: Colour, radius: float = 0.0) -> None:
        """Draw a filled rectangle with round corners."""
        rectangle = pygame.Rect(*(round(v * self._scale) for v in (x, y, width, height)))
        pygame.draw.rect(self._surface, colour, rectangle, border_radius=round(radius * self._scale))

    def polygon(self, points: Points, colour: Colour, opacity: float = 1.0) -> None:
        """Draw a filled polygon (N, 2)."""
        if opacity < 1.0:
            pygame.gfxdraw.filled_polygon(self._surface, self._points(points), (*colour, round(255 * opacity)))
        else:
            pygame.draw.polygon(self._surface, colour, self._points(points))

    def line(self, points: Points, colour: Colour, width: float = 1.0, closed: bool = False) -> None:
        """Draw a line through points (N, 2), N >= 2."""
        corners = self._points(points)
        thickness = max(1, round(width * self._scale))
        pygame.draw.lines(self._surface, colour, closed, corners, thickness)

    def dot(self, place: Point, radius: float, colour: Colour) -> None:
        """Draw a filled circle."""
        pygame.draw.circle(
            self._surface, colour, (place[0] * self._scale, place[1] * self._scale), radius * self._scale
        )

    def arrow(self, start: np.ndarray, tip: np.ndarray, colour: Colour, width: float = 2.0) -> None:
        """Draw an arrow from `start` to `tip`, (2,) each; a dot if it is too short for a head."""
        along = tip - start
        length = float(np.hypot(*along))
        head = 4.0 * width
        if length < head:
            self.dot(tip, width, colour)
            return
        along = along / length
        across = np.array([-along[1], along[0]])
        neck = tip - head * along
        shaft = 0.5 * width * across
        self.polygon([start - shaft, start + shaft, neck + shaft, neck - shaft], colour)
        self.polygon([tip, neck + 0.42 * head * across, neck - 0.42 * head * across], colour)

    def text(
        self, place: Point, words: str, colour: Colour = TEXT, height: float = 11.0, align: Align = "left"
    ) -> float:
        """Draw text that begins at, is centred on or ends at a point; returns its width in units."""
        picture = _font(round(1.35 * height * self._scale)).render(words, True, colour)
        width, tall = picture.get_size()
        shift = {"left": 0.0, "centre": 0.5, "right": 1.0}[align] * width
        self._surface.blit(picture, (round(place[0] * self._scale - shift), round(place[1] * self._scale - 0.5 * tall)))
        return width / self._scale

    def pixels(self) -> np.ndarray:
        """Picture (height, width, 3), uint8."""
        smooth = pygame.transform.smoothscale(self._surface, self._size)
        return np.ascontiguousarray(pygame.surfarray.array3d(smooth).swapaxes(0, 1))
