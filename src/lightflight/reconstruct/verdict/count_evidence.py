"""All tests of the counts about a path: which pixels, which causes, in what words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc, ndtr

from lightflight.errors import NothingFoundError
from lightflight.path.verdict import FindingName
from lightflight.reconstruct.fit.joint import JointFit, pulse_std_in_view
from lightflight.reconstruct.fit.result import explained_by_fit
from lightflight.reconstruct.model import light
from lightflight.reconstruct.model.cells import Cells, cells_about, lag_edges
from lightflight.reconstruct.model.counted import (
    as_wide_as_seen,
    dark_pixels,
    lit_pixels,
)
from lightflight.reconstruct.model.pulse_shape import shape_of
from lightflight.reconstruct.model.second_path import SecondPath
from lightflight.reconstruct.model.second_pulse import Echo
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.model.sizes import PLAUSIBLE
from lightflight.reconstruct.model.spread import HALO_PX, Beam, glare, halo
from lightflight.reconstruct.other_light.around import (
    FINE_GROWTH,
    FINE_STDS,
    Group,
    Seen,
    alike,
    dark_group,
    dispersion_of,
    lags_about_legs,
    pixels_about_path,
    pulses_expected,
)
from lightflight.reconstruct.verdict.beside import Brightest, brightest_beside
from lightflight.reconstruct.verdict.count_tests import (
    ASK_THE_PIXELS,
    Cause,
    Columns,
    Sums,
    clear_of_pulses,
    evidence_from_sums,
    summed,
)
from lightflight.reconstruct.verdict.evidence import (
    AT_MOST,
    CHECK_AT,
    LIGHT,
    Evidence,
    sigma_from_p,
)
from lightflight.reconstruct.verdict.unseen_light import Held, blind_to_light

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_BRIGHT = 0.02
"""Share of the brightest pixel's light from which a pixel is bright."""
_TABLE_PS = (-1e9, -700.0, 700.0, 3000.0, 1e9)
"""Stretches of time that the table of classes of pixels is summed over, ps."""
_N_CLASSES = 4
_MOST_WIDTHS = 4
"""Times that pulses are spread as the pixels show them, at most."""
_LEAST_DEVIATE = 3.0
"""Only cells with so much more than expected are looked at singly."""


def evidence_from_counts(
    fit: JointFit, sightings: list[Sighting], *, nominal: bool, taken_up: bool = False
) -> tuple[Evidence, ...]:
    """What the counts of all recordings say against a path.

    Parameters
    ----------
    fit : JointFit
        The path.
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.
    nominal : bool
        Whether the widths of the codes were never measured.
    taken_up : bool, optional
        Whether diffuse light that the fit found is expected; else a plain flight is.

    Returns
    -------
    tuple of Evidence
        The tests.

    Raises
    ------
    NothingFoundError
        Where nothing can be tested: scaled intensities, or no lit pixel.
    """
    if not all(o.histograms.poisson for o in sightings):
        raise NothingFoundError("intensities are scaled, and chance is known of counts alone")
    # Times between pulses are asked of all cameras at once, beyond what the widest of them hide.
    stds = {o.view: pulse_std_in_view(sightings, o.view) for o in sightings}
    std = max(stds.values())
    periods = [o.histograms.laser_period_ps for o in sightings]
    fine = lag_edges(std, FINE_STDS * std, FINE_GROWTH, _shortest(periods))
    lags = light.other_lags(fine, std)
    held: list[Held] = []
    beside: list[Brightest] = []
    for whole, own in alike(sightings):
        expected = whole if taken_up else replace(whole, diffuse=None)
        here, bright = _held(expected, fit, own, stds[whole.view], fine, lags, nominal)
        held += here
        beside += bright
    if not held:
        raise NothingFoundError("no two usable pixels lie on the path")
    asked, sums = causes(lags), summed([(one.group.pixels, one.columns) for one in held])
    tested = evidence_from_sums(sums, asked, least_size=light.LEAST_SHARE)
    explained = np.zeros(len(sums.score))
    named = [(one.gain, sizes) for one, sizes in tested if one.gain > 0.0 and not one.symptom]
    if named:
        explained = max(named, key=lambda pair: pair[0])[1]
    said = _told(fit, sightings)
    groups = [one.group for one in held]
    blind = blind_to_light(held, sums, asked, fit, least_size=light.LEAST_SHARE)
    return (
        *(one for one, _ in tested),
        replace(_elsewhere(groups, beside, sums, explained, said), blind=tuple(blind.values())),
    )


