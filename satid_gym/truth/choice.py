"""Choice of the truth that an environment flies on."""

from __future__ import annotations

from satid_gym.sources import imported, made
from satid_gym.truth.protocol import Truth


def truth_of(value: object) -> Truth:
    """The truth that an object or module:name stands for; a class or function is called without arguments.

    Raises:
        ValueError: it has no `start` and `advance`, or cannot be imported.
    """
    found = imported(value) if isinstance(value, str) else value
    if isinstance(found, type) or (callable(found) and not _is_truth(found)):
        found = made(found, f"truth {value!r}")
    if not _is_truth(found):
        raise ValueError(
            "truth must be an object with start(episode) and advance(torque, disturbance, duration), see "
            f"satid_gym.truth.Truth, or module:name of one; got {value!r}"
        )
    return found  # type: ignore[return-value]


def _is_truth(value: object) -> bool:
    return all(callable(getattr(value, name, None)) for name in ("start", "advance"))
