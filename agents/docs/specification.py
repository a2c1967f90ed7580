"""Tables of the environment's page, read from the docstrings that specify the environments."""

from __future__ import annotations

import inspect

import docstring_parser

from baselines.command.markdown import table
from satid_gym.env import SatInertiaIDEnv
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