def _shortest(periods: list[float | None]) -> float | None:
    known = [period for period in periods if period is not None]
    return min(known) if known else None


def _held(
    whole: Sighting,
    fit: JointFit,
    numbers: list[int],
    std_ps: float,
    fine: Floats,
    lags: Floats,
    nominal: bool,
) -> tuple[list[Held], list[Brightest]]:
    """All usable pixels of a recording in their groups, each with its columns.

    And the one beside a line that is brightest for it.
    """
    seen = pixels_about_path(whole, fit, numbers[0], std_ps)
    near, far = np.flatnonzero(seen.leg[:, 0] >= 0), np.flatnonzero(seen.leg[:, 0] == -1)
    if len(near) < 2:
        return [], []
    reference = seen.arrival_ps[near, 0]
    cut = lags_about_legs(seen.of(near), fine, std_ps)
    about = cells_about(whole, seen.rows[near], seen.cols[near], reference, cut, nominal=nominal)
    pulses = pulses_expected(seen.of(near), shape_of(whole.timing.response))
    points = np.column_stack((seen.rows[near], seen.cols[near]))
    dark, dispersion = _dark(whole, seen, near, far, std_ps, nominal)
    tails = () if whole.diffuse is None else whole.diffuse.strengths.tails
    second = None if whole.diffuse is None else whole.diffuse.second
    other, beyond = other_light_expected(whole, about, points, reference)
    for _ in range(_MOST_WIDTHS):
        lit = lit_pixels(
            about,
            pulses,
            dispersion=dispersion,
            tails=tails,
            other=other,
            beyond=beyond,
            second=second if isinstance(second, Echo) else None,
        )
        pulses, changed = as_wide_as_seen(pulses, lit)
        if not changed:
            break
    bright = lit.photons[:, 0] > _BRIGHT * float(lit.photons[:, 0].max())
    groups = [
        Group(lit.of(own), points[own], reference[own], np.full(int(own.sum()), kind))
        for kind, own in ((0, bright), (1, ~bright))
        if own.any()
    ]
    beam = Beam(
        points[bright].astype(float),
        seen.leg[near][bright, 0],
        reference[bright] + lit.late_ps[bright, 0],
        lit.photons[bright, 0],
        std_ps,
    )
    if dark is not None:
        groups.append(dark)
    held = [
        Held(group, _columns(group, beam, lags, whole), tuple(numbers), beam, whole.blind.shape)
        for group in groups
    ]
    picture, camera = fit.pictures[numbers[0]], fit.solution.cameras[whole.view]
    return held, [brightest_beside(lit, seen.of(near), picture, camera)]


def _dark(
    whole: Sighting, seen: Seen, near: Indices, far: Indices, std_ps: float, nominal: bool
) -> tuple[Group | None, float]:
    """Pixels that no leg lights, and the variance of quiet counts over Poisson's."""
    dark = dark_group(whole, seen, near, far, std_ps, nominal)
    if dark is None:
        return None, 1.0
    other, beyond = other_light_expected(
        whole, dark.pixels.cells, dark.points_px, dark.reference_ps
    )
    pixels, cells = dark.pixels, dark.pixels.cells
    if whole.diffuse is not None:
        pixels = dark_pixels(cells, other=other, beyond=beyond)
    dispersion = dispersion_of(pixels)
    if dispersion > 1.0:
        pixels = dark_pixels(cells, dispersion=dispersion, other=other, beyond=beyond)
    return replace(dark, pixels=pixels), dispersion


def other_light_expected(
    whole: Sighting, cells: Cells, points_px: Indices, reference_ps: Floats
) -> tuple[Floats | float, Floats | None]:
    """Counts of halo, glare and a second path as they were found.

    Parameters
    ----------
    whole : Sighting
        The recording, with the diffuse light that a fit found; None is expected to have none.
    cells : Cells
        Of n pixels, m each.
    points_px : array of int, shape (n, 2)
        (row, column).
    reference_ps : array of float, shape (n,)
        Arrival time at which their lags are zero, ps on the clock.

    Returns
    -------
    counts : array of float, shape (n, m), or float
        0.0: none was found.
    beyond : array of float, shape (n, m), or None
        What of these is guessed: images of light that the picture does not show.
    """
    diffuse = whole.diffuse
    if diffuse is None:
        return 0.0, None
    counts = diffuse.spread(cells, points_px, reference_ps, whole.blind.shape)
    if not isinstance(diffuse.second, SecondPath):
        return counts, None
    rows, cols = points_px.astype(np.int64).T
    images, beyond, _ = diffuse.second.light(cells, rows, cols, reference_ps)
    return counts + images, beyond if beyond.any() else None


