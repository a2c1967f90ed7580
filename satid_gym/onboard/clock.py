"""Clock of the pilot: stamps of readings, and which of them are left out."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

SAME = 1e-6  # of the sample period, within which two intervals are the same
USUAL_SAMPLES = 10  # by which readings may be apart, whatever the patience


class WrongStamp(NamedTuple):
    """Why the readings of a stamp are left out: the kind that is counted, and words."""

    kind: Literal["late", "repeated", "ahead"]
    message: str


class Clock:
    """Stamps so far.

    A stamp that has passed is wrong. One further ahead than readings usually come may be the first after a gap, or
    damaged: it is left out, and the next tells. If that is further on by no more than the first was ahead, both were
    right, and readings that come no more often are taken from then on.

    Args:
        time: s, first stamp.
        period: s, of samples.
        patience: s.
    """

    def __init__(self, time: float, period: float, patience: float) -> None:
        self._seen, self._ahead, self._left_out = time, -np.inf, 0
        self._period, self._patience = period, patience
        self._usual = max(patience, USUAL_SAMPLES * period)

    def wrong(self, time: float) -> WrongStamp | None:
        """What is wrong with the next stamp, s; None where it is taken."""
        since, further, slack = time - self._seen, time - self._ahead, SAME * self._period
        self._left_out += 1
        if since < slack:
            return WrongStamp("late" if since < -slack else "repeated", "a stamp that has passed")
        if since > self._usual + slack:
            if not slack <= further <= self._ahead - self._seen + slack:
                self._ahead = time
                return WrongStamp("ahead", f"a stamp {since:.3g} s ahead: left out until the next one confirms it")
            self._usual = max(self._usual, further)
        self._seen, self._ahead, self._left_out = time, -np.inf, 0
        return None

    @property
    def stands(self) -> bool:
        """Whether stamps have been wrong for longer than `patience`, by the number of them."""
        return self._left_out * self._period > self._patience
