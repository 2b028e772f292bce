"""Pages built once for all tests, and the browser that opens them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.docs.built import build_pages
from tests.view import browser as br

PAGES = ["index.md", "observer.md", "what-can-go-wrong.md", "explanation/apparent-speed.md"]


@pytest.fixture(scope="session")
def built_pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of HTML with the pages that browser tests open."""
    br.chromium_path()  # without it none of them is opened
    return build_pages(tmp_path_factory.mktemp("built"), PAGES)


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """A browser for a module's tests: one that lived on would forbid another module its own."""
    with br.started_browser() as browser:
        yield browser
