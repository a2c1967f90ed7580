"""Subcommand `satid fly`: one satellite, one policy, one episode, in the terminal."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from satid_gym.env import SatInertiaIDEnv
from satid_gym.files import replacing
from satid_gym.onboard.choice import policy_by_name
from satid_gym.policies import LearnedPolicy
from satid_gym.policy import observation_settings, only_mission
from satid_gym.problem import CONTROLS

_EXAMPLES = """examples:
  satid fly
  satid fly --satellite sat.toml --policy generalist --inertia step --seed 3
  satid fly --satellite cubesat --policy rate_square --picture flight.png
  satid fly --scenario flex --policy shaped_square --control rate
"""
_INERTIA = "static, step, drift, periodic, random, or file; deployment, fuel, release (not the learned policies)"
_EVERY = 10  # lines a flight


def add(parts: Any) -> None:
    """Add the subcommand."""
    own = parts.add_parser(
        "fly",
        help="one satellite, one policy, one episode",
        description="Fly one episode and show how error, uncertainty and rates go.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    own.add_argument("--satellite", default="microsat", help="name or file; default microsat")
    own.add_argument(
        "--policy", default="generalist", help="shipped policy, tuned baseline, or path; default generalist"
    )
    own.add_argument("--scenario", default="default", help="name or file")
    own.add_argument("--control", choices=CONTROLS, default="torque", help="what actions are; default torque")
    own.add_argument("--inertia", default="random", help=_INERTIA)
    own.add_argument("--seed", type=int, default=0)
    own.add_argument("--picture", type=Path, metavar="FILE.png", help='picture of the flight; pip install ".[render]"')
    own.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """Fly and print a line every tenth of the flight.

    Raises:
        ValueError: a name or file is not valid, or the policy cannot fly this satellite.
    """
    if given.picture and given.picture.suffix.lower() != ".png":
        raise ValueError(f"--picture takes a file that ends in .png, got {given.picture}")
    if given.picture:
        _check_pygame()
    env = SatInertiaIDEnv(given.satellite, given.inertia, given.scenario)
    policy = policy_by_name(given.policy, only_mission(env.problem).satellite.name, env.problem.scenario.name)
    env = SatInertiaIDEnv(
        given.satellite,
        given.inertia,
        given.scenario,
        render_mode="rgb_array" if given.picture else None,
        control=given.control,
        **observation_settings(policy),
    )
    mission = only_mission(env.problem)
    try:
        policy.reset(mission, [given.seed])
    except ValueError as error:
        if not isinstance(policy, LearnedPolicy):
            raise
        raise ValueError(f"{error}; rate_square flies any") from error
    observation, info = env.reset(seed=given.seed)
    decisions, outside = env.problem.scenario.decisions, []
    print(f"{mission.satellite.name}, {policy.name}, seed {given.seed}")
    print(f"{'time':>8s} {'error':>10s} {'held':>10s} {'outside':>8s} {'NEES':>6s}")
    for decision in range(1, decisions + 1):
        observation, _, terminated, truncated, info = env.step(policy(observation[None])[0])
        outside.append(info["outside"])
        if decision % max(1, decisions // _EVERY) == 0 or terminated or truncated:
            print(
                f"{info['time']:6.0f} s {info['relative_error']:10.3%} {info['information_held']:5.1f} nats "
                f"{np.mean(outside):8.1%} {info['nees']:6.2f}",
                flush=True,
            )
        if terminated or truncated:
            break
    if given.picture:
        _write_picture(env, given.picture)
    return 0


def _check_pygame() -> None:
    """Refuse to draw before the flight, not after it.

    Raises:
        ValueError: pygame is not there.
    """
    try:
        importlib.import_module("satid_gym.rendering.canvas")
    except gymnasium.error.DependencyNotInstalled as error:
        raise ValueError('for --picture, pip install ".[render]" in the checkout') from error


def _write_picture(env: SatInertiaIDEnv, path: Path) -> None:
    import pygame

    frame = env.render()
    assert frame is not None
    with replacing(path, ending=".png") as part:
        pygame.image.save(pygame.surfarray.make_surface(frame.swapaxes(0, 1)), str(part))
    print(f"written to {path}")
