"""Tables of cases: every case is tried, with a folder of its own, and a failure names its case."""

from __future__ import annotations

import pytest

from tests.cases import cases


@cases(("a", "b"), [(1, 2), (3, 4)])
@cases("c", "xy")
def seen(a, b, c, tmp_path):
    (tmp_path / "file").touch(exist_ok=False)
    if (a, c) == (3, "y"):
        raise ValueError("the last")


def test_a_failure_names_its_case_and_cases_share_no_folder(tmp_path):
    with pytest.raises(ValueError, match="the last") as error:
        seen(tmp_path=tmp_path)
    assert error.value.__notes__ == ["case: {'c': 'y'}", "case: {'a': 3, 'b': 4}"]
    assert len(list(tmp_path.rglob("file"))) == 4
