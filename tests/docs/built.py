"""A few pages of the documentation, built as all of them are, but for the gallery and the API's."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.pages import DOCS

EXTENSIONS = "myst_parser,numpydoc,offline_math"


def build_pages(folder: Path, names: list[str]) -> Path:
    """HTML of some pages with theme, style and search; links to other pages lead nowhere."""
    pytest.importorskip("sphinx", reason="pages are built with the docs extra")
    source, built = folder / "docs", folder / "html"
    for name in names:
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(DOCS / name, source / name)
    for name in ("_static", "_templates", "images"):
        (source / name).symlink_to(DOCS / name)
    words = ["-q", "-b", "html", "-c", str(DOCS), "-D", f"extensions={EXTENSIONS}"]
    made = subprocess.run(
        [sys.executable, "-m", "sphinx", *words, str(source), str(built)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert made.returncode == 0, made.stderr
    return built
