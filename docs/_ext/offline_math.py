"""Formulas as MathML, which browsers draw themselves: the pages need no network and no script."""

from __future__ import annotations

from typing import Any

import latex2mathml.converter
from docutils import nodes


def inline_formula(writer: Any, node: nodes.math) -> None:
    """Put an inline formula into the page."""
    writer.body.append(latex2mathml.converter.convert(node.astext()))
    raise nodes.SkipNode


def block_formula(writer: Any, node: nodes.math_block) -> None:
    """Put a displayed formula into the page."""
    # A wide formula scrolls on a narrow screen: by keyboard, too.
    formula = latex2mathml.converter.convert(node.astext(), display="block")
    writer.body.append(f'<div class="formula" tabindex="0">{formula}</div>\n')
    raise nodes.SkipNode


def setup(app: Any) -> dict[str, Any]:
    """Register the renderer; `html_math_renderer` in conf.py chooses it."""
    app.add_html_math_renderer("mathml", (inline_formula, None), (block_formula, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
