"""Layout of the sources: the wall, the direction of imports, rooms of limited size, and the look of every module.

Every check takes a folder and returns its faults, one line each, so that it is tried on a wrong tree as well.
"""

from __future__ import annotations

import ast
import functools
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("satid_gym", "baselines", "agents")
FOREIGN = {  # what a package or a part of one may not import
    "satid_gym": ("baselines", "agents", "torch", "stable_baselines3", "ray"),
    "baselines": ("agents", "torch", "stable_baselines3", "ray"),
    "baselines.studies": ("baselines.scenarios",),
    "agents": ("ray",),
}
DOORS = {  # the one place of a package that may
    ("satid_gym.sb3", "stable_baselines3"),
    ("satid_gym.rllib", "ray"),
    ("baselines.command.cluster", "ray"),
}
TRUTH, BELIEF = "satid_gym.core.truth", "satid_gym.core.belief"
QUESTIONS = ("What", "How", "Where", "Which", "From", "Does")
JITTED = ("kernel", "inline", "inline_disjoint", "outline", "outline_disjoint")
LINES_MAX, MODULES_MAX, ARGUMENTS_MAX = 250, 10, 8
LONGER = {  # files of more than 250 lines, and why
    "satid_gym/env.py": "the docstring is the environment's specification",
    "satid_gym/vector.py": "likewise, and reset and step in every mode of autoreset",
    "agents/benchmark/acceptance.py": "claim by claim, each with its measure and its text",
    "satid_gym/onboard/pilot.py": "the one class that a control loop calls",
}


def within(name: str, package: str) -> bool:
    return name == package or name.startswith(f"{package}.")


@functools.cache
def trees(root: Path) -> dict[str, tuple[Path, ast.Module]]:
    """Modules of the three packages below a folder by their dotted names: path and syntax tree."""
    found = {}
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            found[name] = path.relative_to(root), ast.parse(path.read_text(encoding="utf-8"))
    return found


