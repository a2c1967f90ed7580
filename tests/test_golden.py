"""SatInertiaID-v0 does what it did when its golden flights were written; a change of behaviour is a -v1."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from tests.cases import cases
from tests.golden.flights import CASES, DATA, fly

RECORDED = json.loads(DATA.read_text(encoding="utf-8"))["flights"]
CLOSE = 1e-9  # relative: processors may differ in the last bits, and a flight carries them on
FLOAT32 = 2e-7  # observations have no more


def test_every_case_is_recorded():
    assert sorted(RECORDED) == sorted(CASES)


@cases("case", CASES)
def test_the_flight_is_as_recorded(case):
    flown, recorded = fly(case), RECORDED[case]
    assert (flown["decisions"], flown["terminated"]) == (recorded["decisions"], recorded["terminated"])
    assert flown["reward"] == pytest.approx(recorded["reward"], rel=CLOSE)
    assert flown["error"] == pytest.approx(recorded["error"], rel=CLOSE)
    for now, then in zip(flown["marks"], recorded["marks"], strict=True):
        _same(now, then)


def _same(now: dict[str, Any], then: dict[str, Any]) -> None:
    assert now.keys() == then.keys()
    for key, value in then.items():
        expected = np.array(value, float)
        tolerance = FLOAT32 if key == "observation" else CLOSE
        scale = np.abs(expected).max()
        np.testing.assert_allclose(
            np.array(now[key], float), expected, rtol=tolerance, atol=tolerance * scale,
            err_msg=f"{key} at decision {then['decision']}; meant? then `python -m tests.golden`, and -v1",
        )  # fmt: skip


def test_flights_tell_changes_apart():
    """A change of one part in a million anywhere would be seen."""
    recorded = RECORDED["default, microsat, static"]["marks"][-1]
    with pytest.raises(AssertionError, match="nees at decision"):
        _same({**recorded, "nees": recorded["nees"] * (1.0 + 1e-6)}, recorded)
