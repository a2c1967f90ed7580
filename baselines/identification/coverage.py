"""Coverage of `identify`: how often the truth is within what it claims, on telemetry made from `simulate`.

A satellite is drawn, flown and recorded again and again, once with clean readings at 10 Hz and once as a ground station
exports them; see `baselines.identification.recorded`.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from baselines.command import cli
from baselines.command.markdown import table
from baselines.identification.recorded import CUBESAT, clean_log, drawn, motion, write_downlink
from satid_gym import identify
from satid_gym.estimators.inertia import inertia_parameters
from satid_gym.identification import Identification
from satid_gym.satellite import Satellite
from satid_gym.telemetry import read_logs

KINDS = {"clean": 200.0, "downlink": 500.0}  # s that a flight lasts


@dataclass(frozen=True)
class CoverageSettings:
    """Options of the command."""

    draws: int = 100
    """Satellites drawn for each kind of telemetry."""
    seed: int = 0
    """Seed of the first draw."""

    def check(self) -> None:
        """Refuse what is out of range.

        Raises:
            ValueError: no draws, or a negative seed.
        """
        if self.draws < 1 or self.seed < 0:
            raise ValueError(f"draws must be at least 1 and seed at least 0, got {self.draws} and {self.seed}")


@dataclass(frozen=True, kw_only=True)
class Coverage:
    """Shares of the parameters within 1, 1.96 and 3 standard deviations, and what else is said of the errors.

    Attributes:
        one, two, three: shares.
        nees: mean per degree of freedom.
        bias: mean signed error of the three moments over the claimed standard deviation.
    """

    one: float
    two: float
    three: float
    nees: float
    bias: float


def distances(found: Identification, truth: Satellite) -> tuple[np.ndarray, float]:
    """Errors (6,) over the claimed standard deviations, and NEES per degree of freedom."""
    error = inertia_parameters(found.inertia, "full") - inertia_parameters(truth.inertia, "full")
    nees = float(error @ np.linalg.solve(found.covariance, error)) / 6.0
    return error / np.sqrt(np.diag(found.covariance)), nees


def draw(kind: str, seed: int) -> tuple[np.ndarray, float]:
    """`distances` of one drawn satellite."""
    rng = np.random.default_rng([seed, 7])
    truth = drawn(CUBESAT, rng)
    flown = motion(truth, rng, KINDS[kind])
    if kind == "clean":
        return distances(identify(clean_log(flown, CUBESAT, rng), CUBESAT), truth)
    with tempfile.TemporaryDirectory() as folder:
        write_downlink(Path(folder) / "flight", flown, truth, rng)
        logs = read_logs(folder)
    return distances(identify(logs, CUBESAT), truth)


def coverage(kind: str, draws: int, seed: int = 0) -> Coverage:
    """Summary of a number of draws of one kind of telemetry."""
    found = [draw(kind, seed + number) for number in range(draws)]
    z = np.array([one for one, _ in found])
    one, two, three = (float((np.abs(z) < bound).mean()) for bound in (1.0, 1.96, 3.0))
    nees = float(np.mean([nees for _, nees in found]))
    return Coverage(one=one, two=two, three=three, nees=nees, bias=float(z[:, :3].mean()))


@cli.on_interrupt("nothing was written")
def main(settings: CoverageSettings) -> None:
    """Print the table."""
    rows = []
    for kind in KINDS:
        print(f"{kind}: {settings.draws} draws ...", file=sys.stderr)
        found = coverage(kind, settings.draws, settings.seed)
        shares = [f"{share:.1%}" for share in (found.one, found.two, found.three)]
        rows.append([kind, *shares, f"{found.nees:.2f}", f"{found.bias:+.2f} std"])
    heads = [
        "telemetry",
        "within 1 std",
        "within 1.96",
        "within 3",
        "NEES per degree of freedom",
        "bias of the moments",
    ]
    print(table(heads, rows, 1))


if __name__ == "__main__":
    cli.run(main)
