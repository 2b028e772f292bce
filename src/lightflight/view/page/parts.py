"""What all pages share: style, script, and the policy that lets just these in.

A page holds them itself (`whole_frame`), or names the files beside it that do (`SHARED`, written by
`write_parts`); `whole_html` makes the one of the other.
"""

from __future__ import annotations

import base64
import hashlib
import html
import re
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from lightflight.errors import FileFormatError
from lightflight.files.filecheck import readable_file
from lightflight.files.whole_file import write_text
from lightflight.view.types import FilePath

SCRIPTS = (
    "data.js", "eye.js", "ticks.js", "scene.js", "space.js", "plot.js", "picture.js", "panels.js",
    "pixel.js", "main.js",
)  # fmt: skip
"""In this order; each uses what stands before it."""

STYLE_FILE, SCRIPT_FILE = "page.css", "page.js"
"""Names of the shared parts in the folder of the pages that use them."""


@dataclass(frozen=True)
class Frame:
    """What stands around the data of a page, as HTML.

    Attributes
    ----------
    policy : str
        Value of the content security policy, escaped.
    style : str
        Element that brings the style.
    script : str
        Element that brings the script.
    """

    policy: str
    style: str
    script: str


def _policy(script: str, style: str) -> str:
    """Content security policy, escaped: these sources of script and style, and nothing else."""
    rules = (
        "default-src 'none'",
        f"script-src {script}",
        f"style-src {style}",
        "img-src data: blob:",
        "base-uri 'none'",
        "form-action 'none'",
    )
    return html.escape("; ".join(rules), quote=True)


# Opened from a folder, a page has no origin of its own: `file:` is what lets its neighbours in.
SHARED = Frame(
    _policy("'self' file:", "'self' file:"),
    f'<link rel="stylesheet" href="{STYLE_FILE}">',
    f'<script src="{SCRIPT_FILE}"></script>',
)
"""The frame of a page whose parts lie beside it."""


def asset(name: str) -> str:
    """Text of one file of the page's folder.

    Parameters
    ----------
    name : str
        The file.
    """
    return files("lightflight.view.page").joinpath(name).read_text(encoding="utf-8")


def page_script() -> str:
    """The scripts as one, safe inside a script element."""
    body = "\n".join(asset(name) for name in SCRIPTS)
    # One closed function in strict mode: nothing of the page becomes a global name.
    return _inline(f'(() => {{\n"use strict";\n{body}\n}})();')


def _inline(script: str) -> str:
    """A script that an HTML parser passes on unchanged: no early end, no carriage returns."""
    text = script.replace("\r\n", "\n").replace("\r", "\n")
    # An HTML parser ends a script at its closing tag, even inside a string.
    text = re.sub(r"</(?=script)", r"<\\/", text, flags=re.IGNORECASE)
    return text.replace("<!--", "<\\!--")


def script_hash(script: str) -> str:
    """A script as the policy names it.

    Parameters
    ----------
    script : str
        Text between the tags.
    """
    digest = hashlib.sha256(script.encode("utf-8", "replace")).digest()
    return f"'sha256-{base64.b64encode(digest).decode('ascii')}'"


def whole_frame(style: str, script: str) -> Frame:
    """The frame of a page that holds its parts itself.

    Parameters
    ----------
    style : str
        The style sheet.
    script : str
        The script, as `page_script` gives it.
    """
    policy = _policy(script_hash(script), "'unsafe-inline'")
    return Frame(policy, f"<style>{style}</style>", f"<script>{script}</script>")


def write_parts(folder: FilePath) -> None:
    """Write style and script for the pages of a folder.

    Parameters
    ----------
    folder : path
        An existing folder.
    """
    write_text(Path(folder) / STYLE_FILE, asset("page.css"))
    write_text(Path(folder) / SCRIPT_FILE, page_script())


def whole_html(file: FilePath) -> str:
    """A page of a campaign as one text that needs no file beside it.

    Parameters
    ----------
    file : path
        A page that `lightflight view` wrote; one that is whole already is given as it is.

    Raises
    ------
    FileFormatError
        If it is missing or no such page, or the parts beside it are missing.
    """
    page = Path(file)
    try:
        text = readable_file(page).read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise _no_page(page) from error
    if '<meta name="generator" content="lightflight ' not in text or 'id="payload"' not in text:
        raise _no_page(page)
    if SHARED.script not in text:
        return text
    own = (SHARED.policy, SHARED.style, SHARED.script)
    if any(text.count(part) != 1 for part in own):
        raise _no_page(page)
    frame = whole_frame(_beside(page, STYLE_FILE), _inline(_beside(page, SCRIPT_FILE)))
    for part, whole in zip(own, (frame.policy, frame.style, frame.script), strict=True):
        text = text.replace(part, whole)
    return text


def _no_page(page: Path) -> FileFormatError:
    return FileFormatError(
        "is no page of a path: give one that `lightflight view` or `batch` wrote", path=page
    )


def _beside(page: Path, name: str) -> str:
    part = page.parent / name
    if not part.is_file():
        raise FileFormatError(
            f"needs {name} beside it, which the pages of its campaign share: take it from the "
            "folder it was written to",
            path=page,
        )
    return part.read_text(encoding="utf-8")