def _columns(group: Group, beam: Beam, lags: Floats, whole: Sighting) -> Columns:
    """The columns of a group, in the order of `causes`.

    Late light, other pulses and pile-up show where the light is, halo and glare where none is. In
    between the light of the legs takes both up.
    """
    pixels, cells = group.pixels, group.pixels.cells
    n_own, n_spread = len(light.LATE_PS) + len(lags) + 1, len(HALO_PX) + 3
    parts, used = [], np.zeros(0, dtype=np.int64)
    size = cells.width_ps / beam.std_ps
    if group.of_class[0] == 0:
        sync = -(group.reference_ps + whole.timing.skew_ps[tuple(group.points_px.T)])
        parts = [
            light.late_light(pixels),
            light.other_pulses(pixels, lags),
            light.pile_up(pixels, sync, whole.histograms.laser_period_ps),
        ]
        used = np.arange(n_own)
        share = pixels.photons[:, :1] / beam.photons.max()
        size = np.broadcast_to(share, cells.counts.shape)
    elif group.of_class[0] > 1:
        parts = [
            halo(cells, group.points_px, group.reference_ps, beam, whole.blind.shape),
            glare(cells, group.reference_ps, beam, whole.blind.size),
        ]
        used = n_own + np.arange(n_spread)
    table = light.classes(cells, group.of_class, np.array(_TABLE_PS), size)
    # As much light as all of the path's is the unit, as of the others.
    table *= beam.photons.sum() / np.maximum(table.sum(axis=(0, 1)), 1e-9)
    n_lags = len(_TABLE_PS) - 1
    kinds = np.unique(group.of_class)
    parts.append(table)
    first = n_own + n_spread + kinds[:, np.newaxis] * n_lags
    used = np.concatenate((used, (first + np.arange(n_lags)).ravel()))
    return Columns(np.concatenate(parts, axis=2), used, n_own + n_spread + _N_CLASSES * n_lags)


def causes(lags: Floats) -> list[Cause]:
    """What is asked for, and where its columns are."""
    n_late, n_other = len(light.LATE_PS), len(lags)
    late = tuple(range(n_late))
    labels = tuple(f"{wait:g} ps" for wait in light.LATE_PS)
    found = [
        Cause(
            FindingName.HAZE,
            late,
            PLAUSIBLE["haze"].size,
            "{size:.2g} of the light on the path comes late, by some {each}",
            "thin out the haze; if a flat recording shows the same tail it is the detector's",
            labels=labels,
        ),
        Cause(
            FindingName.SHAPE,
            late,
            PLAUSIBLE["haze"].size,
            "pulses have a tail: {size:.2g} of their light, by some {each}",
            "calibrate with a flat of the same laser and --flat-pulse tail",
            labels=labels,
        ),
    ]
    at = n_late
    found += [
        Cause(
            FindingName.OTHER_PULSE,
            (at + j,),
            PLAUSIBLE["other_pulse"].size,
            "a second pulse of some {size:.1g} of the light, {each} from the path's",
            "look for a reflection in windows and filters, or a second pulse of the laser",
            labels=(f"{lag:+.0f} ps",),
        )
        for j, lag in enumerate(lags)
    ]
    at += n_other
    found.append(
        Cause(
            FindingName.PILE_UP,
            (at,),
            PLAUSIBLE["pile_up"].size,
            "{size:.2g} of the brightest pixel's photons are hidden by earlier ones",
            "record dimmer, or state n_frames and periods_per_frame",
        )
    )
    at += 1
    n_halo = len(HALO_PX) + 1
    found.append(
        Cause(
            FindingName.HALO,
            tuple(range(at, at + n_halo)),
            PLAUSIBLE["halo"].size,
            "{size:.2g} of the light lies about the path, over {each}",
            "clean and focus the lens, stop it down, shade it from the beam's ends",
            labels=(*(f"{px:g} px" for px in HALO_PX), f"{HALO_PX[-1]:g} px and late"),
        )
    )
    at += n_halo
    found.append(
        Cause(
            FindingName.GLARE,
            (at, at + 1),
            PLAUSIBLE["glare"].size,
            "{size:.2g} of the light lies over the whole picture{each}",
            "shade the lens and cover bright walls, or mask the pixels off the path",
            labels=("", ", some nanoseconds late"),
        )
    )
    at += 2
    n_table = _N_CLASSES * (len(_TABLE_PS) - 1)
    found.append(
        Cause(
            FindingName.UNEXPLAINED_LIGHT,
            tuple(range(at, at + n_table)),
            1e3,
            "counts by class of pixel and time are not those of the path",
            ASK_THE_PIXELS,
            symptom=True,
        )
    )
    return found


