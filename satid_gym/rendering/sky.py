"""Sky of a scene with a star tracker: where it looks, whether it tracks, and how near Sun and Earth are."""

from __future__ import annotations

import numpy as np

from satid_gym.rendering.canvas import ALARM, BACKGROUND, MUTED, RULE, TEXT, Canvas, Colour, shade
from satid_gym.rendering.dome import EARTH, SUN, Dome, angle_between
from satid_gym.rendering.history import History
from satid_gym.star_tracker import StarTracker, earth_angle

TRACKS: Colour = (94, 217, 165)
ACQUIRES: Colour = (240, 196, 92)
_SUN_RADIUS = np.radians(6.0)  # as it is drawn; really 0.27 degrees
_CONE = np.radians(9.0)  # half the field of view, as it is drawn


class Sky(Dome):
    """Star tracker at the last entry of a history, which has one."""

    def __init__(self, history: History, tracker: StarTracker) -> None:
        super().__init__(tracker.boresight, _CONE)
        self._history, self._tracker = history, tracker
        self._limb = earth_angle(history.orbit_rate)
        self.sun = history.to_body(history.sun) if tracker.sun_exclusion is not None else None
        self.earth = history.to_body(history.earth) if tracker.earth_exclusion is not None else None

    def state(self) -> tuple[str, Colour]:
        """Whether it tracks, or what blinds it, in words; and their colour."""
        tracker = self._tracker
        if self._history.tracks[-1]:
            return "tracks", TRACKS
        if self.sun is not None and angle_between(self.sun, tracker.boresight) < (tracker.sun_exclusion or 0.0):
            return "blind: Sun", ALARM
        earth = self._limb + (tracker.earth_exclusion or 0.0)
        if self.earth is not None and angle_between(self.earth, tracker.boresight) < earth:
            return "blind: Earth", ALARM
        rate = float(np.linalg.norm(self._history.rate[-1]))
        if tracker.rate_limit is not None and rate > tracker.rate_limit:
            return "blind: too fast", ALARM
        return "finds its stars", ACQUIRES

    def map(self, canvas: Canvas, centre: tuple[float, float], radius: float) -> None:
        """Draw all directions round the boresight, which is in the middle: the further out, the larger the angle to it.

        Sun and Earth have their exclusions about them; where one covers the middle, the tracker is blind.
        """
        middle = np.array(centre)
        rim = self._rim(middle, radius)
        canvas.polygon(rim, shade(BACKGROUND, RULE, 0.25))
        if self.earth is not None:
            self._disc(canvas, middle, radius, self.earth, self._limb + (self._tracker.earth_exclusion or 0.0), 0.72)
            self._disc(canvas, middle, radius, self.earth, self._limb, 0.35)
        if self.sun is not None:
            self._disc(canvas, middle, radius, self.sun, self._tracker.sun_exclusion or 0.0, 0.72, SUN)
            self._disc(canvas, middle, radius, self.sun, _SUN_RADIUS, 0.0, SUN)
        canvas.line(rim, RULE, 0.8, closed=True)
        words, colour = self.state()
        self._cross(canvas, middle, colour)
        canvas.text(middle + np.array([0.0, radius + 9.0]), words, colour, 10.0, "centre")
        if self.sun is not None:
            canvas.text(middle + np.array([-4.0, radius + 21.0]), "Sun", SUN, 9.0, "right")
        if self.earth is not None:
            canvas.text(middle + np.array([4.0, radius + 21.0]), "Earth", shade(EARTH, TEXT, 0.3), 9.0)
        canvas.text(middle + np.array([0.0, -radius - 8.0]), "star tracker", MUTED, 10.0, "centre")
