"""Cells that a study's file holds: what is kept, and what is refused and never replaced silently."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from baselines.command import cells

SETTINGS = {"episodes": 3, "worlds": ("a", "b"), "step": None, "output": "x.json", "again": False, "ray": None}
ROWS = [{"world": "a"}, {"world": "b", "revision": "b2"}]


def head(revision="a1", **settings):
    return {"revision": revision, "settings": {**SETTINGS, **settings}}


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "found.json"
    path.write_text(json.dumps({**head(), "cells": ROWS}))
    return path


def test_cells_of_the_same_settings_and_revision_are_kept(file, tmp_path):
    assert cells.kept(file, head(), "cells", again=False) == ROWS
    assert cells.kept(file, head(output=Path("y.json"), ray="auto"), "cells", again=False) == ROWS
    assert cells.kept(file, head(newer=1), "cells", again=False) == ROWS, "of before there was the setting"
    assert cells.kept(tmp_path / "none.json", head(), "cells", again=False) == []


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (head(episodes=4), "episodes = 3"),
        (head(step=0.1), "step = None"),
        (head(worlds=("a",), episodes=4), "episodes = 3, other worlds"),
        (head("b2"), "revision = a1"),
        (head("a1-dirty"), "revision = a1"),
    ],
)
def test_other_results_are_refused_and_replaced_if_asked(file, asked, said):
    with pytest.raises(ValueError, match=f"found.json was flown with {said}: give another --output, or --again"):
        cells.kept(file, asked, "cells", again=False)
    assert cells.kept(file, asked, "cells", again=True) == []


@pytest.mark.parametrize("revision", ["a1-dirty", "unknown"])
def test_cells_of_unknown_code_are_not_kept(file, revision):
    file.write_text(json.dumps({**head(revision), "cells": ROWS}))
    with pytest.raises(ValueError, match=f"was flown with revision = {revision}: give another"):
        cells.kept(file, head(revision), "cells", again=False)


def test_mixed_cells_name_their_revision(file):
    for again in (False, True):
        found = cells.kept(file, head("c3", worlds=("c",)), "cells", again=again, mixed=("worlds",))
        assert found == [{"world": "a", "revision": "a1"}, {"world": "b", "revision": "b2"}]
    with pytest.raises(ValueError, match="was flown with episodes = 3:"):
        cells.kept(file, head("c3", episodes=4), "cells", again=False, mixed=("worlds",))
