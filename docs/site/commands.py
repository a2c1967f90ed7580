"""Reference of all commands, written while the site is built: every module that is run, with its options.

A command of a few lines that imports its `main` is listed under its own name, with the options of the module that it
imports from. Modules are read, not imported.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator
from pathlib import Path

import griffe

ROOT = Path(__file__).parents[2]
PAGE = "api/commands.md"
PACKAGES = ("agents", "baselines", "satid_gym")
_OPTIONS = re.compile(r"^def main\(\w+: (\w+)[,)]", flags=re.MULTILINE)
_PARSER = re.compile(r"ArgumentParser\(|^if __name__ ==", flags=re.MULTILINE)
_FACE = re.compile(r"^from ([\w.]+) import main$", flags=re.MULTILINE)


def on_page_markdown(markdown: str, page, **_: object) -> str:
    """Called by mkdocs for every page."""
    if page.file.src_uri != PAGE:
        return markdown
    return "\n\n".join([markdown, *(section for package in PACKAGES for section in of(package))])


def of(package: str) -> Iterator[str]:
    """A section for each command of a package."""
    tree = _trees()[package]
    sources = {_name(file): file.read_text(encoding="utf-8") for file in sorted((ROOT / package).rglob("*.py"))}
    faces = {name: face[1] for name, source in sources.items() if (face := _FACE.search(source))}
    for name in sources:
        target = faces.get(name, name)
        if name in faces.values() or target not in sources:
            continue
        found = _OPTIONS.search(sources[target])
        if not found and not _PARSER.search(sources[target]):
            continue
        module = tree[target.removeprefix(f"{package}.")]
        rows = list(_rows(module, module[found[1]])) if found else []
        table = ["| option | default | what |", "|---|---|---|", *rows] if rows else []
        yield "\n".join([f"## {name.removesuffix('.__main__')}", "", module.docstring.value, "", *table])


@functools.cache
def _trees() -> griffe.ModulesCollection:
    """All packages, because options may be classes of another one."""
    loader = griffe.GriffeLoader(search_paths=[ROOT], allow_inspection=False)
    for package in PACKAGES:
        loader.load(package)
    loader.resolve_aliases()
    return loader.modules_collection


def _name(file: Path) -> str:
    return ".".join(file.relative_to(ROOT).with_suffix("").parts)


def _rows(module: griffe.Module, options: griffe.Class) -> Iterator[str]:
    """A row for each field."""
    for field in options.attributes.values():
        if "instance-attribute" not in field.labels:  # a property, or the same for all instances
            continue
        if not field.docstring and field.annotation:  # its fields stand among the options themselves
            nested = next(name for name in re.findall(r"[A-Z]\w+", str(field.annotation)) if name != "Annotated")
            target = module[nested].final_target if module[nested].is_alias else module[nested]
            yield from _rows(target.module, target)
        elif field.docstring:
            flag = field.name if "Positional" in str(field.annotation) else f"--{field.name.replace('_', '-')}"
            if str(field.value).startswith("field("):  # settings with fields of their own
                flag += ".FIELD"
            yield f"| `{flag}` | {_default(field.value)} | {' '.join(field.docstring.value.split())} |"


def _default(value: object) -> str:
    if value is None:
        return "required"
    plain = re.sub(r"^(?:Path\(|field\(default_factory=)(.*)\)$", r"\1", str(value)).strip("'")
    return f"`{plain}`"
