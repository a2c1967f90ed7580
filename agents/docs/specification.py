"""Tables of the environment's page, read from the docstrings that specify the environments, and of the satellites."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import docstring_parser
import numpy as np

from baselines.command.markdown import table
from satid_gym.env import SatInertiaIDEnv
from satid_gym.satellite import SATELLITES, Satellite
from satid_gym.vector import SatInertiaIDVectorEnv


def section_table(section: str) -> str:
    """The table below a heading of `SatInertiaIDEnv`'s docstring; names in the first column become code.

    Raises:
        ValueError: the docstring has no such section, or no table in it.
    """
    _, _, rest = (inspect.getdoc(SatInertiaIDEnv) or "").partition(f"## {section}\n")
    rows = [
        [cell.strip() for cell in line.strip("|").split(" | ")]
        for line in rest.partition("\n## ")[0].splitlines()
        if line.startswith("| ")
    ]
    if not rows:
        raise ValueError(f"the docstring of SatInertiaIDEnv has no table in a section {section!r}")
    head, *body = rows
    return table(head, [[_code(names), *cells] for names, *cells in body])


def _code(names: str) -> str:
    return ", ".join(f"`{name}`" for name in names.split(", "))


def vector_arguments() -> str:
    """Arguments that the vector environment alone takes, with their defaults."""
    parsed = docstring_parser.parse(inspect.getdoc(SatInertiaIDVectorEnv) or "", docstring_parser.DocstringStyle.GOOGLE)
    said = {p.arg_name: " ".join((p.description or "").split()).removesuffix(".") for p in parsed.params}
    shared = inspect.signature(SatInertiaIDEnv).parameters
    own = {n: p for n, p in inspect.signature(SatInertiaIDVectorEnv).parameters.items() if n not in shared}
    rows = [[f"`{name}`", _shown(p.default), said[name]] for name, p in own.items()]
    return table(["argument", "default", "meaning"], rows)


def _shown(value: object) -> str:
    return str(getattr(value, "name", value))


def satellites() -> str:
    """Every satellite, quantity by quantity."""
    quantities: list[tuple[str, Callable[[Satellite], Any]]] = [
        ("mass, kg", lambda s: s.mass),
        ("size, m", lambda s: s.size),
        ("nominal principal moments, kg m^2", lambda s: np.diag(s.inertia)),
        ("wheels", lambda s: s.wheels.count),
        ("wheel torque limit, N m", lambda s: s.wheels.max_torque[0]),
        ("wheel speed limit, rad/s", lambda s: s.wheels.max_speed[0]),
        ("wheel spin inertia, kg m^2", lambda s: s.wheels.inertia[0]),
        ("body rate limit, rad/s", lambda s: s.rate_limit),
        ("gyro noise per sample, rad/s", lambda s: s.gyro_noise_std),
        ("tachometer noise per sample, rad/s", lambda s: s.tachometer_noise_std),
        ("disturbance, standard deviation about each axis, N m", lambda s: s.disturbance_std),
    ]
    rows = [[name, *(_numbers(of(s)) for s in SATELLITES.values())] for name, of in quantities]
    return table(["", *SATELLITES], rows)


def _numbers(value: Any) -> str:
    return "-" if value is None else " ".join(f"{v:g}" for v in np.atleast_1d(value))