def statements(node: ast.AST, deep: bool) -> Iterator[ast.stmt]:
    """Imports of a module; without `deep` those alone that run when it is imported."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, (ast.Import, ast.ImportFrom)):
            yield child
        elif isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING":
            continue
        elif deep or not isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef)):
            yield from statements(child, deep)


def imports(root: Path, deep: bool = True) -> dict[str, set[str]]:
    """Names that each module imports: submodules where there are such, packages of others by their first name."""
    modules = trees(root)
    graph: dict[str, set[str]] = {}
    for name, (_, tree) in modules.items():
        found = graph[name] = set()
        for statement in statements(tree, deep):
            if isinstance(statement, ast.Import):
                found |= {alias.name for alias in statement.names}
                continue
            assert statement.level == 0, f"{name}: imports are absolute"
            home = statement.module or ""
            found |= {f"{home}.{a.name}" if f"{home}.{a.name}" in modules else home for a in statement.names}
        found.discard(name)
    return graph


def reached(graph: dict[str, set[str]], start: list[str]) -> set[str]:
    """Modules that these import, directly or through others."""
    found, left = set(), list(start)
    while left:
        new = graph.get(left.pop(), set()) - found
        found |= new
        left += new
    return found


def wall(root: Path) -> list[str]:
    graph = imports(root)
    return [
        f"{name} is reached from {side}"
        for side, other in ((TRUTH, BELIEF), (BELIEF, TRUTH))
        for name in sorted(reached(graph, [name for name in graph if within(name, side)]))
        if within(name, other)
    ]


def direction(root: Path) -> list[str]:
    return [
        f"{name} imports {used}"
        for name, found in imports(root).items()
        for used in sorted(found)
        for package, others in FOREIGN.items()
        for foreign in others
        if within(name, package) and within(used, foreign)
        if not any(within(name, door) and foreign == behind for door, behind in DOORS)
    ]


def circles(root: Path) -> list[str]:
    graph = imports(root, deep=False)
    return [f"{name} imports itself through others" for name in graph if name in reached(graph, [name])]


def rooms(root: Path) -> list[str]:
    found: dict[Path, int] = {}
    for path, _ in trees(root).values():
        if path.parts[0] != "satid_gym" and path.name != "__init__.py":
            found[path.parent] = found.get(path.parent, 0) + 1
    return [
        f"{folder} holds {count} modules, more than {MODULES_MAX}"
        for folder, count in found.items()
        if count > MODULES_MAX
    ]


def docstrings(root: Path) -> list[str]:
    found = []
    for path, tree in trees(root).values():
        lines = (ast.get_docstring(tree) or "").splitlines()
        if not lines:
            found.append(f"{path} has no docstring")
        elif path.name == "__init__.py" and len(lines) > 1:
            found.append(f"{path}: a package's docstring is one line")
        elif re.match(rf"({'|'.join(QUESTIONS)})\b", lines[0]):
            found.append(f"{path}: begin with a noun phrase, not with {lines[0].split()[0]!r}")
    return found


def constants(root: Path) -> list[str]:
    return [
        f"{path}: {node.id} is named after a superlative; end it with _MAX or _MIN"
        for path, tree in trees(root).values()
        for node in ast.walk(tree)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
        if re.search(r"(^|_)(MOST|LEAST)(_|$)", node.id)
    ]


def kernels(root: Path) -> list[str]:
    return [
        f"{path}: {node.name} takes {len(node.args.args)} arguments, more than {ARGUMENTS_MAX}"
        for path, tree in trees(root).values()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and len(node.args.args) > ARGUMENTS_MAX
        if {ast.unparse(d) for d in node.decorator_list} & set(JITTED)
    ]


def lengths(root: Path) -> list[str]:
    found = []
    for path, _ in trees(root).values():
        count = len((root / path).read_text(encoding="utf-8").splitlines())
        if count > LINES_MAX and str(path) not in LONGER:
            found.append(f"{path} has {count} lines, more than {LINES_MAX}")
        if count <= LINES_MAX and str(path) in LONGER:
            found.append(f"{path} has {count} lines: take it off the list of longer ones")
    return found


WRONG: dict[Callable[[Path], list[str]], tuple[dict[str, str], str]] = {
    wall: (
        {
            "satid_gym/core/belief/kalman.py": "from satid_gym.core import wheels",
            "satid_gym/core/wheels.py": "def axis():\n    from satid_gym.core.truth import dynamics",
            "satid_gym/core/truth/dynamics.py": "",
        },
        "satid_gym.core.truth.dynamics is reached from satid_gym.core.belief",
    ),
    direction: (
        {
            "satid_gym/env.py": "def fly():\n    import torch.nn",
            "satid_gym/sb3.py": "import stable_baselines3",
            "satid_gym/rllib/policy.py": "import ray",
        },
        "satid_gym.env imports torch.nn",
    ),
    circles: (
        {
            "agents/one.py": "from agents import two",
            "agents/two.py": "import agents.one",
        },
        "agents.one imports itself through others",
    ),
    rooms: ({f"agents/part/m{i}.py": "" for i in range(11)}, "agents/part holds 11 modules, more than 10"),
    docstrings: (
        {"agents/__init__.py": '"""Agents.\n\nAll of them."""', "agents/one.py": '"""How it flies."""'},
        "agents/one.py: begin with a noun phrase, not with 'How'",
    ),
    constants: ({"agents/one.py": "_MOST_STEPS = 3"}, "agents/one.py: _MOST_STEPS is named after a superlative"),
    kernels: (
        {"satid_gym/core/one.py": "@outline\ndef f(a, b, c, d, e, f, g, h, i):\n    pass"},
        "satid_gym/core/one.py: f takes 9 arguments, more than 8",
    ),
    lengths: ({"agents/one.py": "x = 1\n" * 251}, "agents/one.py has 251 lines, more than 250"),
}


@pytest.mark.parametrize("check", WRONG, ids=lambda check: check.__name__)
def test_sources_are_laid_out_as_agreed(check):
    assert check(ROOT) == []


@pytest.mark.parametrize("check", WRONG, ids=lambda check: check.__name__)
def test_a_check_finds_the_fault_of_a_wrong_tree(check, tmp_path):
    files, message = WRONG[check]
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    assert any(fault.startswith(message) for fault in check(tmp_path)), check(tmp_path)
