"""Satellites that several test modules fly, the browser, and the lane without the compiler."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import hypothesis
import numpy as np
import pytest
from numba import config

from satid_gym import SATELLITES, ReactionWheels, Satellite

# derandomised: a failure here is a failure everywhere; no deadline: the first call of a kernel compiles it
hypothesis.settings.register_profile("suite", derandomize=True, deadline=None, database=None)
hypothesis.settings.load_profile("suite")

_SOURCES = {path.name: path.read_text(encoding="utf-8") for path in Path(__file__).parent.glob("test_*.py")}
_USER = re.compile(r"^(from|import) (agents|baselines|tests\.(qa|golden)|satid_gym\.(policies|control))\b", re.M)
# tests of baselines, agents and of the test tools, most of which fly thousands of episodes
_FLYING = {name for name, text in _SOURCES.items() if _USER.search(text)}
if config.DISABLE_JIT:
    collect_ignore = [name for name in _FLYING if "mark.interpreted" not in _SOURCES[name]]


# files that compile the most go first, in an order in which two that need the same kernels are not begun side by side,
# and then those that take the longest, so that no worker is left alone with one at the end
_COMPILE = ("flightcode", "filter_mpc", "modes", "calibration", "lookahead", "star_tracker", "timing", "pilot")
_LONG = ("identify", "corners", "imitate", "coherence", "docs")
FIRST = [f"test_{name}.py" for name in (*_COMPILE, *_LONG)]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Order the files; without the compiler, some hundred times slower, leave out what is long even with it."""
    items.sort(key=lambda item: FIRST.index(item.path.name) if item.path.name in FIRST else len(FIRST))
    if config.DISABLE_JIT:
        skip = pytest.mark.skip(reason="takes minutes without the compiler")
        for item in items:
            if "compiled" in item.keywords or (item.path.name in _FLYING and "interpreted" not in item.keywords):
                item.add_marker(skip)


@pytest.fixture(autouse=True)
def words_wrap() -> Iterator[None]:
    """As compiled: the random streams count on it, and tests call them by themselves."""
    with np.errstate(over="ignore") if config.DISABLE_JIT else contextlib.nullcontext():
        yield


FULL_TENSOR = np.array([[6.5, 0.4, -0.3], [0.4, 6.0, 0.5], [-0.3, 0.5, 4.5]])


@pytest.fixture(scope="session")
def microsat() -> Satellite:
    return SATELLITES["microsat"]


@pytest.fixture(scope="session")
def skewed() -> Satellite:
    """Microsat's wheels on a body whose principal axes are not the wheels'."""
    return SATELLITES["microsat"].replace(name="skewed", inertia=FULL_TENSOR)


@pytest.fixture(scope="session")
def pyramid() -> Satellite:
    """Four wheels on the edges of a pyramid, each with limits and an inertia of its own, and a full tensor."""
    tilt, azimuth = np.radians(35.26), np.radians([45.0, 135.0, 225.0, 315.0])
    axes = np.array([np.cos(tilt) * np.cos(azimuth), np.cos(tilt) * np.sin(azimuth), np.full(4, np.sin(tilt))])
    wheels = ReactionWheels(
        axes=axes,
        inertia=np.array([2e-3, 1.8e-3, 2.2e-3, 2e-3]),
        max_torque=np.array([0.1, 0.09, 0.1, 0.11]),
        max_speed=np.array([900.0, 850.0, 900.0, 950.0]),
    )
    return Satellite("pyramid", FULL_TENSOR, wheels)


BROWSERS = ("chromium", "chromium-browser", "google-chrome")
ARGUMENTS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync"
)


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """A headless Chromium; if it is missing, a user's tests skip, and those of CI fail."""
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        reason = f"none of {', '.join(BROWSERS)} is installed; for these tests: apt-get install chromium"
        (pytest.fail if os.environ.get("CI") else pytest.skip)(reason)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=ARGUMENTS.split())
        yield browser
        browser.close()
