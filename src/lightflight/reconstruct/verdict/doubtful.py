"""Corners, legs and bends that nobody told and that an error of the set-up may have drawn.

A clock whose codes are longer, or a medium told wrong, bends the times along a leg; a corner more
takes that up, and all tests of the longer path pass; glass in the beam makes the light late from
one place on, as a short leg in depth does. So where light turns by little, or about a leg that is
all but unseen, the path without those corners is fitted as well, and each cause freed in it: where
one explains the recording as well as the corners do, they are in doubt. A bent leg always is: light
that is slower on a leg bends its times as a curve in depth does, a lens bows its line.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from lightflight.path.light_path import LightPath
from lightflight.path.tree import starts_of
from lightflight.path.verdict import Finding, FindingName, Level, Verdict, noted
from lightflight.reconstruct.fit.joint import JointFit, pulses_of_legs
from lightflight.reconstruct.fit.least_squares import OUTLIER
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.trials.outcome import NoFit
from lightflight.reconstruct.trials.revise import refitted, setting_without
from lightflight.reconstruct.verdict.detours import FEW_PULSES
from lightflight.reconstruct.verdict.evidence import MOST_NAMED, WITHIN, Evidence
from lightflight.reconstruct.verdict.geometry_tests import evidence_from_geometry, stated_solution
from lightflight.reconstruct.verdict.glass import findings_of_slabs, legs_between_corners
from lightflight.reconstruct.verdict.judge import best_of_each
from lightflight.reconstruct.verdict.lost import cost_of_pulses, freed_one_by_one

_SHALLOW_DEG = 30.0
"""Corners that turn by more are not asked about, deg: errors of plausible size bend a leg by up to
14 degrees in the tests' worlds. It costs a fit for each corner and decides nothing else."""
_SURELY_A_LEG = 3.0
"""A leg is longer than nothing where its length is this many of its standard errors."""
_OF_A_CORNER = 3
"""Parameters that a corner brings: its place."""


def verdict_with_doubtful_corners(
    verdict: Verdict, fit: JointFit, sightings: list[Sighting], setting: Setting
) -> Verdict:
    """The verdict, "check" where a corner may be an error of the set-up.

    Parameters
    ----------
    verdict : Verdict
        On the path as it was found; only one of "trust" can change.
    fit : JointFit
        The path; its number of legs was not told.
    sightings : list of Sighting
        Its recordings.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    Verdict
        With the causes that explain the recording as well as the corner.
    """
    if verdict.level is not Level.TRUST:
        return verdict
    corners, causes = causes_instead_of_corners(fit, sightings, setting)
    if not causes:
        return verdict
    findings = tuple(_finding(one, corners, fit.solution.state) for one in causes[:MOST_NAMED])
    return replace(verdict, level=Level.CHECK, findings=findings)


def causes_instead_of_corners(
    fit: JointFit, sightings: list[Sighting], setting: Setting
) -> tuple[tuple[int, ...], list[Evidence]]:
    """Corners that errors of the set-up explain as well, and those errors, the best first.

    Parameters
    ----------
    fit : JointFit
        The path; its number of legs was not told.
    sightings : list of Sighting
        Its recordings.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    corners : tuple of int
        Numbers of their vertices.
    causes : list of Evidence
        Empty where none are in doubt.
    """
    asked = corners_asked_about(fit, setting.told_vertices)
    if not asked:
        return (), []
    # In even light, as the paths without: unequal pixels would take up what a corner explains.
    plain = refitted(sightings, fit.solution.state, setting)
    longer = fit if isinstance(plain, NoFit) else plain
    for corners in asked:
        causes = _causes_instead(corners, longer, sightings, setting)
        if causes:
            return corners, causes
    return (), []


def corners_asked_about(fit: JointFit, told: Collection[int]) -> tuple[tuple[int, ...], ...]:
    """Corners that may be taken out together: shallow ones, and both of a leg all but unseen.

    Parameters
    ----------
    fit : JointFit
        The path.
    told : collection of int
        Vertices that were told (`Setting.told_vertices`): these are none.

    Returns
    -------
    tuple of tuple of int
        Numbers of their vertices.
    """
    state = fit.solution.state
    open_ = [k for k in state.corners_seen if state.as_told(k) not in told]
    shallow = tuple(k for k in open_ if state.turn_deg(k) < _SHALLOW_DEG)
    weak = (state.seen[k] for k in np.flatnonzero(pulses_of_legs(fit) <= FEW_PULSES))
    about = (tuple(k for k in open_ if k in (state.leg_starts[leg], leg + 1)) for leg in weak)
    groups = (shallow, *about, *((k,) for k in shallow))
    return tuple(dict.fromkeys(group for group in groups if group))


def verdict_with_doubtful_legs(verdict: Verdict, path: LightPath) -> Verdict:
    """The verdict, "check" where a leg between corners may be none.

    Parameters
    ----------
    verdict : Verdict
        On the path as it was found; only one of "trust" can change.
    path : LightPath
        Its number of legs was not told.

    Returns
    -------
    Verdict
    """
    if verdict.level is not Level.TRUST:
        return verdict
    findings = (*_none_perhaps(path), *findings_of_slabs(path))
    level = Level.CHECK if findings else verdict.level
    return replace(verdict, level=level, findings=(*verdict.findings, *findings))


