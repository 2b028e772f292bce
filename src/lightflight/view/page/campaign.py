"""An index page over many reconstructions: one small picture and one line of numbers each.

Takes path files, gives an HTML file and, in a folder beside it, a page for each. The pictures are
SVG made from the paths themselves, all to the same scale; scripts are not needed.
"""

from __future__ import annotations

import html
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from lightflight._version import __version__
from lightflight.display import number, with_error
from lightflight.files.whole_file import write_text
from lightflight.path.light_path import LightPath
from lightflight.path.trace import trace_from_path
from lightflight.path.tree import starts_of, ways
from lightflight.path.verdict import Level
from lightflight.view.page.build import framed_page
from lightflight.view.page.parts import SHARED, write_parts
from lightflight.view.page.tables import badge_html, heading
from lightflight.view.types import FilePath, Floats
from lightflight.view.viewpoint import Viewpoint

if TYPE_CHECKING:
    from lightflight import TimingCalibration


_WIDTH, _HEIGHT, _PAD = 260.0, 150.0, 10.0

_STYLE = """
:root { --paper:#f4f5f7; --card:#fff; --ink:#1a2130; --quiet:#5b6575; --hair:#dde1e7;
  --event:#c8440a; color-scheme: light dark; }
@media (prefers-color-scheme: dark) { :root { --paper:#0d111a; --card:#151b28; --ink:#e8ecf3;
  --quiet:#9aa6b8; --hair:#2a3345; --event:#ff8f52; } }
body { margin:0 auto; max-width:1280px; padding:20px 16px 40px; background:var(--paper);
  color:var(--ink); font:15px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,sans-serif;
  font-variant-numeric:tabular-nums; }
h1 { font-size:24px; margin:0 0 4px; } p { margin:0 0 16px; color:var(--quiet); }
ul { list-style:none; margin:0; padding:0; display:grid; gap:14px;
  grid-template-columns:repeat(auto-fill,minmax(min(270px,100%),1fr)); }
li { background:var(--card); border:1px solid var(--hair); border-radius:10px; padding:12px; }
li:hover { border-color:var(--quiet); }
a { color:inherit; text-decoration:none; display:block; }
a:focus-visible { outline:2.5px solid #0b63ce; outline-offset:3px; }
svg { width:100%; height:auto; display:block; }
h2 { font-size:15px; margin:6px 0 2px; overflow-wrap:anywhere; }
dl { display:grid; grid-template-columns:auto 1fr; gap:0 12px; margin:0; font-size:13px; }
dt { color:var(--quiet); } dd { margin:0; }
.bad { color:var(--event); }
.badge { display:inline-block; border-radius:6px; padding:0 9px; }
.badge.trust { background:#1d7044; color:#fff; }
.badge.check { background:#ffd24d; color:#1a2130; }
.badge.contradicted { background:#b3261e; color:#fff; }
"""


