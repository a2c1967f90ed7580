"""The writer of Markdown tables."""

import pytest

from baselines.command.markdown import table
from tests.cases import cases


def test_a_table_by_hand():
    assert table(["a", "b"], [["1", "2"]]) == "| a | b |\n| --- | --- |\n| 1 | 2 |"
    assert table(["a", "b"], [["1", "2"]], 1).splitlines()[1] == "| --- | ---: |"
    assert table(["a"], []) == "| a |\n| --- |"


@cases("row", [["1"], ["1", "2", "3"]])
def test_a_row_of_another_length_is_refused(row):
    with pytest.raises(ValueError, match="must have 2 cells"):
        table(["a", "b"], [["1", "2"], row])
