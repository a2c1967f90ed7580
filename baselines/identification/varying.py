"""Coverage of `identify(..., varying=True)`: J(t) of drawn satellites, constant, with a step or with a drift.

    python -m baselines.identification.varying

Steps of 5 to 15 % come at 30 to 70 % of a flight, drifts reach 2 to 8 % at its end; see
`baselines.identification.recorded` for the telemetry. A knot within three standard deviations of a step's instant, or
half an interval, is not counted: which side of the step it is on is a matter of the instant.
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
from satid_gym import InertiaLaw, identify
from satid_gym.estimators.inertia import inertia_parameters
from satid_gym.telemetry import read_logs

SECONDS = {"clean": 200.0, "downlink": 500.0}
LAWS = ("constant", "step", "drift")
_EPOCH = float(np.datetime64("2026-01-01T00:00:00").astype("datetime64[s]").astype(float))  # of `write_downlink`


@dataclass(frozen=True)
class VaryingSettings:
    """Options of the command."""

    draws: int = 100
    """Satellites drawn for each law."""
    seed: int = 0
    """Seed of the first draw."""
    telemetry: tuple[str, ...] = ("clean", "downlink")
    """Kinds of telemetry."""
    laws: tuple[str, ...] = LAWS
    """Inertia laws."""

    def check(self) -> None:
        """Refuse what is out of range.

        Raises:
            ValueError: no draws, a negative seed, or another kind of telemetry or law.
        """
        if self.draws < 1 or self.seed < 0:
            raise ValueError(f"draws must be at least 1 and seed at least 0, got {self.draws} and {self.seed}")
        if not (set(self.telemetry) <= set(SECONDS) and set(self.laws) <= set(LAWS)):
            raise ValueError(
                f"telemetry must be of {', '.join(SECONDS)} and laws of {', '.join(LAWS)}; got "
                f"{', '.join(self.telemetry)} and {', '.join(self.laws)}"
            )


@dataclass(frozen=True, eq=False, kw_only=True)
class Drawn:
    """What was found of one drawn satellite.

    Attributes:
        kind: of `Variation`.
        distances: (M,) errors over the claimed standard deviations, of the knots that count.
        nees: (L,) per degree of freedom, of the same.
        instants: errors of the instants of steps, s, each of the nearest one found, and their standard deviations.
    """

    kind: str
    distances: np.ndarray
    nees: np.ndarray
    instants: tuple[tuple[float, float], ...]


def draw(telemetry: str, law: str, seed: int) -> Drawn:
    """One satellite, flown, recorded and identified."""
    rng = np.random.default_rng([seed, 7])
    truth, seconds = drawn(CUBESAT, rng), SECONDS[telemetry]
    chosen, at = None, np.nan
    if law == "step":
        at = seconds * rng.uniform(0.3, 0.7)
        chosen = InertiaLaw("step", size=rng.uniform(0.05, 0.15), time=at)
    elif law == "drift":
        chosen = InertiaLaw("drift", size=rng.uniform(0.02, 0.08), time=seconds)
    flown = motion(truth, rng, seconds, law=chosen)
    start = 0.0
    if telemetry == "clean":
        logs = [clean_log(flown, CUBESAT, rng)]
    else:
        with tempfile.TemporaryDirectory() as folder:
            write_downlink(Path(folder) / "flight", flown, truth, rng)
            logs, start = read_logs(folder), _EPOCH
    found = identify(logs, CUBESAT, varying=True).variation
    assert found is not None
    time = found.time - start
    true = np.array(
        [inertia_parameters(flown.inertia[k], "full") for k in np.maximum(np.searchsorted(flown.time, time) - 1, 0)]
    )
    near = np.zeros(len(time), bool)
    steps = [(step.time - start, step.time_std) for step in found.steps]
    for instant, std in steps + [(at, 0.0)] * (law == "step"):
        near |= np.abs(time - instant) <= max(3.0 * std, 0.5 * logs[0].interval) + 0.1
    if law == "step" and steps:
        nearest = min(steps, key=lambda step: abs(step[0] - at))
        low, high = sorted((nearest[0], at))
        near |= (time >= low) & (time <= high)
        instants: tuple[tuple[float, float], ...] = ((nearest[0] - at, nearest[1]),)
    else:
        instants = ()
    error, covariance = (found.theta - true)[~near], found.covariance[~near]
    distances = error / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    told = np.isfinite(distances).all(axis=1)
    nees = np.einsum("ki,ki->k", error[told], np.linalg.solve(covariance[told], error[told][..., None])[..., 0]) / 6.0
    return Drawn(kind=found.kind, distances=distances[np.isfinite(distances)], nees=nees, instants=instants)


@cli.on_interrupt("nothing was written")
def main(settings: VaryingSettings) -> None:
    """Print the table."""
    rows = []
    for telemetry in settings.telemetry:
        for law in settings.laws:
            print(f"{telemetry}, {law}: {settings.draws} draws ...", file=sys.stderr)
            found = [draw(telemetry, law, settings.seed + number) for number in range(settings.draws)]
            distances = np.concatenate([one.distances for one in found])
            kinds = [one.kind for one in found]
            instants = np.array([pair for one in found for pair in one.instants]).reshape(-1, 2)
            rows.append(
                [
                    f"{telemetry}, {law}",
                    ", ".join(f"{kinds.count(kind)} {kind}" for kind in sorted(set(kinds))),
                    f"{np.mean(np.abs(distances) <= 1.96):.1%}",
                    f"{np.median(np.concatenate([one.nees for one in found])):.2f}",
                    f"{np.median(np.abs(instants[:, 0])):.2f} s" if len(instants) else "",
                    f"{np.mean(np.abs(instants[:, 0]) <= 1.96 * instants[:, 1]):.0%}" if len(instants) else "",
                ]
            )
    heads = ["telemetry, inertia", "said to be", "within 1.96 std", "median NEES", "instant's error", "within 1.96 std"]
    print(table(heads, rows, 2))


if __name__ == "__main__":
    cli.run(main)
