"""Excitation from corner to corner of the rate envelope, by reversals that panels and tanks allow.

At a corner all three body rates are at their limit, where they tell most of the inertia. Which axes reverse together
decides how far a mode bends: the parts of their changes along its d add up or cancel. And a tank moves so slowly that
it does not follow a rate which soon turns back. So those corners are open from which, a decision later, some corner
can be kept for good with every mode inside its limit (`satid_gym.control.observed_modes`): there is then a way to go
on. Of these the one with the highest score is taken; where none is open, the one that bends the modes least.

Where wheels are to avoid a band of speed, each corner has two sizes (`satid_gym.control.corners.wheel_band`).

Panels ring several times while a corner is approached. A shaped tour therefore goes there only as far in each decision
as they allow (`satid_gym.control.mode_shaping`); all corners are then open, each made as small as its pull needs. Where
there are imaging windows, it is flown in the gaps between them (`satid_gym.control.gaps`).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from satid_gym.config import check_number
from satid_gym.control.corners.choice import Choice
from satid_gym.control.corners.features import FEATURES, check_seen, takes_band, takes_stars
from satid_gym.control.corners.star_fixes import StarFixes
from satid_gym.control.corners.turn_gain import HOLD
from satid_gym.control.corners.wheel_band import BandWays, WheelBand
from satid_gym.control.craft import Craft
from satid_gym.control.gaps import SETTLE, Gaps
from satid_gym.control.mode_shaping import bearable, shaped
from satid_gym.control.observed_modes import Modes, ObservedModes
from satid_gym.control.rate_loop import RateMargin
from satid_gym.policy import Mission

CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
_FIRST_WAITS = np.array([1.0, 2.0 / 3.0, 1.0 / 3.0])  # of the hold, so that the axes do not begin together
SHARE, CAUTION = 0.9, 1.0  # defaults, see `ObservedModes`
_SLOW = 0.5  # of the rate limit, below which an axis turns to no side
CLOSED = 1e6  # what a closed corner loses by its peak
_SEEN = ("rate", "wheel_momentum", "inertia", "uncertainty", "control_authority", "time_left", "nis")
_MORE = ("state_uncertainty", "state_correlation", "inertia_walk", "window", "target")  # where they are observed
Score = Callable[[np.ndarray], np.ndarray]
"""Scores (N, 8) of corners by their features (N, 8, features)."""


class Memory(NamedTuple):
    """What a tour remembers of N episodes: side and wait (N, 3) of each axis, modes, star fixes and gaps."""

    side: np.ndarray
    waited: np.ndarray
    modes: np.ndarray
    fixes: tuple[np.ndarray, ...]
    gaps: tuple[np.ndarray, ...]

    def take(self, rows: np.ndarray) -> Memory:
        """Memory of the episodes of these numbers; before the first decision nothing is known of the modes."""
        fixes, gaps = (tuple(part[rows] for part in parts) for parts in (self.fixes, self.gaps))
        modes = self.modes[rows] if len(self.modes) else self.modes
        return Memory(self.side[rows], self.waited[rows], modes, fixes, gaps)


class Ways(NamedTuple):
    """Ways to the corners from where N episodes are; 16, each corner across and within a band of wheel speed, or 8.

    Attributes:
        corners: (N, ways, 3) rates over the limit.
        rates: (N, ways, 3) of the next decision.
        peak: (N, ways) of the modes, over their limit; above 1 a way is closed.
        most: (N, 3) change of the rate in a decision that the modes allow, or infinite.
        band: what they do to wheels that avoid a band of speed, where a feature takes that.
    """

    corners: np.ndarray
    rates: np.ndarray
    peak: np.ndarray
    most: np.ndarray
    band: BandWays | None = None


class CornerTour:
    """Chooses corners and turns them into actions that spare the modes; for environments whose rate loop is their own.

    Args:
        missions: the satellites that are flown; all with the same layout and decision period.
        margin: see `RateMargin`.
        hold: time after which an axis may well reverse again, s.
        share, caution: see `ObservedModes`.
        features: that a score takes, by name.
        settle: s before an imaging window opens at which the target is to be held, where there are any.
        is_shaped: whether each decision goes towards a corner as far as the modes allow.

    Attributes:
        side: (N, 3) of each axis, -1 or 1.

    Raises:
        ValueError: a number is out of range, the environment takes torques, or modes, or the walk, stars, imaging
            windows or band of wheel speed that features take, are not observed.
    """

    def __init__(
        self,
        missions: Sequence[Mission],
        margin: float,
        hold: float = HOLD,
        share: float = SHARE,
        caution: float = CAUTION,
        features: Sequence[str] = (),
        settle: float = SETTLE,
        is_shaped: bool = False,
    ) -> None:
        self._share, self._is_shaped = share, is_shaped
        self._hold = check_number("hold", hold, strict=True)
        self._modes, self._allowed = ObservedModes(missions, share, caution), RateMargin(missions, margin)
        self._gaps = None if missions[0].scenario.operations is None else Gaps(missions, margin, settle, "a tour")
        self._features = [FEATURES[name] for name in features]
        self._layout, self._world = missions[0].layout, missions[0].scenario
        self._fixes = StarFixes(missions) if takes_stars(features) else None
        self._band = WheelBand(missions) if takes_band(features) else None
        check_seen(features, missions[0])
        self._seen = [name for name in (*_SEEN, *_MORE) if name in self._layout]
        self._all_crafts = Craft.of(missions)
        self._craft = self._all_crafts.take(np.zeros(1, int))
        self.begin(0)

    def assign(self, rows: np.ndarray) -> None:
        """Say which mission (N,) each episode of the batch flies; without it all fly the first."""
        self._allowed.assign(rows)
        self._modes.assign(rows)
        if self._gaps is not None:
            self._gaps.assign(rows)
        if self._band is not None:
            self._band.assign(rows)
        self._craft = self._all_crafts.take(rows)

    def begin(self, episodes: int) -> None:
        """Begin that many episodes."""
        self.side = np.ones((episodes, 3))
        self._waited = np.tile(self._hold * _FIRST_WAITS, (episodes, 1))
        if self._fixes is not None:
            self._fixes.begin(episodes)
        if self._gaps is not None:
            self._gaps.begin(episodes)

    @property
    def memory(self) -> Memory:
        """What is remembered of the episodes."""
        fixes = () if self._fixes is None else self._fixes.memory
        gaps = () if self._gaps is None else self._gaps.memory
        return Memory(self.side, self._waited, self._modes.state(), fixes, gaps)

    @memory.setter
    def memory(self, memory: Memory) -> None:
        self.side, self._waited = memory.side, memory.waited
        self._modes.restore(memory.modes)
        if self._fixes is not None:
            self._fixes.memory = memory.fixes
        if self._gaps is not None:
            self._gaps.memory = memory.gaps

    def note(self, memory: Memory, action: np.ndarray) -> None:
        """Remember that rates (N, 3) were flown other than those chosen; `memory` is of before the choice.

        Axes slower than half of their limit keep their side.
        """
        self.side, self._waited = memory.side, memory.waited
        self._turn(np.where(np.abs(action) > _SLOW, np.sign(action), self.side))

    def __call__(
        self, observation: np.ndarray, score: Score | None = None, leaves: np.ndarray | bool = False
    ) -> np.ndarray:
        """Action (N, 3) for observations (N, size); without a score, by how long the axes that reverse have waited.

        Where there are imaging windows, an episode that `leaves` (N,) begins to slew to the next one now.
        """
        modes = self._modes.read(observation)
        if self._band is not None:
            ways = self._band_ways(observation)
        else:
            ways = (self._shaped_ways if self._is_shaped else self._open_ways)(observation, modes)
        sides = np.tile(CORNERS, (ways.corners.shape[1] // len(CORNERS), 1))
        reverses = self.side[:, None] != sides
        scores = self._waits(reverses)
        if self._fixes is not None:
            self._fixes.update(observation)
        if score is not None:
            seen = {name: observation[:, self._layout[name]].astype(float) for name in self._seen}
            seen["control_authority"] = np.minimum(seen["control_authority"], ways.most)
            choice = Choice(
                seen=seen,
                craft=self._craft,
                corners=ways.corners,
                reverses=reverses,
                waited=self._waited,
                wait_score=scores,
                fixes=self._fixes,
                modes=modes,
                foreseen=self._modes,
                peak=ways.peak,
                period=self._world.decision_period,
                decisions=self._world.decisions,
                band=ways.band,
            )
            scores = score(np.stack([feature(choice) for feature in self._features], axis=2))
        best = np.argmax(np.where(ways.peak <= 1.0, scores, -CLOSED * ways.peak), axis=1)
        self._turn(sides[best])
        action = ways.rates[np.arange(len(best)), best]
        return action if self._gaps is None else self._gaps(observation, action, leaves)

    def _corners(self, observation: np.ndarray) -> np.ndarray:
        """Corners (N, 8, 3) that noise leaves inside the rate limit."""
        corners = CORNERS * self._allowed(observation, np.ones(3))[:, None]
        return np.broadcast_to(corners, (len(observation), *CORNERS.shape))

    def _open_ways(self, observation: np.ndarray, modes: Modes) -> Ways:
        """Ways straight to the corners."""
        corners = self._corners(observation)
        return Ways(corners, corners, self._modes.peaks_of_turns(modes, corners), np.full(corners[:, 0].shape, np.inf))

    def _band_ways(self, observation: np.ndarray) -> Ways:
        """Ways that keep wheels out of their band, and ways across it; all are open."""
        assert self._band is not None
        found = self._band(observation, self._corners(observation))
        open_ = np.zeros(found.corners.shape[:2])
        return Ways(found.corners, found.corners, open_, np.full(found.corners[:, 0].shape, np.inf), found)

    def _shaped_ways(self, observation: np.ndarray, modes: Modes) -> Ways:
        """Ways to the corners that spare the modes; all are open."""
        edges, whole = self._corners(observation), modes._replace(limit=modes.limit / self._share)
        corners = bearable(whole, edges, self._share)
        held = observation[:, self._layout["command"]].astype(float)
        rates, most = shaped(whole, held, corners, np.abs(edges[:, 0]), self._share)
        return Ways(corners, rates, np.zeros(corners.shape[:2]), most)

    def _turn(self, side: np.ndarray) -> None:
        """Note that the axes turn to these sides (N, 3) now."""
        self._waited = np.where(side != self.side, 0.0, self._waited) + self._world.decision_period
        self.side = side

    def _waits(self, reverses: np.ndarray) -> np.ndarray:
        """Waits (N, 8) over the hold of the axes (N, 8, 3) that reverse, -1 each that has not waited so long."""
        own = np.where(self._waited >= self._hold, self._waited / self._hold, -1.0)
        return (reverses * own[:, None]).sum(axis=2)
