"""A LightPath as a notebook shows it."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from lightflight.display import Card, number, picture_from_vertices, with_error
from lightflight.path.on_bends import drawn_outline_mm

if TYPE_CHECKING:
    from lightflight.path.light_path import LightPath

_MOST_LEGS = 6
"""Legs that have a line of their own."""


def card_of_path(path: LightPath) -> Card:
    """A path as a card: the verdict first, what it is about, and two views of it.

    Parameters
    ----------
    path : LightPath
        The path.
    """
    good = path.goodness
    facts = [
        ("verdict", path.verdict.headline),
        *(("", str(finding)) for finding in path.verdict.findings),
    ]
    if path.explained is not None:
        facts.append(("explains", str(path.explained)))
    facts += [
        ("estimator", path.method),
        ("prior", path.prior or "not said"),
        ("length", f"{number(sum(leg.length_mm for leg in path.legs), 5)} mm, {path.n_legs} legs"),
        ("emission time", f"{with_error(path.emission_time_ps, path.vertex_std[0, 3])} ps"),
    ]
    facts += [
        (f"elevation of leg {k}", f"{with_error(leg.angle_deg, leg.angle_std_deg)}\u00b0")
        if leg.seen
        else (f"leg {k}", "not seen: at least one leg")
        for k, leg in enumerate(path.legs[:_MOST_LEGS], start=1)
    ]
    facts += [(f"out of view after leg {gap.after_leg + 1}", gap.in_words) for gap in path.gaps]
    if path.n_legs > _MOST_LEGS:
        facts.append(("", f"and {path.n_legs - _MOST_LEGS} legs more"))
    facts.append(("\u03c7\u00b2 / dof", good.chi2_in_words))
    if good.error_floor_ps > 0:
        facts.append(("extra scatter", good.floor_in_words))
    if not good.converged:
        facts.append(("converged", "NO: do not trust the errors"))
    facts += [
        ("branches" if k == 0 else "", f"leg {leg + 1} begins at vertex {vertex}")
        for k, (leg, vertex) in enumerate(path.forks)
    ]
    picture = partial(picture_from_vertices, drawn_outline_mm(path))
    return Card("LightPath", facts, picture, "from the front, and from above")
