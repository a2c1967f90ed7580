"""Page of an identification: one HTML file with everything in it."""

from __future__ import annotations

import html

import numpy as np

from satid_gym.estimators.batch.regression import NAMES
from satid_gym.html_page import bullets, document, image, table
from satid_gym.identification.identify import Identification
from satid_gym.identification.record import rounded, variation_lines


def page(found: Identification, picture: bytes, command: str) -> str:
    """HTML of an identification with its figure, which needs nothing from a network."""
    name = html.escape(found.satellite.name)
    white = "white" if found.whiteness.white else "not white"
    inflated = (
        f"; the formal standard deviations are inflated by {found.inflation:.2g}" if found.inflation > 1.0 else ""
    )
    flights = "1 flight" if len(found.flights) == 1 else f"{len(found.flights)} flights"
    rows = sum(flight.used for flight in found.flights)
    parts = [
        f"<h1>Inertia of {name}</h1>",
        f"<p>From {rows} readings of {flights}, by the balance of momentum of body and wheels. Residuals are "
        f"{white} ({found.whiteness.autocorrelation:+.2f} from one reading to the next){inflated}.</p>",
        table(
            ("parameter", "kg m²", "standard deviation", "%", "over rotor", "standard deviation"), _parameters(found)
        ),
        f"<p>Rotor: {found.satellite.wheels.inertia[0]:.4g} kg m², as given; only inertia over rotor inertia is "
        "observable.</p>",
        image(picture, "Estimates by flight, residuals, information by second and by flight"),
        *_over_time(found),
        "<h2>Flights</h2>",
        table(
            (
                "flight",
                "rows",
                "used",
                "outliers",
                "faults",
                "prediction error, rad/s",
                "wheel speed std, rad/s",
                "wheels late, s",
                "attitude late, s",
            ),
            [
                (
                    f"{number}: {flight.name}",
                    str(flight.rows),
                    str(flight.used),
                    str(len(flight.outliers)),
                    str(len(flight.faults)),
                    _number(flight.predicted, ".2f"),
                    _number(flight.signal, ".1f"),
                    *(_number(delay, ".3f", other="") for delay in flight.delays),
                )
                for number, flight in enumerate(found.flights, start=1)
            ],
        ),
        "<p>Prediction error: robust size of the error of a flight's wheel speeds, balanced with the inertia that the "
        "other flights (or the other parts of a single one) gave; next to it the standard deviation of the speeds. "
        "Faults: readings of one tachometer that are left out.</p>",
        "<h2>Notes</h2>",
        bullets(found.notes),
        f"<p><code>{html.escape(command)}</code></p>",
    ]
    return document(f"Inertia of {found.satellite.name}", parts)


def _over_time(found: Identification) -> list[str]:
    """Section on the inertia over time, if requested."""
    if found.variation is None:
        return []
    said = "\n".join(variation_lines(found.variation))
    return ["<h2>Inertia over time</h2>", f"<pre>{html.escape(said)}</pre>"]


def _parameters(found: Identification) -> list[tuple[str, ...]]:
    rotor = found.satellite.wheels.inertia[0]
    std = np.sqrt(np.diag(found.over_rotor_covariance))
    rows: list[tuple[str, ...]] = []
    for k, name in enumerate(NAMES):
        parameter = found.parameters[k]
        if not parameter.determined:
            rows.append((name, "not identified", "", "", "", ""))
            continue
        relative = 100.0 * parameter.std / abs(parameter.value)
        rows.append(
            (
                name,
                *rounded(parameter.value, parameter.std),
                f"{relative:.2g}" if k < 3 else "",
                *rounded(parameter.value / rotor, std[k]),
            )
        )
    return rows


def _number(value: float, form: str, other: str = "-") -> str:
    return format(value, form) if np.isfinite(value) else other
