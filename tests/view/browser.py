"""A real browser for the page's tests: Chromium, offline, software graphics.

Set LIGHTFLIGHT_CHROMIUM to its path where it is not on PATH. LIGHTFLIGHT_NEED_BROWSER=1 turns the
skip into a failure (continuous integration); LIGHTFLIGHT_SCREENSHOTS names a folder to keep
screenshots in.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-dev-shm-usage",
]

READY_MS = 120_000


def no_browser(reason: str) -> None:
    """Skip the test, or fail where a browser is demanded."""
    if os.environ.get("LIGHTFLIGHT_NEED_BROWSER") == "1":
        pytest.fail(f"a browser is demanded, but {reason}")
    pytest.skip(f"{reason}: the page is not tested in a browser")


def chromium_path() -> str:
    """Path of Chromium; skips without it."""
    named = os.environ.get("LIGHTFLIGHT_CHROMIUM")
    found = named or next(
        (p for n in ("chromium", "chromium-browser", "google-chrome") if (p := shutil.which(n))),
        None,
    )
    if found is None or not Path(found).exists():
        no_browser("Chromium was not found (LIGHTFLIGHT_CHROMIUM names it)")
    return str(found)


@contextmanager
def started_browser() -> Iterator[Any]:
    """Chromium, for all tests of a module."""
    executable = chromium_path()
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        no_browser("Playwright is not installed")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=executable, headless=True, args=ARGUMENTS
        )
        yield browser
        browser.close()


class OpenPage:
    """One page, open, with a record of everything it should not do."""

    def __init__(self, browser: Any, file: Path, **options: Any) -> None:
        settings = {"viewport": {"width": 1280, "height": 900}, "offline": True, **options}
        self.context = browser.new_context(**settings)
        self.page = self.context.new_page()
        self.errors: list[str] = []
        self.requests: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(f"page: {error}"))
        self.page.on("console", self._hear)
        self.page.on("request", self._count)
        self.page.goto(file.as_uri())
        self.page.wait_for_selector("html[data-ready=yes]", timeout=READY_MS)

    def _hear(self, message: Any) -> None:
        if message.type == "error":
            self.errors.append(f"console: {message.text}")

    def _count(self, request: Any) -> None:
        if not request.url.startswith(("file:", "data:", "blob:")):
            self.requests.append(request.url)

    def run(self, script: str, argument: Any = None) -> Any:
        """Value of a JavaScript expression or function in the page."""
        return self.page.evaluate(script, argument)

    def until(self, expression: str) -> None:
        """Wait until a JavaScript expression is true.

        Polled from here: Playwright's own waiting evaluates text, which the page's policy forbids.
        """
        end = time.monotonic() + READY_MS / 1000
        while not self.page.evaluate(expression):
            if time.monotonic() > end:
                raise TimeoutError(f"never became true in the page: {expression}")
            self.page.wait_for_timeout(30)

    def settle(self) -> None:
        """Wait until the pulse drawn in space is where the state says."""
        self.until(
            """(() => {
              const [centre] = lightflight.marks()["pulse centre"] || [];
              const place = lightflight.current().place;
              return !centre || centre.every((x, i) => Math.abs(x - place[i]) < 1e-9);
            })()"""
        )

    def slide(self, value: float) -> None:
        """Move the slider as a hand would: set it and fire `input`."""
        self.run(
            """(value) => {
              const slider = document.getElementById("time");
              slider.value = String(value);
              slider.dispatchEvent(new Event("input", { bubbles: true }));
            }""",
            value,
        )
        self.settle()

    def marks(self, name: str) -> Any:
        """Points (n, 3), mm, of what moves in the drawing of the space, by its name."""
        return np.array(self.run("(name) => lightflight.marks()[name]", name), dtype=float)

    def plot(self, node: str) -> list[dict[str, Any]]:
        """What a plot shows: x, y and kind of every series."""
        drawn: list[dict[str, Any]] = self.run(
            """(id) => lightflight.plots[id].data.map((one) => ({ kind: one.kind,
              x: [...(one.x || one.left)], right: [...(one.right || [])], y: [...one.y] }))""",
            node,
        )
        return drawn

    def shot(self, name: str) -> None:
        """Keep a screenshot of the whole page where LIGHTFLIGHT_SCREENSHOTS asks for it."""
        folder = os.environ.get("LIGHTFLIGHT_SCREENSHOTS")
        if folder:
            Path(folder).mkdir(parents=True, exist_ok=True)
            self.page.wait_for_timeout(1500)
            self.page.screenshot(path=str(Path(folder) / f"{name}.png"), full_page=True)

    def close(self) -> None:
        """Close it; it must have been quiet."""
        self.context.close()
        assert self.errors == []
        assert self.requests == []
