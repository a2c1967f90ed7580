"""Page of a design: one HTML file with everything in it."""

from __future__ import annotations

import html

import numpy as np

from satid_gym.estimators.batch.regression import NAMES
from satid_gym.html_page import bullets, document, image, table
from satid_gym.manoeuvres.designer import Design
from satid_gym.manoeuvres.record import comparison, percent
from satid_gym.manoeuvres.trial import Trial

_HEAD = ("", "std, worst moment", "error, median", "95 % below", "beyond a limit", "ended early", "NEES", "turn")


def page(design: Design, picture: bytes, command: str) -> str:
    """HTML of a design with its figure, which needs nothing from a network."""
    sheet, request, trial = design.mission.satellite, design.request, design.trial
    std = zip(NAMES, trial.parameter_std[-1], trial.median_std, design.scale, strict=False)
    parameters = [
        (name, f"{size:.4g}", f"{one * size:.2g}", percent(one), percent(median)) for name, one, median, size in std
    ]
    flown = "from rest to rest, flown by a rate loop"
    if design.mission.control == "torque":
        left = percent(float(np.median(trial.end_rate)) / sheet.rate_limit)
        flown = f"from rest, flown by torque in open loop; at the end the rate is {left} of its limit (median)"
    turned = f"It turns the satellite by up to {np.degrees(trial.turn.max()):.0f} deg"
    if request.returns:
        turned += f" and brings it back to {np.degrees(np.median(trial.turn[-1])):.1f} deg (median)"
    parts = [
        f"<h1>Manoeuvre for {html.escape(sheet.name)}</h1>",
        f"<p>{request.duration:g} s {flown}. {turned}. Figures are of {trial.error.shape[1]} "
        f"random satellites around the data sheet, with its noise. Limits are exceeded for {percent(trial.beyond)} "
        f"of the time at most; the largest rate is {percent(float(trial.rate.max()))} of its limit, the largest wheel "
        f"speed {percent(float(trial.wheel_speed.max()))}.</p>",
        table(("parameter", "scale, kg m²", "standard deviation, kg m²", "over the scale", "its median"), parameters),
        "<p>Standard deviations are root mean squares over the flights. Scale: the moment of the prior, for products "
        "of inertia the geometric mean of two. For the nominal satellite no motion within the limits determines every "
        "moment to better than "
        f"{percent(float(design.least[-1]))}.</p>",
        image(picture, "Rates, torques, accuracy over time, turn, rivals, harder worlds"),
        "<h2>Comparison with other excitation</h2>",
        table(_HEAD, [_row(name, other) for name, other in comparison(design)]),
        "<p>Profiles and closed loops have the best settings for this satellite. Turn limits and "
        "keep-outs apply only to the manoeuvre.</p>",
        "<h2>In harder worlds</h2>",
        "<p>The filter knows of these changes, except of the larger inertia error.</p>",
        table(_HEAD, [_row(name, other) for name, other in design.stressed.items()]),
        "<h2>Notes</h2>",
        bullets(design.notes),
        f"<p><code>{html.escape(command)}</code></p>",
    ]
    return document(f"Manoeuvre for {sheet.name}", parts)


def _row(name: str, trial: Trial) -> tuple[str, ...]:
    error = trial.error[-1]
    return (
        name,
        percent(trial.accuracy),
        percent(float(np.median(error))),
        percent(float(np.quantile(error, 0.95, method="higher"))),
        percent(trial.beyond),
        str(int(trial.terminated.sum())),
        f"{trial.nees.mean():.2f}",
        f"{np.degrees(trial.turn.max()):.0f} deg",
    )
