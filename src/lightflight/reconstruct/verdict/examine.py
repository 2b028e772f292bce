"""The verdict on a path that `reconstruct` found: all evidence, weighed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lightflight.errors import GeometryError, NothingFoundError
from lightflight.path.light_path import LightPath
from lightflight.path.verdict import (
    NOT_EXAMINED,
    Finding,
    FindingName,
    Level,
    Verdict,
    noted,
)
from lightflight.reconstruct.fit.fine import with_fine_light
from lightflight.reconstruct.fit.joint import JointFit, fit_joint
from lightflight.reconstruct.legs.direction import search_legs
from lightflight.reconstruct.legs.plausible import implausible
from lightflight.reconstruct.model.geometry import state_of_path
from lightflight.reconstruct.model.glass import with_dark_pieces
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.other_light.around import DrawnOutError
from lightflight.reconstruct.trials.revise import bright_legs
from lightflight.reconstruct.verdict.arms import verdict_with_arm
from lightflight.reconstruct.verdict.bookkeeping import (
    beyond_the_tests,
    evidence_from_flags,
    evidence_of_own_errors,
    noticed,
)
from lightflight.reconstruct.verdict.count_evidence import evidence_from_counts
from lightflight.reconstruct.verdict.detours import findings_of_detours
from lightflight.reconstruct.verdict.doubtful import (
    findings_of_bends,
    findings_of_depth,
    verdict_with_doubtful_corners,
    verdict_with_doubtful_legs,
)
from lightflight.reconstruct.verdict.evidence import Evidence
from lightflight.reconstruct.verdict.geometry_tests import evidence_from_geometry
from lightflight.reconstruct.verdict.going_on import verdict_with_light_going_on
from lightflight.reconstruct.verdict.hidden import (
    evidence_without_hidden,
    findings_of_hidden,
)
from lightflight.reconstruct.verdict.judge import verdict_from_evidence
from lightflight.reconstruct.verdict.lopsided import evidence_of_lopsided_legs
from lightflight.reconstruct.verdict.lost import evidence_from_lost_legs
from lightflight.reconstruct.verdict.taken_up import verdict_with_light_taken_up
from lightflight.reconstruct.verdict.unclaimed_light import verdict_with_unclaimed_light


def examined(
    path: LightPath,
    fit: JointFit | None,
    sightings: list[Sighting],
    setting: Setting,
    *,
    nominal_clock: bool,
    n_legs: int | None,
    may_bend: bool,
    name_arms: bool,
) -> LightPath:
    """The path with its verdict.

    `fit` is the joint fit of the same recordings; None: it is made here, from the path. With
    `may_bend` it was told that legs may be curves; with `name_arms` it says of light that is left
    where an arm of it leaves the path.
    """
    own = fit is not None
    fit = _fit_about(path, sightings, setting) if fit is None else fit
    n_shown = None if fit is None else fit.n_shown
    said = noticed(path, nominal_clock=nominal_clock, n_legs=n_legs, n_shown=n_shown)
    verdict = Verdict(Level.CHECK, (*said, *NOT_EXAMINED.findings))
    if fit is not None:
        beyond = beyond_the_tests(fit, sightings)
        hidden = findings_of_hidden(fit, told=n_legs is not None)
        evidence: tuple[Evidence, ...] = ()
        if not beyond:
            evidence, hidden = evidence_of_pulses(fit, hidden, sightings, setting, n_legs=n_legs)
        if not own and not beyond:
            evidence = (*evidence, evidence_of_own_errors(path, fit, sightings, setting))
        light, unseen = ((), ()) if beyond else _light(fit, sightings, nominal_clock)
        bends = findings_of_depth(setting) if may_bend else findings_of_bends(fit)
        aside = (*findings_of_detours(fit), *bends, *said, *beyond, *unseen, *hidden)
        verdict = verdict_from_evidence((*evidence, *light), aside)
        verdict = verdict_with_light_taken_up(
            verdict, evidence, aside, fit, sightings, nominal=nominal_clock
        )
        if n_legs is None:
            verdict = verdict_with_doubtful_corners(verdict, fit, sightings, setting)
            verdict = verdict_with_doubtful_legs(verdict, path)
        verdict = verdict_with_unclaimed_light(verdict, fit, sightings, setting)
        verdict = verdict_with_light_going_on(verdict, path, fit, nominal=nominal_clock)
        if name_arms:
            verdict = verdict_with_arm(verdict, fit, sightings, setting)
    if verdict.level is Level.CONTRADICTED:
        verdict = replace(verdict, findings=(*_mistakes(sightings[0], setting), *verdict.findings))
    return replace(path, verdict=verdict)


def _mistakes(sighting: Sighting, setting: Setting) -> tuple[Finding, ...]:
    """What a user may have told wrong, asked only where something is wrong."""
    try:
        legs = search_legs(sighting.arrivals, sighting, setting, None)
    except NothingFoundError:
        legs = ()
    # Another pulse's light runs along legs of its own, which lead back to no source.
    return implausible(
        setting.camera,
        setting.source,
        setting.medium,
        bright_legs([sighting], legs),
        code_ps=sighting.histograms.bin_width_ps,
    )


def evidence_of_pulses(
    fit: JointFit,
    hidden: tuple[Finding, ...],
    sightings: list[Sighting],
    setting: Setting,
    *,
    n_legs: int | None,
) -> tuple[tuple[Evidence, ...], tuple[Finding, ...]]:
    """What the pulses say of all causes, and what still may be hidden among them.

    Parameters
    ----------
    fit : JointFit
        The path.
    hidden : tuple of Finding
        Of legs that hardly any light speaks for (`findings_of_hidden`).
    sightings : list of Sighting
        Its recordings.
    setting : Setting
        As told.
    n_legs : int or None
        How many legs were told; None: as many as were found.

    Returns
    -------
    evidence : tuple of Evidence
        On the path as it is, or on one without a leg that takes up what a cause explains.
    hidden : tuple of Finding
        () in the second case.
    """
    lost = evidence_from_lost_legs(fit, sightings, setting)
    evidence = collected(fit, lost, sightings, setting)
    if hidden and evidence and not lost and n_legs is None:
        others = evidence_without_hidden(fit, evidence, sightings, setting)
        if others:
            return others, ()
    return evidence, hidden


def collected(
    fit: JointFit, lost: tuple[Evidence, ...], sightings: list[Sighting], setting: Setting
) -> tuple[Evidence, ...]:
    """All tests of one recording and its path; `lost`: those that took fits of their own."""
    by_fit = {one.name for one in lost}
    by_score = evidence_from_geometry(fit, sightings, setting)
    return (
        *(one for one in by_score if one.name not in by_fit),
        *lost,
        *evidence_of_lopsided_legs(fit),
    )


def _light(
    fit: JointFit, sightings: list[Sighting], nominal_clock: bool
) -> tuple[tuple[Evidence, ...], tuple[Finding, ...]]:
    """Tests of the counts; where there can be none, of flags, and the finding that says why.

    A fit of one pulse is also poor where another leg's light is too weak to be a second one, or
    where flight draws it out: there flags say nothing.
    """
    try:
        return evidence_from_counts(fit, sightings, nominal=nominal_clock), ()
    except (GeometryError, NothingFoundError, np.linalg.LinAlgError) as reason:
        is_drawn_out = isinstance(reason, DrawnOutError)
        return () if is_drawn_out else evidence_from_flags(fit, sightings), (
            noted(
                FindingName.NOT_EXAMINED,
                f"haze, halos, glare and other light were not looked for: {reason}",
                "judge the path by its residuals",
            ),
        )


def _fit_about(path: LightPath, sightings: list[Sighting], setting: Setting) -> JointFit | None:
    """A joint fit that starts from the path; None where single pulses do not allow one."""
    try:
        state = with_dark_pieces(state_of_path(path), setting.cameras)
        return with_fine_light(fit_joint(sightings, state, setting, legs=None), setting)
    except (GeometryError, NothingFoundError, np.linalg.LinAlgError):
        return None
