"""Notes of logs, on how they were read and what was left out of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from satid_gym.telemetry import Log


def reading_notes(logs: Sequence[Log]) -> list[str]:
    """Notes of all logs; a note that several flights share is given once."""
    counts = Counter(note for log in logs for note in log.notes)
    shared = [f"{note} ({count} flights)" for note, count in counts.items() if count > 1]
    return shared + [f"{log.name}: {note}" for log in logs for note in log.notes if counts[note] == 1]


def with_notes(failure: str, logs: Sequence[Log]) -> str:
    """Message of a failure with the notes of the logs, which may tell why."""
    return "; ".join([failure, *reading_notes(logs)])
