"""Frame of an episode: the satellite, its rates and wheel speeds with their limits, and its inertia estimate."""

from __future__ import annotations

import numpy as np

from satid_gym.rendering.canvas import ALARM, MUTED, RULE, TEXT, Canvas, series_colour, shade
from satid_gym.rendering.history import History
from satid_gym.rendering.payload import Payload
from satid_gym.rendering.scene import Scene, stars
from satid_gym.rendering.sky import Sky
from satid_gym.rendering.strip import Strip

UNITS = 480  # width and height of a frame, the unit of the coordinates below
_MARGIN = 0.03  # of a moment, by which its strip extends beyond the range of the truth


def draw(history: History, size: int) -> np.ndarray:
    """Picture of the episode so far.

    Args:
        history: with at least one entry.
        size: width and height in pixels.

    Returns:
        (size, size, 3) uint8.
    """
    canvas = Canvas(UNITS, UNITS, size / UNITS)
    _head(canvas, history)
    _scene(canvas, history)
    rate = history.rate / history.satellite.rate_limit
    _limits(canvas, history, 40.0, "body rate / limit", rate, "xyz")
    speed = history.wheel_speed / history.satellite.wheels.max_speed
    names = "".join(str(k + 1) for k in range(speed.shape[1]))
    low, high = history.satellite.wheels.avoided_speed
    avoided = np.array([low, high]) / history.satellite.wheels.max_speed.min()
    _limits(canvas, history, 150.0, "wheel speed / limit", speed, names, avoided)
    _inertia(canvas, history)
    return canvas.pixels()


def _head(canvas: Canvas, history: History) -> None:
    name = history.satellite.name
    width = canvas.text((10.0, 17.0), name if len(name) <= 26 else f"{name[:25]}...", TEXT, 15.0)
    canvas.text((18.0 + width, 18.0), f"{history.mode} inertia", MUTED, 11.0)
    canvas.text((470.0, 17.0), f"{history.time[-1]:.0f} of {history.horizon:.0f} s", TEXT, 13.0, "right")
    canvas.rectangle(0.0, 32.0, 480.0, 1.0, RULE)


def _scene(canvas: Canvas, history: History) -> None:
    canvas.clip(0.0, 33.0, 272.0, 225.0)
    stars(canvas, 4.0, 37.0, 264.0, 217.0)
    tracker = history.satellite.sensors.star_tracker
    sky = None if tracker is None else Sky(history, tracker)
    place, radius = ((136.0, 144.0), 82.0) if sky is None else ((168.0, 140.0), 74.0)
    scene = Scene(canvas, place, radius, history)
    payload = None if history.operations is None else Payload(history, history.operations)
    scene.draw(sky, payload)
    scene.scale_bar(262.0, 250.0)
    scene.deflection(10.0, 250.0)
    shown = sky if payload is None else payload
    if shown is not None:
        shown.map(canvas, (50.0, 98.0), 42.0)
    canvas.unclip()


def _limits(
    canvas: Canvas,
    history: History,
    y: float,
    title: str,
    values: np.ndarray,
    names: str,
    avoided: np.ndarray | None = None,
) -> None:
    """Draw curves in multiples of their limit; the title is red while one is beyond it, or in a band (2,) to avoid."""
    strip = Strip(
        canvas=canvas, x=294.0, y=y + 18.0, width=176.0, height=80.0, horizon=history.horizon, low=-1.25, high=1.25
    )
    size, whole = np.abs(values[-1]), np.array([0.0, history.horizon])
    beyond = bool(size.max() > 1.0)
    if avoided is not None and avoided[1] > avoided[0]:
        beyond = beyond or bool(((size >= avoided[0]) & (size <= avoided[1])).any())
    canvas.text((294.0, y + 9.0), title, ALARM if beyond else TEXT)
    for i, name in enumerate(reversed(names)):
        canvas.text((468.0 - 11.0 * i, y + 9.0), name, series_colour(len(names) - 1 - i), 11.0, "right")
    strip.ground()
    if history.operations is not None:
        Payload(history, history.operations).windows(strip)
    if avoided is not None and avoided[1] > avoided[0]:
        for low, high in (avoided, -avoided[::-1]):
            strip.band(whole, np.full(2, low), np.full(2, high), ALARM, 0.25)
    strip.level(0.0)
    for limit in (-1.0, 1.0):
        strip.level(limit, shade(ALARM, RULE, 0.3), dashes=24)
        strip.value_label(limit, f"{limit:+g}")
    for i in range(values.shape[1]):
        strip.curve(history.time, values[:, i], series_colour(i))


def _inertia(canvas: Canvas, history: History) -> None:
    """Draw a strip for each moment: estimate, its band of three standard deviations, and truth."""
    canvas.text((10.0, 270.0), "inertia, kg m²", TEXT)
    canvas.text((96.0, 270.0), "estimate, 3σ band, truth in white", MUTED)
    error = history.relative_error[-1]
    canvas.text((470.0, 270.0), f"relative error {100 * error:.3f} %", TEXT, 12.0, "right")
    for i, name in enumerate(("Jxx", "Jyy", "Jzz")):
        colour, truth = series_colour(i), history.truth[:, i]
        estimate, reach = history.estimate[:, i], 3.0 * history.std[:, i]
        margin = _MARGIN * truth[0]
        low = min(truth.min() - margin, estimate[-1] - margin / 3.0)
        high = max(truth.max() + margin, estimate[-1] + margin / 3.0)
        y = 282.0 + 60.0 * i
        strip = Strip(canvas=canvas, x=44.0, y=y, width=350.0, height=55.0, horizon=history.horizon, low=low, high=high)
        strip.ground()
        strip.band(history.time, estimate - reach, estimate + reach, colour)
        strip.curve(history.time, truth, TEXT, 0.8)
        strip.curve(history.time, estimate, colour, 1.2)
        digits = max(0, 3 - int(np.floor(np.log10(truth[0]))))
        canvas.text((38.0, y + 27.0), name, colour, 12.0, "right")
        strip.edge_labels(f".{max(0, digits - 1)}f")
        canvas.text((470.0, y + 12.0), f"{estimate[-1]:.{digits}f}", colour, 12.0, "right")
        canvas.text((470.0, y + 27.0), f"± {reach[-1]:.{digits}f}", MUTED, 11.0, "right")
        canvas.text((470.0, y + 42.0), f"{truth[-1]:.{digits}f}", TEXT, 11.0, "right")
    strip.time_labels()
    canvas.text((412.0, 465.0), "s", MUTED, 9.0)
