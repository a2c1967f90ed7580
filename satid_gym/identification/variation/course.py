"""Course of the inertia over knots in time: constant between steps, or a straight or curved drift.

With x (6 K,) the inertias at K knots, in units of their nominal sizes,

    x = E u + q W v,   v ~ N(0, c 1)

E u are a level for each segment and, of a drift, a slope; W integrates white noise twice, which makes the most likely
drift a cubic smoothing spline; q is its size, s^-1.5. Between knots the inertia runs on straight lines.
Source: Wahba, JRSS B 40(3), 1978.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True, eq=False, kw_only=True)
class Course:
    """A course.

    Attributes:
        flight: (K,) number of the log of each knot.
        time: (K,) s of its clock.
        starts: knots that begin another segment, by a step.
        drifts: whether the inertia drifts; each flight then has segments of its own.
        walk: q, s^-1.5.
    """

    flight: np.ndarray
    time: np.ndarray
    starts: tuple[int, ...] = ()
    drifts: bool = False
    walk: float = 0.0

    @cached_property
    def segment(self) -> np.ndarray:
        """(K,) number of the segment of each knot."""
        begins = np.zeros(len(self.time), bool)
        begins[list(self.starts)] = True
        if self.drifts:
            begins[1:] |= np.diff(self.flight) > 0
        return np.cumsum(begins)

    @property
    def free(self) -> int:
        """Columns of E."""
        return int(self.levels.shape[1])

    @cached_property
    def levels(self) -> np.ndarray:
        """E (6 K, 6 S), or (6 K, 12 S) of a drift."""
        of = (self.segment[:, None] == np.unique(self.segment)).astype(float)
        if not self.drifts:
            return np.kron(of, np.eye(6))
        middle = (of.T @ self.time) / of.sum(axis=0)
        since = (self.time - middle[self.segment]) / np.median(np.diff(self.time))
        slopes = (of * since[:, None])[:, of.sum(axis=0) > 1]
        return np.kron(np.hstack([of, slopes]), np.eye(6))

    @cached_property
    def sums(self) -> np.ndarray:
        """W (6 K, 6 I), one column for each interval between two knots of a segment, for q = 1."""
        inner = np.flatnonzero(np.diff(self.segment) == 0)
        same = self.segment[:, None] == self.segment[inner]
        length = self.time[inner + 1] - self.time[inner]
        since = np.maximum(self.time[:, None] - (self.time[inner] + 0.5 * length), 0.0)
        return np.kron(same * since * np.sqrt(length), np.eye(6))

    @property
    def spread(self) -> np.ndarray:
        """[E, q W], or E where q = 0."""
        return np.hstack([self.levels, self.walk * self.sums]) if self.walk > 0.0 else self.levels