def _none_perhaps(path: LightPath) -> tuple[Finding, ...]:
    """That legs may be none; () where all are surely legs."""
    which = " and ".join(
        f"leg {leg + 1} is {length_mm:.2g} mm long, known to ± {std_mm:.2g} mm"
        for leg, length_mm, std_mm in legs_that_may_be_none(path)
    )
    said = f"{which}: it may be none, but light that is late behind glass, or a clock that is off"
    remedy = "say how many legs there are (n_legs, --n-legs)"
    name = FindingName.LEG_COUNT
    return (noted(name, said, remedy),) if which else ()


def legs_that_may_be_none(path: LightPath) -> list[tuple[int, float, float]]:
    """Legs between corners that are not clearly longer than nothing: number, length, its std, mm.

    A leg whose two corners lie within three standard errors of each other was not seen as one: what
    it explains may be a delay.
    """
    found, starts = [], starts_of(path)
    for leg in sorted(legs_between_corners(path)):
        ends = starts[leg], leg + 1
        step = path.vertices_mm[ends[1]] - path.vertices_mm[ends[0]]
        length_mm = float(np.linalg.norm(step))
        rows = np.ravel([np.arange(4 * vertex, 4 * vertex + 3) for vertex in ends])
        along = np.concatenate((-step, step)) / length_mm
        variance = float(along @ path.covariance[np.ix_(rows, rows)] @ along)
        if length_mm**2 < _SURELY_A_LEG**2 * variance:
            found.append((leg, length_mm, float(np.sqrt(variance))))
    return found


def findings_of_bends(fit: JointFit) -> tuple[Finding, ...]:
    """That legs were found bent, which nobody told; () where all are straight.

    Parameters
    ----------
    fit : JointFit
        The path.

    Returns
    -------
    tuple of Finding
        One for all legs.
    """
    bends = fit.solution.state.bends
    if not bends:
        return ()
    sizes = [float(np.linalg.norm(bend.coefficients_mm[:, 0])) for bend in bends]
    found = (f"leg {b.leg + 1} by {size:.2g} mm" for b, size in zip(bends, sizes, strict=True))
    return (
        noted(
            FindingName.CURVED_LEG,
            f"bent, which nobody told: {' and '.join(found)}; light that is slower on a leg, a "
            "lens that bows its line or codes that are uneven look much the same",
            "say that legs may bend (free, --free bend), or calibrate lens and codes",
        ),
    )


def findings_of_depth(setting: Setting) -> tuple[Finding, ...]:
    """That depth rests on legs being straight, or bent as found, where they may bend as they like.

    With nothing told of the source the times of a leg tell how far away it is by how they curve
    along it, and so does a bend.

    Parameters
    ----------
    setting : Setting
        Of legs that may be curves.

    Returns
    -------
    tuple of Finding
        () where a source is told, or the curves.
    """
    if setting.source.position_mm is not None or setting.curves:
        return ()
    return (
        noted(
            FindingName.CURVED_LEG,
            "legs may bend, and nothing is told of the source: a bend in depth, and how far away "
            "the whole path is, look the same",
            "tell where the pulse sets out (source), or where the curve runs (curves)",
        ),
    )


def _causes_instead(
    corners: tuple[int, ...], longer: JointFit, sightings: list[Sighting], setting: Setting
) -> list[Evidence]:
    """Causes that explain the recording without these corners as well as it is with them."""
    state = longer.solution.state
    narrowed = setting_without(setting, [state.as_told(corner) for corner in corners])
    shorter = refitted(sightings, state.without(corners), narrowed)
    if isinstance(shorter, NoFit):
        return []
    longer_chi2, shorter_chi2 = (
        float(np.sum(stated_solution(one, its).rows ** 2))
        for one, its in ((longer, setting), (shorter, narrowed))
    )
    # A pulse that only one of the two explains counts as much as an outlier may.
    lost = int((longer.times.weight > 0).sum()) - int((shorter.times.weight > 0).sum())
    needed = shorter_chi2 - longer_chi2 + OUTLIER**2 * lost
    needed -= _OF_A_CORNER * len(corners) + WITHIN
    evidence = evidence_from_geometry(shorter, sightings, narrowed)
    causes = [one for one in evidence if not one.symptom]
    enough = [one for one in causes if one.gain > max(needed, 0.0)]
    if not enough and lost > 0:
        # What it is told wrong has cost the shorter path pulses, which no test of the others sees.
        near = [one for one in causes if one.gain > max(needed - OUTLIER**2 * lost, 0.0)]
        worth = cost_of_pulses(longer, sightings) + _OF_A_CORNER * len(corners) + WITHIN
        enough = _with_pulses_back(near, shorter, worth, sightings, narrowed)
    return best_of_each(sorted(enough, key=lambda one: -one.gain))


def _with_pulses_back(
    causes: list[Evidence], fit: JointFit, worth: float, sightings: list[Sighting], setting: Setting
) -> list[Evidence]:
    """Those of some causes with which, freed in a fit of their own, a path costs no more."""
    found, named = [], {one.name: one for one in causes}
    for name, n_freed, there, seen in freed_one_by_one(sightings, setting):
        if name not in named:
            continue
        trial = refitted(seen, fit.solution.state, there)
        if not isinstance(trial, NoFit) and cost_of_pulses(trial, seen) + n_freed < worth:
            found.append(named[name])
    return found


def _finding(cause: Evidence, corners: tuple[int, ...], state: PathState) -> Finding:
    turns = " and ".join(f"{state.turn_deg(k):.2g}°" for k in corners)
    which = " and ".join(str(k) for k in corners)
    many = len(corners) > 1
    return noted(
        cause.name,
        f"{cause.sentence}, or light that turns by {turns} at corner{'s' if many else ''} "
        f"{which}: both explain the recording",
        f"{cause.remedy}; or say how many legs there are (n_legs, --n-legs)",
    )