def write_campaign(
    path_files: Sequence[FilePath],
    file: FilePath,
    *,
    timing: TimingCalibration | None = None,
    title: str = "",
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write an index of many paths, and a page for each in the folder `<name>_pages` beside it.

    The pages share one style and one script in that folder; `lightflight view PAGE.html` makes any
    of them whole. A path file that cannot be read gets an entry that says why; the others are not
    held up.

    Parameters
    ----------
    path_files : sequence of paths
        Path files of `LightPath.save`.
    file : path
        Index to write, .html.
    timing : TimingCalibration, optional
        Calibration they share, if any.
    title : str, optional
        Heading.
    progress : callable, optional
        Called with (done, in all).
    """
    index = Path(file)
    folder = index.parent / f"{index.stem}_pages"
    folder.mkdir(exist_ok=True)
    write_parts(folder)
    entries: list[tuple[str, LightPath | str, str]] = []
    for k, source in enumerate(path_files):
        name = os.fspath(source)
        try:
            path = LightPath.load(source)
        # One damaged file of hundreds must not cost the others.
        except (ValueError, OSError) as error:
            entries.append((name, str(error), ""))
        else:
            page = f"{k + 1:04d}.html"
            title_of_page = f"{heading(path)}: {Path(name).name}"
            text = framed_page(path, SHARED, timing=timing, title=title_of_page)
            write_text(folder / page, text)
            entries.append((name, path, f"{folder.name}/{page}"))
        if progress is not None:
            progress(k + 1, len(path_files))
    write_text(index, campaign_html(entries, title=title))


def campaign_html(entries: Sequence[tuple[str, LightPath | str, str]], *, title: str = "") -> str:
    """The index as text.

    Parameters
    ----------
    entries : sequence of (str, LightPath or str, str)
        (name, LightPath or why there is none, link to its page) each.
    title : str, optional
        Heading.
    """
    paths = [entry[1] for entry in entries if not isinstance(entry[1], str)]
    words = title or f"{len(entries)} reconstructions"
    frame = _common_frame(paths)
    names = _short_names([entry[0] for entry in entries])
    items = "\n".join(
        _item(name, entry[1], entry[2], frame) for name, entry in zip(names, entries, strict=True)
    )
    bad = len(entries) - len(paths)
    levels = [path.verdict.level for path in paths]
    verdicts = ", ".join(
        f"{levels.count(level)} {badge_html(level)}" for level in Level if level in levels
    )
    said = (
        f"{verdicts}." if verdicts else "",
        "All pictures to one scale.",
        f"{bad} could not be read." if bad else "",
    )
    note = " ".join(filter(None, said))
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta http-equiv="Content-Security-Policy" content="default-src &#x27;none&#x27;; '
        'style-src &#x27;unsafe-inline&#x27;">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<meta name="generator" content="lightflight {html.escape(__version__)}">'
        f"<title>{html.escape(words)}</title><style>{_STYLE}</style></head>\n"
        f"<body><h1>{html.escape(words)}</h1><p>{note}</p>\n"
        f"<ul>\n{items}\n</ul></body></html>\n"
    )


def _short_names(names: Sequence[str]) -> list[str]:
    """File names without their folders; with the last one where names repeat."""
    last = [Path(name).name for name in names]
    return [
        short if last.count(short) == 1 else "/".join(Path(name).parts[-2:])
        for name, short in zip(names, last, strict=True)
    ]


def _on_page(points: ArrayLike) -> Floats:
    """World points (n, 3), mm, in parallel projection; y grows downwards, as SVG counts."""
    # y grows downwards in SVG.
    return Viewpoint().project(points) * (1.0, -1.0)


def _common_frame(paths: Sequence[LightPath]) -> tuple[Floats, float]:
    """Middle (2,) and scale (pixels per mm) that hold every path."""
    every = [_on_page(path.vertices_mm) for path in paths]
    points = np.concatenate(every) if every else np.zeros((1, 2))
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) == 0:
        points = np.zeros((1, 2))
    low, high = points.min(axis=0), points.max(axis=0)
    room = np.array([_WIDTH, _HEIGHT]) - 2 * _PAD
    scale = float((room / np.maximum(high - low, 1e-6)).min())
    # Without a path, or with one of no extent, any finite scale will do.
    return (low + high) / 2, min(scale, 1e3)


def _item(name: str, path: LightPath | str, link: str, frame: tuple[Floats, float]) -> str:
    if isinstance(path, str):
        return f'<li><h2>{html.escape(name)}</h2><p class="bad">{html.escape(path)}</p></li>'
    facts = "".join(
        f"<dt>{html.escape(term)}</dt><dd>{html.escape(text)}</dd>" for term, text in _facts(path)
    )
    return (
        f'<li><a href="{html.escape(link, quote=True)}">{_picture(path, name, frame)}'
        f"<h2>{html.escape(name)} {badge_html(path.verdict.level)}</h2><dl>{facts}</dl></a></li>"
    )


def _facts(path: LightPath) -> list[tuple[str, str]]:
    goodness = path.goodness
    angles = ", ".join(
        with_error(leg.angle_deg, leg.angle_std_deg) for leg in path.legs[:3] if leg.seen
    )
    names = ", ".join(finding.name for finding in path.verdict.findings)
    facts = [("findings", names)] if names else []
    facts += [
        ("legs", _legs_in_words(path)),
        ("elevation", f"{angles}\u00b0" + (" \u2026" if path.n_legs > 3 else "")),
        ("\u03c7\u00b2/dof", number(goodness.reduced_chi2, 3)),
        ("pulses", str(goodness.n_pulses))
        if path.explained is None
        else ("explains", str(path.explained)),
    ]
    if not goodness.converged:
        facts.append(("warning", "the fit did not converge"))
    return facts


def _legs_in_words(path: LightPath) -> str:
    """How many there are, how many of them nobody saw, and on how many branches."""
    unseen = f", {len(path.unseen_legs)} unseen" if path.gaps else ""
    return f"{path.n_legs}{unseen}" + (f", {len(path.ends) - 1} branches" if path.forks else "")


def _picture(path: LightPath, name: str, frame: tuple[Floats, float]) -> str:
    middle, scale = frame

    def placed(points: ArrayLike) -> Floats:
        center = np.array([_WIDTH, _HEIGHT]) / 2
        return np.asarray((_on_page(points) - middle) * scale + center)

    def line(points: ArrayLike, style: str) -> str:
        flat = placed(points)
        flat = flat[np.isfinite(flat).all(axis=1)]
        text = " ".join(f"{x:.1f},{y:.1f}" for x, y in flat)
        return f'<polyline points="{text}" fill="none" {style}/>'

    parts = []
    if path.truth is not None:
        dashed = 'stroke="var(--quiet)" stroke-width="1.2" stroke-dasharray="4 3"'
        vertices, starts = np.asarray(path.truth.vertices_mm, dtype=float), starts_of(path.truth)
        parts += [line(vertices[[0, *(leg + 1 for leg in way)]], dashed) for way in ways(starts)]
    for leg in path.legs:
        dots = "" if leg.seen else ' stroke-dasharray="1 4"'
        ends = np.array([leg.start_mm, leg.end_mm])
        if leg.course is not None:
            ends = leg.course.points_mm(np.linspace(0.0, 1.0, 33))
        parts.append(line(ends, f'stroke="var(--event)" stroke-width="1.2"{dots}'))
    trace = trace_from_path(path, per_leg=33)
    for leg in np.unique(trace.leg):
        seen = trace.points_mm[(trace.leg == leg) & trace.in_view]
        if len(seen) > 1:
            ends = seen if path.legs[int(leg)].course is not None else seen[[0, -1]]
            wide = 'stroke="var(--event)" stroke-width="3" stroke-linecap="round"'
            parts.append(line(ends, wide))
    x, y = placed(path.vertices_mm[:1])[0]
    if np.isfinite([x, y]).all():
        parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.2" fill="var(--ink)"/>')
    label = html.escape(f"path of {Path(name).name}", quote=True)
    return (
        f'<svg viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" role="img" aria-label="{label}">'
        + "".join(parts)
        + "</svg>"
    )
