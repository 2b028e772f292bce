"""Pages of the documentation keep nobody out, as far as axe-core can tell."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.docs.conftest import PAGES
from tests.view.axe import barriers


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
@pytest.mark.parametrize("name", PAGES[:2])
def test_a_page_has_no_serious_barrier(
    chromium: Any, built_pages: Path, name: str, width: int, scheme: str
) -> None:
    context = chromium.new_context(
        viewport={"width": width, "height": 800}, color_scheme=scheme, offline=True
    )
    page = context.new_page()
    page.goto((built_pages / name).with_suffix(".html").as_uri())
    page.wait_for_load_state("networkidle")
    found = barriers(page)
    context.close()
    assert found == []


def test_a_barrier_is_noticed(chromium: Any) -> None:
    page = chromium.new_page()
    page.set_content("<html lang='en'><title>x</title><main><button></button></main></html>")
    assert barriers(page) == ["button-name: ['button']"]
    page.close()
