"""Blocks of pages that are written by tools: `<!-- name:begin (...) -->` to `<!-- name:end -->`.

No number between two such marks is ever typed by hand.
"""

from __future__ import annotations

import re
from pathlib import Path


def with_block(text: str, name: str, block: str) -> str:
    """Text with what stands between the marks of a block replaced.

    Raises
    ------
    ValueError
        Where the text has no such block.
    """
    marks = re.compile(
        rf"(<!-- {re.escape(name)}:begin\b[^>]*-->\n).*?(\n<!-- {re.escape(name)}:end -->)",
        re.DOTALL,
    )
    found, n = marks.subn(lambda m: f"{m[1]}\n{block.strip()}\n{m[2]}", text)
    if n != 1:
        raise ValueError(f"{n} blocks named {name!r}, one is wanted")
    return found


def write_block(page: Path, name: str, block: str) -> None:
    """Replace a block of a page."""
    page.write_text(with_block(page.read_text(encoding="utf-8"), name, block), encoding="utf-8")
