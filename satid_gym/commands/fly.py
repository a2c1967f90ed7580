"""Subcommand `satid fly`: one satellite, one policy, one episode, in the terminal, as a picture, a video or a page."""

from __future__ import annotations

import argparse
import html
import importlib
import io
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from satid_gym import metrics
from satid_gym.commands.ending import early_end
from satid_gym.commands.flight_log import FlightLog
from satid_gym.commands.words import HelpFormatter, as_typed
from satid_gym.config import check_integer
from satid_gym.env import SatInertiaIDEnv
from satid_gym.files import check_writable, write_bytes, write_text
from satid_gym.html_page import document, image, table, video
from satid_gym.manoeuvres.policy import ManoeuvrePolicy
from satid_gym.onboard.choice import check_control, policy_by_name
from satid_gym.policies import LearnedPolicy
from satid_gym.policy import observation_settings, only_mission, show_filter
from satid_gym.problem import CONTROLS

_EXAMPLES = """examples:
  satid fly
  satid fly --satellite sat.toml --policy generalist --inertia step --seed 3
  satid fly --satellite cubesat --policy rate_square --picture flight.png
  satid fly --scenario flex --policy shaped_square --control rate --page a.html
  satid fly --policy design/design.json --control rate --log flight.csv
"""
_INERTIA = "static, step, drift, periodic, random, or file; deployment, fuel, release (not the learned policies)"
_EVERY = 10  # lines a flight
_FRAMES, _FPS, _SIZE = 150, 15, 640  # pictures of a video, how many a second, and their width, pixels
_ENDINGS = {"log": (".csv",), "picture": (".png",), "video": (".mp4", ".gif"), "page": (".html",)}


def add(parts: Any) -> None:
    """Add the subcommand."""
    own = parts.add_parser(
        "fly",
        help="one satellite, one policy, one episode",
        description="Fly one episode and show error, uncertainty and rates. Picture, video and page need "
        'pip install ".[render]" in the checkout.',
        epilog=_EXAMPLES,
        formatter_class=HelpFormatter,
    )
    own.add_argument("--satellite", default="microsat", help="name or file; default microsat")
    own.add_argument(
        "--policy",
        default="generalist",
        help="shipped policy, tuned baseline, path of a policy, module:name (runs its code), or design.json of satid "
        "design; default generalist",
    )
    own.add_argument("--scenario", default="default", help="name or file")
    own.add_argument("--control", choices=CONTROLS, default="torque", help="what actions are; default torque")
    own.add_argument("--inertia", default="random", help=_INERTIA)
    own.add_argument("--seed", type=int, default=0)
    own.add_argument("--log", type=Path, metavar="FILE.csv", help="readings of the flight, for satid identify")
    own.add_argument("--picture", type=Path, metavar="FILE.png", help="picture of the whole flight")
    own.add_argument("--video", type=Path, metavar="FILE.mp4", help="video of the flight, or .gif")
    own.add_argument("--page", type=Path, metavar="FILE.html", help="page with scores, video and picture")
    own.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """Fly, print a line every tenth of the flight, and write what is asked for.

    Raises:
        ValueError: a name or file is not valid, or the policy cannot fly this satellite.
    """
    check_integer("--seed", given.seed, low=0)
    drawn = _check_outputs(given)
    env = SatInertiaIDEnv(given.satellite, given.inertia, given.scenario)
    check_control(given.policy, given.control)
    policy = policy_by_name(given.policy, only_mission(env.problem).satellite, env.problem.scenario)
    env = SatInertiaIDEnv(
        given.satellite,
        given.inertia,
        given.scenario,
        render_mode="rgb_array" if drawn else None,
        render_size=_SIZE,
        control=given.control,
        **observation_settings(policy),
    )
    mission = only_mission(env.problem)
    try:
        policy.reset(mission, [given.seed])
    except ValueError as error:
        if not isinstance(policy, LearnedPolicy):
            raise
        raise ValueError(f"{error}; rate_square, with --control rate, flies any satellite") from error
    if isinstance(policy, ManoeuvrePolicy) and (doubt := policy.doubt(mission.satellite)):
        print(f"note: {doubt}", file=sys.stderr)
    title = f"{mission.satellite.name}, {policy.name}, seed {given.seed}"
    print(title)
    frames: list[np.ndarray] = []
    moving = given.video or given.page
    log = FlightLog(env) if given.log else None
    scores = _fly(env, policy, given.seed, (lambda: frames.append(_frame(env))) if moving else None, log)
    if log is not None:
        write_text(given.log, log.csv())
        print(f"written to {given.log}")
    if drawn:
        _write(given, title, scores, frames, _png(_frame(env)))
    return 0


