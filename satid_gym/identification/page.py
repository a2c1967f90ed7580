"""Page of an identification: one HTML file with everything in it."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence

import numpy as np

from satid_gym.estimators.batch.regression import NAMES
from satid_gym.identification.identify import Identification
from satid_gym.identification.record import rounded, variation_lines

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #1b1f24; }
table { border-collapse: collapse; margin: 1rem 0; display: block; overflow-x: auto; }
th, td { padding: .3rem .8rem; border-bottom: 1px solid #d0d7de; text-align: right; white-space: nowrap; }
th:first-child, td:first-child { text-align: left; }
img { max-width: 100%; background: white; }
li { margin: .2rem 0; }
@media (prefers-color-scheme: dark) { body { background: #16191d; color: #e6e8ea; } th, td { border-color: #3d444d; } }
"""


def page(found: Identification, picture: bytes, command: str) -> str:
    """HTML of an identification with its figure, which needs nothing from a network."""
    name = html.escape(found.satellite.name)
    image = base64.b64encode(picture).decode()
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
        _table(
            ("parameter", "kg m²", "standard deviation", "%", "over rotor", "standard deviation"), _parameters(found)
        ),
        f"<p>Rotor: {found.satellite.wheels.inertia[0]:.4g} kg m², as given; only inertia over rotor inertia is "
        "observable.</p>",
        f'<img alt="Estimates by flight, residuals, share of information" src="data:image/png;base64,{image}">',
        *_over_time(found),
        "<h2>Flights</h2>",
        _table(
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
        "other flights (or the other parts of a single one) gave; beside it the standard deviation of the speeds. "
        "Faults: readings of one tachometer that are left out.</p>",
        "<h2>Notes</h2>",
        f"<ul>{''.join(f'<li>{html.escape(note)}</li>' for note in found.notes) or '<li>none</li>'}</ul>",
        f"<p><code>{html.escape(command)}</code></p>",
    ]
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>Inertia of {name}</title>'
    body = "\n".join(parts)
    return (
        f'<!doctype html>\n<html lang="en"><head>{head}<style>{_STYLE}</style></head>\n<body>\n{body}\n</body></html>\n'
    )


def _over_time(found: Identification) -> list[str]:
    """What was asked of the inertia over time."""
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
            rows.append((name, "the data do not tell", "", "", "", ""))
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


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    top = "".join(f"<th>{html.escape(cell)}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"