def _told(fit: JointFit, sightings: list[Sighting]) -> str:
    """How many of the pulses, and of their photons, the path explains."""
    of = explained_by_fit(fit, sightings)
    share = 100.0 * of.photons / max(of.photons_found, 1.0)
    return f"{of.n_pulses} of {of.n_found} pulses ({share:.3g} % of their light) are the path's"


def _elsewhere(
    groups: list[Group], beside: list[Brightest], sums: Sums, explained: Floats, told: str
) -> Evidence:
    """Whether any single cell of any pixel holds more than chance brings to one of so many.

    Or any pixel `beside` a line. `explained` (K,) are the sizes of the best cause: what they leave
    is the symptom's.
    """
    plain = _least_likely([_largest(groups, sums, np.zeros_like(explained)), *beside])
    rest = plain
    if explained.any() and plain.p_value < CHECK_AT:
        rest = _least_likely([_largest(groups, sums, explained), *beside])
    sigma = sigma_from_p(plain.p_value)
    row, col = plain.place
    where = f"{plain.photons:.0f} photons in pixel ({row}, {col}), {plain.lag_ps:+.0f} ps from it"
    return Evidence(
        FindingName.UNEXPLAINED_LIGHT,
        sigma**2,
        1,
        sigma**2 - 1.0,
        f"{told}; the clearest other light is {where}",
        "cover what reflects or shines there, or mask the pixels (exclude_mask=)",
        symptom=True,
        data=LIGHT,
        remains=sigma_from_p(rest.p_value) ** 2,
        silent_below=AT_MOST,
    )


def _least_likely(some: list[Brightest]) -> Brightest:
    """The least likely of several, by the chance that one of so many is."""
    least = min(some, key=lambda one: one.p_value)
    return replace(least, p_value=min(1.0, len(some) * least.p_value))


def _largest(groups: list[Group], sums: Sums, sizes: Floats) -> Brightest:
    """The cell with the least likely excess over what the path, and causes of `sizes`, expect."""
    least, n = Brightest(1.0, (0, 0), 0.0, 0.0), 0
    for group, left in zip(groups, sums.groups, strict=True):
        pixels, cells = group.pixels, group.pixels.cells
        middle = 0.5 * (cells.edges_ps[:, 1:] + cells.edges_ps[:, :-1])
        off = clear_of_pulses(pixels)
        mean = pixels.mean + (sizes[left.used] @ left.columns).reshape(middle.shape)
        mean = np.where(off, np.maximum(mean, 1e-9), 0.0)
        n += int(off.sum())
        counts = np.where(off, cells.counts, 0.0)
        variance = np.divide(1.0, pixels.weight, out=np.ones_like(mean), where=pixels.weight > 0.0)
        variance += np.maximum(mean - pixels.mean, 0.0)
        at = np.nonzero(off & (counts - mean > _LEAST_DEVIATE * np.sqrt(variance)))
        if not len(at[0]):
            continue
        # Given all counts of the pixel, those of one cell are binomial: no background is needed.
        total, share = counts.sum(axis=1)[at[0]], mean[at] / mean.sum(axis=1)[at[0]]
        by_count = betainc(counts[at], total - counts[at] + 1.0, share)
        by_size = ndtr(-(counts[at] - mean[at]) / np.sqrt(variance[at]))
        p_values = np.where(variance[at] > 1.1 * mean[at], np.maximum(by_size, by_count), by_count)
        best = int(np.argmin(p_values))
        if p_values[best] < least.p_value:
            pixel, cell = at[0][best], at[1][best]
            place = int(group.points_px[pixel, 0]), int(group.points_px[pixel, 1])
            excess = float((counts - mean)[pixel, cell])
            least = Brightest(float(p_values[best]), place, float(middle[pixel, cell]), excess)
    p_value = float(-np.expm1(n * np.log1p(-min(least.p_value, 1.0 - 1e-16))))
    return Brightest(p_value, least.place, least.lag_ps, least.photons)
