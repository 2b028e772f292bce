"""What is noticed of a path without a test of its fit: what was left out, told, assumed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc, chdtrc, ndtr

from lightflight import flags
from lightflight.path.glass import glass_of, on_faces
from lightflight.path.light_path import LightPath
from lightflight.path.tree import starts_of
from lightflight.path.verdict import Finding, FindingName, noted
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.fit.result import path_from_fit
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.verdict.evidence import (
    AT_MOST,
    Evidence,
    evidence_from_deviate,
    sigma_from_p,
)

Floats = NDArray[np.float64]

_USUAL_POOR = 0.02
"""Share of the pulses on an undisturbed path that carry POOR_FIT: at most this."""
_TURNS_AT = 1e-4
"""Chance that straight light seems to turn somewhere on two legs."""


def evidence_from_flags(fit: JointFit, sightings: list[Sighting]) -> tuple[Evidence, ...]:
    """Whether more pulses on the path have a shape that does not fit than chance brings."""
    poor, n = 0, 0
    for number, sighting in enumerate(sightings):
        used = (fit.sighting_of == number) & (fit.times.weight > 0)
        words = sighting.arrivals.flags[fit.times.index[used]]
        poor += int(np.count_nonzero(words & np.uint32(flags.POOR_FIT)))
        n += int(used.sum())
    if not n:
        return ()
    p_value = float(bdtrc(poor - 1, n, _USUAL_POOR)) if poor else 1.0
    return (
        evidence_from_deviate(
            FindingName.SHAPE,
            sigma_from_p(p_value),
            sentence=f"{poor} of {n} pulses on the path do not have the shape of the laser's pulse",
            remedy="look at the pixels that the flag poor_fit marks: haze, tails, second pulses",
            symptom=True,
            silent_below=AT_MOST,
        ),
    )


def evidence_of_own_errors(
    path: LightPath, fit: JointFit, sightings: list[Sighting], setting: Setting
) -> Evidence:
    """Whether a path not made by the joint fit keeps within its errors of the path that is.

    Of angles and corners that which is farthest off, in its own stated error and the other's.
    """
    other = path_from_fit(fit, sightings, setting)

    def numbers(one: LightPath) -> Floats:
        angles = [(leg.angle_deg, leg.angle_std_deg) for leg in one.legs]
        both = np.dstack((one.vertices_mm, one.vertex_std[:, :3]))
        corners = np.delete(both, one.ends, axis=0).reshape(-1, 2)
        return np.concatenate((np.array(angles), corners))

    (own, std), (best, best_std) = numbers(path).T, numbers(other).T
    pulls = np.abs(own - best) / np.maximum(np.hypot(std, best_std), 1e-12)
    off_mm = float(np.linalg.norm(path.vertices_mm - other.vertices_mm, axis=1)[1:].max())
    # As many chances as numbers; that corners follow from angles makes it a little too mild.
    p_value = -np.expm1(len(pulls) * np.log1p(-2.0 * min(float(ndtr(-pulls.max())), 0.5 - 1e-9)))
    return evidence_from_deviate(
        FindingName.SCATTER,
        sigma_from_p(float(p_value)),
        sentence=f"all pulses fitted together lead elsewhere by {off_mm:.2g} mm: "
        f"{pulls.max():.2g} of the stated errors",
        remedy="use method='joint'",
    )


def noticed(
    path: LightPath,
    *,
    nominal_clock: bool,
    n_legs: int | None,
    n_shown: int | None = None,
) -> tuple[Finding, ...]:
    """Findings that are no tests.

    `n_shown` is how many legs the recording shows by itself, where more were told.
    """
    found = []
    if nominal_clock:
        found.append(
            noted(
                FindingName.CALIBRATION,
                "the clock is nominal: no timing calibration was given",
                "calibrate the clock (lightflight calibrate)",
            )
        )
    told = path.n_legs - 2 * len(path.legs_in_glass)
    if n_legs not in (None, told, told - len(path.unseen_legs)):
        found.append(
            noted(
                FindingName.LEG_COUNT,
                f"{n_legs} legs were told and the path has {told}",
                "leave the number of legs open, or give a start",
            )
        )
    elif n_legs is not None and (unseen := corners_without_a_turn(path)):
        which = " and ".join(str(corner) for corner in unseen)
        found.append(
            noted(
                FindingName.LEG_COUNT,
                f"{n_legs} legs were told and the recording shows {n_legs - len(unseen)}: the "
                f"light is not seen to turn at corner{'s' if len(unseen) > 1 else ''} {which}",
                "leave the number of legs open, or give a start",
            )
        )
    elif n_legs is not None and n_shown is not None:
        found.append(
            noted(
                FindingName.LEG_COUNT,
                f"{n_legs} legs were told and the recording by itself shows {n_shown}: where the "
                "others begin and end rests on that number",
                "leave the number of legs open, or give a start",
            )
        )
    if not path.goodness.converged:
        found.append(
            noted(
                FindingName.SCATTER,
                "the fit stopped before it converged",
                "give a start, or a smaller number of legs",
            )
        )
    return tuple(found)


def corners_without_a_turn(path: LightPath) -> list[int]:
    """Corners, numbers of their vertices, at which the path may as well go straight on.

    A fork is none: one of its arms may go straight on. The change of direction is held against its
    own covariance. Such a corner lies where chance makes the change largest, so as many places
    count as pulses lie on its two legs.
    """
    corners, starts = [], starts_of(path)
    passed_over = {*path.open_vertices, *path.ends, *(vertex for _, vertex in path.forks)}
    passed_over |= set(on_faces(glass_of(path.vertices_mm, path.medium.blocks)))
    for k in range(1, path.n_legs):
        if k in passed_over:
            continue
        # One leg begins where one ends: that of the corner's own number.
        three = [starts[k - 1], k, k + 1]
        steps = np.diff(path.vertices_mm[three], axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        units = steps / lengths[:, np.newaxis]
        if units[0] @ units[1] < 0.0:  # it turns back, whichever way it leans
            continue
        before, after = (
            (np.eye(3) - np.outer(unit, unit)) / length
            for unit, length in zip(units, lengths, strict=True)
        )
        # d(change of direction) / d(x, y, z, t of the three vertices).
        jacobian = np.zeros((3, 12))
        jacobian[:, 0:3], jacobian[:, 4:7], jacobian[:, 8:11] = before, -before - after, after
        rows = np.ravel([np.arange(4 * vertex, 4 * vertex + 4) for vertex in three])
        block = np.ix_(rows, rows)
        variance, axes = np.linalg.eigh(jacobian @ path.covariance[block] @ jacobian.T)
        # Along the leg itself directions do not change; that axis has no variance.
        across = (axes.T @ (units[1] - units[0]))[1:]
        chi2 = float(np.sum(across**2 / np.maximum(variance[1:], 1e-24)))
        on_them = np.isin(path.residuals["leg"], (k - 1, k)) & path.residuals["used"]
        if max(int(on_them.sum()), 1) * chdtrc(2, chi2) > _TURNS_AT:
            corners.append(k)
    return corners


def beyond_the_tests(fit: JointFit, sightings: Sequence[Sighting]) -> tuple[Finding, ...]:
    """A finding that says why the tests would not hold for this recording; none where they do.

    Pulses that pile-up bends are modelled by the counts alone: the tests, which rest on pulses,
    would call them wrong. Where light begins or stops in the picture no pulse takes part.
    """
    piled = any(
        np.any(sighting.arrivals.flags[fit.times.index[own]] & np.uint32(flags.PILE_UP))
        for number, sighting in enumerate(sightings)
        if (own := fit.sighting_of == number).any()
    )
    if not piled:
        return ()
    return (
        noted(
            FindingName.NOT_EXAMINED,
            "the path was not tested: photons piled up",
            "judge it by its residuals",
        ),
    )
