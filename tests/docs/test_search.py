"""Search works from a folder, without a network: words of a page lead to it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest


@pytest.mark.parametrize(
    ("words", "page"),
    [("half-angle", "observer.html"), ("clock_drift", "what-can-go-wrong.html")],
)
def test_search_finds_a_page_from_a_file(
    chromium: Any, built_pages: Path, words: str, page: str
) -> None:
    context = chromium.new_context(offline=True)
    asked: list[str] = []
    opened = context.new_page()
    opened.on("request", lambda request: asked.append(request.url))
    opened.goto(f"{(built_pages / 'search.html').as_uri()}?q={words}")
    found = opened.locator("#search-results li a").first
    found.wait_for(timeout=60_000)
    links = opened.locator("#search-results li a").evaluate_all("all => all.map((a) => a.href)")
    context.close()
    assert any(page in link for link in links), links
    assert all(url.startswith(("file:", "data:", "blob:")) for url in asked)
