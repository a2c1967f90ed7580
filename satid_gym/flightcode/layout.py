"""Layout of generated C: lines of limited length."""

from __future__ import annotations

_WIDTH = 116
_BREAKS = (", ", " + ", " - ", " && ", " || ")


def lines_of(text: str) -> str:
    """The text with long lines broken after a comma or before an operator."""
    return "\n".join(part for line in text.split("\n") for part in _broken(line))


def _broken(line: str) -> list[str]:
    lead = line[: len(line) - len(line.lstrip())] + "    "
    parts = []
    while len(line) > _WIDTH:
        places = [(line.rfind(sign, len(lead) + 8, _WIDTH), sign) for sign in _BREAKS]
        at, sign = max(places)
        if at < 0:
            break
        end = at + 1 if sign == ", " else at
        parts.append(line[:end].rstrip())
        line = lead + line[end:].lstrip()
    return [*parts, line]
