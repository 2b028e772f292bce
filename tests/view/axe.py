"""axe-core in a page: what would keep somebody from using it.

The script comes with the package axe-playwright-python. It is evaluated in the page, so that one
whose policy allows no other script can be checked, too.
"""

from __future__ import annotations

from importlib.resources import files
from typing import Any

import pytest


def barriers(page: Any) -> list[str]:
    """Serious and critical findings of axe-core: rule, and where."""
    pytest.importorskip("axe_playwright_python", reason="axe-core is not installed")
    script = files("axe_playwright_python").joinpath("axe.min.js").read_text(encoding="utf-8")
    page.evaluate(f"() => {{ {script} }}")
    found = page.evaluate("async () => (await axe.run()).violations")
    return [
        f"{one['id']}: {node['target']}"
        for one in found
        if one["impact"] in ("serious", "critical")
        for node in one["nodes"]
    ]
