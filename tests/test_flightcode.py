"""Flight code: compiled with every warning an error, it flies what Pilot flies, and nothing makes it command nonsense."""

import os
import shutil
import subprocess

import numpy as np
import pytest

from satid_gym import Pilot
from satid_gym.commands.main import main
from satid_gym.flightcode import write
from satid_gym.flightcode.c_types import DOUBLE, Array, TranslationError
from satid_gym.flightcode.measure import compiled, compiler, measures
from satid_gym.flightcode.translator import Translator
from satid_gym.flightcode.vectors import expected, flight
from satid_gym.flightcode.writer import texts
from satid_gym.policies import build
from satid_gym.policies.shaped_square import ShapedSquarePolicy
from satid_gym.problem import problem
from tests.cases import cases
from tests.tolerances import ALL

SQUARE = {"period": 36.0, "margin": 2.5}


@pytest.fixture(scope="module", autouse=True)
def gcc():
    """A C compiler; if it is missing, a user's tests skip, and those of CI fail."""
    if shutil.which(compiler_name := os.environ.get("CC", "cc")) is None:
        reason = f"no C compiler {compiler_name!r}; for these tests: apt-get install gcc libc6-dev"
        (pytest.fail if os.environ.get("CI") else pytest.skip)(reason)


def built(folder, pilot):
    """Program that replays vectors, of the pilot's code in a folder."""
    for name, text in texts(pilot).items():
        (folder / name).write_text(text)
    return compiled(folder)


def replayed(check, folder, vectors):
    (folder / "flown.csv").write_text(vectors)
    run = subprocess.run([check, folder / "flown.csv"], capture_output=True, text=True)
    return run.returncode, run.stdout + run.stderr


def pilot_of(kind, pyramid):
    if kind == "panels":
        sheet = problem("microsat", scenario="flex").satellites[3]
        return Pilot(sheet, ShapedSquarePolicy(), scenario="flex", control="rate")
    satellite = pyramid if kind.startswith("pyramid") else "microsat"
    scenario = {"paper": "paper", "faults": "faults", "tolerances": {"tolerances": ALL}}.get(kind, "default")
    policy = kind if kind in ("generalist", "multi_step", "random") else build("rate_square", SQUARE)
    return Pilot(satellite, policy, scenario=scenario, control="rate" if kind.endswith("rate") else "torque")


KINDS = ["generalist", "multi_step", "random", "pyramid", "pyramid_rate", "paper", "faults", "tolerances", "panels"]


@cases("kind", KINDS)
def test_it_flies_a_whole_flight_as_python_does(kind, pyramid, tmp_path):
    """Torque, estimate and its standard deviations to 1e-6, with lost and repeated readings: check.c compares."""
    pilot = pilot_of(kind, pyramid)
    rows = flight(pilot, pilot.problem.scenario.decisions)
    assert sum(np.isnan(gyro).all() for _, gyro, _ in rows) > 0.005 * len(rows)
    code, said = replayed(built(tmp_path, pilot), tmp_path, expected(pilot, rows))
    assert code == 0, said
    assert said.startswith(f"{len(rows)} readings")
    assert pilot.status.state == "over"