def _fly(
    env: SatInertiaIDEnv, policy: Any, seed: int, draw: Callable[[], None] | None, log: FlightLog | None
) -> dict[str, float]:
    """Fly an episode, printing how it goes, drawing now and then, and keeping its readings; its scores."""
    decisions = env.problem.scenario.decisions
    series: dict[str, list[float]] = {"relative_error": [], "outside": [], "nees": [], "cost": []}
    observation, info = env.reset(seed=seed)
    if log is not None:
        log.begin()
    print(f"{'time':>8s} {'error':>10s} {'held':>10s} {'outside':>8s} {'cost':>6s} {'NEES':>6s}")
    for decision in range(1, decisions + 1):
        if draw is not None and (decision - 1) % max(1, decisions // _FRAMES) == 0:
            draw()
        show_filter(policy, env.fleet.rows.beliefs, env.fleet.rows.tasks)
        observation, _, terminated, truncated, info = env.step(policy(observation[None])[0])
        if log is not None:
            log.note()
        for name, values in series.items():
            values.append(info[name])
        if decision % max(1, decisions // _EVERY) == 0 or terminated or truncated:
            print(
                f"{info['time']:6.0f} s {info['relative_error']:10.3%} {info['information_held']:5.1f} nats "
                f"{np.mean(series['outside']):8.1%} {np.mean(series['cost']):6.1%} {info['nees']:6.2f}",
                flush=True,
            )
        if terminated:
            print(early_end(env))
        if terminated or truncated:
            break
    if draw is not None:
        draw()
    error = np.array(series["relative_error"])[:, None]
    return {
        "duration": info["time"],
        "final_error": float(metrics.final_error(error)[0]),
        "mean_error": float(metrics.mean_error(error)[0]),
        "nees": float(np.nanmean(series["nees"])),
        "outside": float(np.mean(series["outside"])),
        "cost": float(np.mean(series["cost"])),
    }


def _check_outputs(given: argparse.Namespace) -> bool:
    """Refuse files that cannot be written, before the flight; whether anything is drawn.

    Raises:
        ValueError: an ending is of another format, or what draws is not there.
        OSError: a folder cannot be written to.
    """
    asked = {name: getattr(given, name) for name in _ENDINGS if getattr(given, name)}
    for name, path in asked.items():
        if path.suffix.lower() not in _ENDINGS[name]:
            raise ValueError(f"--{name} takes a file that ends in {' or '.join(_ENDINGS[name])}, got {path}")
        check_writable(path.parent, stays=False)
    asked.pop("log", None)
    if asked:
        try:
            for module in ("canvas", *(["video"] if given.video or given.page else [])):
                importlib.import_module(f"satid_gym.rendering.{module}")
        except (ImportError, gymnasium.error.DependencyNotInstalled) as error:
            raise ValueError(f'for --{next(iter(asked))}, pip install ".[render]" in the checkout') from error
    return bool(asked)


def _frame(env: SatInertiaIDEnv) -> np.ndarray:
    frame = env.render()
    assert frame is not None
    return frame


def _png(frame: np.ndarray) -> bytes:
    import pygame

    out = io.BytesIO()
    pygame.image.save(pygame.surfarray.make_surface(frame.swapaxes(0, 1)), out, "frame.png")
    return out.getvalue()


def _write(
    given: argparse.Namespace, title: str, scores: dict[str, float], frames: list[np.ndarray], picture: bytes
) -> None:
    """Write picture, video and page, and say so."""
    if given.picture:
        write_bytes(given.picture, picture)
    if frames:
        from satid_gym.rendering.video import write as write_video

        if given.video:
            write_video(given.video, frames, _FPS)
        if given.page:
            with tempfile.TemporaryDirectory() as folder:
                film = Path(folder) / "flight.mp4"
                write_video(film, frames, _FPS)
                write_text(given.page, _page(title, scores, film.read_bytes(), picture, as_typed(given.words)))
    for name in ("picture", "video", "page"):
        if path := getattr(given, name):
            print(f"written to {path}")


def _page(title: str, scores: dict[str, float], film: bytes, picture: bytes, command: str) -> str:
    rows = [
        ("flown for", f"{scores['duration']:g} s"),
        ("final error, last fifth of the flight", f"{scores['final_error']:.3%}"),
        ("mean error", f"{scores['mean_error']:.3%}"),
        ("NEES per degree of freedom, mean", f"{scores['nees']:.2f}"),
        ("rates outside their limit", f"{scores['outside']:.1%} of the time"),
        ("largest cost, mean", f"{scores['cost']:.1%}"),
    ]
    parts = [
        f"<h1>{html.escape(title)}</h1>",
        table(("score", ""), rows),
        video(film, "The flight"),
        "<h2>At the end</h2>",
        image(picture, "Satellite, wheels, rates, estimates and truth over the flight"),
        f"<p><code>{html.escape(command)}</code></p>",
    ]
    return document(title, parts)
