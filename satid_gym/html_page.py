"""HTML pages that need nothing from a network: one file, with its style and its pictures in it."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #1b1f24; }
table { border-collapse: collapse; margin: 1rem 0; display: block; overflow-x: auto; }
th, td { padding: .3rem .6rem; border-bottom: 1px solid #d0d7de; text-align: right; }
td { white-space: nowrap; }
th { vertical-align: bottom; }
th:first-child, td:first-child { text-align: left; }
img, video { max-width: 100%; background: white; }
li { margin: .2rem 0; }
@media (prefers-color-scheme: dark) { body { background: #16191d; color: #e6e8ea; } th, td { border-color: #3d444d; } }
"""


def document(title: str, parts: Sequence[str]) -> str:
    """A page of parts that are HTML; the title is text."""
    named = f"<title>{html.escape(title)}</title>"
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width">{named}'
    body = "\n".join(parts)
    return (
        f'<!doctype html>\n<html lang="en"><head>{head}<style>{_STYLE}</style></head>\n<body>\n{body}\n</body></html>\n'
    )


def image(png: bytes, said: str) -> str:
    """A picture in the page, with its description."""
    return f'<img alt="{html.escape(said)}" src="data:image/png;base64,{base64.b64encode(png).decode()}">'


def video(mp4: bytes, said: str) -> str:
    """A video in the page, with its description."""
    source = f'src="data:video/mp4;base64,{base64.b64encode(mp4).decode()}"'
    return f'<video controls aria-label="{html.escape(said)}" {source}></video>'


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of text."""
    top = "".join(f"<th>{html.escape(cell)}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"


def bullets(lines: Sequence[str]) -> str:
    """A list of text; "none" where it is empty."""
    return f"<ul>{''.join(f'<li>{html.escape(line)}</li>' for line in lines) or '<li>none</li>'}</ul>"
