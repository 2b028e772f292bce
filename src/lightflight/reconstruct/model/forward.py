"""The forward model of all counts: what every pixel near the path should have recorded.

Expected counts of pixel p in code k are

    lambda_pk = o_pk (sum_legs N_p [F(e_(k+1)) - F(e_k)] + b_p w_pk) + d_pk,

F the pulse (laser, response, transit over the footprint; a Gaussian, or the shape the flat was
fitted with, spread where it is wider) about the footprint's mean arrival time plus the pixel's
delay, e the true code edges modulo the period, o_pk the share of laser periods that no earlier
photon had closed, d_pk diffuse light as `other_light.diffuse` measured it. N_p is the strength of
the light along the leg under the spot. The integral along the leg is collapsed into its zeroth,
first and second moment (photons, mean time, variance), which is exact for a Gaussian spot and a
curve that bends little within it; corners cut the footprint. A large active area makes another
spot: photons and mean time follow `spot`.

Takes a path and the brightness along it, gives what every pixel expects and how that follows a
handful of parameters; `likelihood` holds it against the counts.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from lightflight.flight import Medium
from lightflight.reconstruct.model.footing import (
    Corners,
    Footing,
    corner_distances,
    footing,
)
from lightflight.reconstruct.model.geometry import (
    Footprint,
    Indices,
    PathState,
    arrival_jacobian,
)
from lightflight.reconstruct.model.nudges import NUDGE, Nudges
from lightflight.reconstruct.model.offsets import line_offsets
from lightflight.reconstruct.model.picture import arrival_curvature
from lightflight.reconstruct.model.pulse_shape import tables_for_counts
from lightflight.reconstruct.model.spot import SeenLine, seen_line
from lightflight.reconstruct.model.strength import (
    slopes_of_splines,
    span_of_knots,
)
from lightflight.reconstruct.model.thick_beam import (
    BeamShares,
    ThickFooting,
    beam_shares,
    slant_of_leg,
    thick_footing,
)
from lightflight.reconstruct.model.unknowns import Layout, Light

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

_MOST_BENT = 0.7
"""How much more or less of the variance in a pixel light may make that is not log-linear; as where
pulses are fitted (`other_light.drawn_out`)."""
LEAST_OWN_VARIANCE = 0.3
"""... and how much of the variance of a pulse is its own at least, whatever flight adds to it."""
_DARK_LOG = -60.0
"""ln(photons) of a pixel that a leg does not light: far below any, and exp() of it is no zero."""


@dataclass(frozen=True, eq=False)
class LightModes:
    """How the light of legs may be uneven beyond its splines, one standard deviation a column.

    Attributes
    ----------
    ln : array of float, shape (n, L, k)
        Log of the light of a leg in a pixel.
    late_ps : array of float, shape (n, L, k)
        By how much later its mean time is, ps.
    wider_ps2 : array of float, shape (n, L, k)
        By how much wider it is, in the variance of its time, ps^2.
    """

    ln: Floats
    late_ps: Floats
    wider_ps2: Floats


@dataclass(frozen=True, eq=False)
class Pixels:
    """The pixels that take part: (n,) arrays, legs near each in columns (n, L).

    Attributes
    ----------
    near : array of bool, shape (n, L)
        True where the leg's light can reach the pixel.
    points_px : array of float, shape (n, 2)
        Undistorted (u, v) in the picture that the lines of the light were drawn in.
    skew_ps : array of float, shape (n,)
        Delay of the pixel.
    pixel_var : array of float, shape (n,)
        Variance of that delay from the calibration, ps^2.
    modes_ps : array of float, shape (n, L, k)
        Shared clock errors at the leg's arrival, one-sigma columns, ps.
    uneven : LightModes or None
        Where legs are lit more unevenly than splines tell; None: nowhere.
    """

    rows: Indices
    cols: Indices
    near: NDArray[np.bool_]
    points_px: Floats
    skew_ps: Floats
    pixel_var: Floats
    modes_ps: Floats
    uneven: LightModes | None = None

    @property
    def n_modes(self) -> int:
        """Shared errors of clock and light, in this order."""
        of_light = 0 if self.uneven is None else int(self.uneven.ln.shape[2])
        return int(self.modes_ps.shape[2]) + of_light


@dataclass(frozen=True, eq=False)
class CodeCounts:
    """Counts and code intervals of the pixels that take part.

    Attributes
    ----------
    counts : array of float, shape (n, codes)
    lower_ps : array of float, shape (n, codes)
    upper_ps : array of float, shape (n, codes)
    period_ps : float
        Laser period, ps; 0: none.
    use_outside : array of bool, shape (n,)
        False where something else flashes outside the windows.
    open_share : array of float, shape (n, codes or 1) or None
        Counts in a code per photon that came (pile-up); None: all are counted.
    shape : (array of float, array of float)
        Of a pulse, see `pulse_shape.tables_for_counts`.
    other : array of float, shape (n, codes) or (0, 0)
        Counts expected of light that is no leg's.
    second : (float, float) or None
        Share and delay, ps, of a second pulse, whose light comes as that of the first does.
    """

    counts: Floats
    lower_ps: Floats
    upper_ps: Floats
    period_ps: float
    use_outside: NDArray[np.bool_]
    open_share: Floats | None = None
    shape: tuple[Floats, Floats] = field(default_factory=lambda: tables_for_counts(None))
    other: Floats = field(default_factory=lambda: np.empty((0, 0)))
    second: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Local:
    """Local variables of each pixel and leg, and how they follow from the global ones.

    Attributes
    ----------
    log_photons : array of float, shape (n, L)
    arrival_ps : array of float, shape (n, L)
        Mean over the footprint; NaN where the leg is not near.
    std_ps : array of float, shape (n, L)
        Of the pulse with its transit.
    third_ps3 : array of float, shape (n, L)
        Third cumulant that flight through the footprint adds to it.
    jacobian : array of float, shape (n, 3 L, P)
        d(ln photons, time, ln std of each leg) / d(parameters).
    """

    log_photons: Floats
    arrival_ps: Floats
    std_ps: Floats
    third_ps3: Floats
    jacobian: Floats


def local_variables(
    state: PathState,
    light: Light,
    pixels: Pixels,
    layout: Layout,
    *,
    basis: Floats,
    modes: Floats,
    camera: Camera,
    medium: Medium,
    nudges: Nudges | None = None,
    seen_px: Floats | None = None,
) -> Local:
    """Photons, time and width of every leg in every pixel, with their derivatives.

    Parameters
    ----------
    state : PathState
        The path as it is now.
    light : Light
        Brightness, spot and pulse width.
    pixels : Pixels
        The pixels that take part.
    layout : Layout
        Where each kind of parameter sits.
    basis : array of float, shape (3m + 1, p)
        Columns are unit moves of (vertices in mm, start time in ps).
    modes : array of float, shape (k,)
        Shared errors of clock and light, in standard deviations.
    camera : Camera
        The camera that sees it.
    medium : Medium
        Group indices out and back.
    nudges : Nudges, optional
        How camera and medium follow the shared errors of the layout; None: it has none.
    seen_px : array of float, shape (n, 2), optional
        Undistorted (u, v) of the pixels through the lens as it stands; None: as `pixels` has them.

    Returns
    -------
    Local
        (n, L) each, and how they follow the parameters.
    """
    n, n_legs = pixels.near.shape
    local = Local(
        log_photons=np.full((n, n_legs), _DARK_LOG),
        arrival_ps=np.full((n, n_legs), np.nan),
        std_ps=np.ones((n, n_legs)),
        third_ps3=np.zeros((n, n_legs)),
        jacobian=np.zeros((n, 3 * n_legs, layout.size)),
    )
    seen_px = pixels.points_px if seen_px is None else seen_px
    of_clock, of_light = np.split(modes, [pixels.modes_ps.shape[2]])
    uneven = pixels.uneven
    for k in state.seen:
        here = np.flatnonzero(pixels.near[:, k])
        seen = _seen_leg(state, light, pixels, seen_px[here], k, here, camera, medium)
        slopes = _slopes(seen, state, seen_px[here], basis, medium, nudges)
        _fill_leg(local, seen, slopes, light, pixels.modes_ps[here, k], of_clock, layout, here)
        if uneven is not None:
            _fill_uneven(local, uneven, of_light, layout, here, k)
    return local


@dataclass(frozen=True, eq=False)
class _SeenLeg:
    """One leg as the n pixels near it see it.

    Attributes
    ----------
    leg : int
        Which.
    print_ : Footprint
        Where each pixel looks along it.
    arrival_by_state : array of float, shape (n, size)
        Its derivative, ps per mm.
    across_px : array of float, shape (n,)
        Distance of the pixel from the leg's image, px.
    across_by_state : array of float, shape (n, size)
        Its derivative, px per mm.
    along_px : array of float, shape (n,)
        Place along the leg's image as it was drawn, within its knots, px. No error of the lens
        moves it: what lights a pixel stays that pixel's, and knots that slid under the light would
        take their own spacing for knowledge of the lens.
    spot_px : array of float, shape (n,)
        Standard deviation of the spot there, px.
    growth : array of float, shape (n,)
        Of its log along the leg, per px.
    across : SeenLine
        What the pixels see of the leg, by their distance from it.
    corners : Corners
        Where the footprint is cut.
    feet : Footing
        Moments of the footprint.
    beam : _SeenBeam or None
        What a thick beam adds; None: nothing is asked of it.
    """

    leg: int
    print_: Footprint
    arrival_by_state: Floats
    across_px: Floats
    across_by_state: Floats
    along_px: Floats
    spot_px: Floats
    growth: Floats
    across: SeenLine
    corners: Corners
    feet: Footing
    beam: _SeenBeam | None


@dataclass(frozen=True, eq=False)
class _SeenBeam:
    """A thick beam as the n pixels near a leg see it.

    Attributes
    ----------
    thick : ThickFooting
        Moments of the footprint, and what they follow.
    shares : BeamShares
        What of the spot is the beam's.
    growth : array of float, shape (n,)
        Of the log of the spot, per px.
    slope_ps_per_px : array of float, shape (n,)
        Of the times along the leg.
    """

    thick: ThickFooting
    shares: BeamShares
    growth: Floats
    slope_ps_per_px: Floats

    @property
    def early_ps(self) -> Floats:
        """(n,), by how much light comes earlier than where a lens makes the spot grow."""
        fanned, _ = self.shares.fanned_px2(self.thick.towards)
        early: Floats = 2.0 * self.slope_ps_per_px * self.growth * fanned
        return early

    def follows(self, scales: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """How three moments, scaled by (3, n), follow distance, log spot, its growth and shares.

        Each (3, n) but the last, (3, 3, n).
        """
        thick, shares = self.thick, self.shares
        across, by_share, by_deep = (
            scales * np.array(by) for by in (thick.by_across, thick.by_share, thick.by_deep)
        )
        by_spot = by_share * shares.across_by_log_spot + by_deep * shares.deep_by_log_spot
        by_shares = by_share[:, np.newaxis] * shares.across_by
        by_shares += by_deep[:, np.newaxis] * shares.deep_by
        fanned, fanned_by = shares.fanned_px2(thick.towards)
        by_growth = np.zeros_like(across)
        by_growth[1] = -2.0 * self.slope_ps_per_px * fanned
        by_shares[1] -= 2.0 * self.slope_ps_per_px * self.growth * fanned_by
        return across, by_spot, by_growth, by_shares


def _seen_leg(
    state: PathState,
    light: Light,
    pixels: Pixels,
    points: Floats,
    k: int,
    here: Indices,
    camera: Camera,
    medium: Medium,
) -> _SeenLeg:
    """Geometry and footprint moments of leg `k` in the pixels `here` (n,), seen at `points`."""
    legs = np.full(len(here), k)
    print_, by_state = arrival_jacobian(
        state,
        camera=camera,
        medium=medium,
        legs=legs,
        rows=pixels.rows[here],
        cols=pixels.cols[here],
    )
    across, across_by_state = line_offsets(state, camera=camera, legs=legs, anchors=points)
    drawn = light.lines[k].along_across(pixels.points_px[here])[0]
    along = np.clip(drawn, *span_of_knots(light.knots[k]))
    corners = corner_distances(state, print_, k, camera=camera, cut_ends=light.cut_ends)
    slope = BSpline(light.knots[k], light.coefficients[k], 3).derivative()(along)
    spot, growth = np.full(len(here), np.exp(light.log_spot_px)), np.zeros(len(here))
    if light.spots:
        spot, growth = spot * np.exp(light.spots[k].log_at(along)), light.spots[k].growth_at(along)
        slope = slope + growth * (2.0 + (across / spot) ** 2)
    curvature = arrival_curvature(print_, state=state, camera=camera, medium=medium)
    of_leg = slope, print_.slope_ps_per_px, curvature, corners
    beam = None
    if light.beam_share is None and not light.own_shares:
        feet = footing(*of_leg, spot_px=spot)
    else:
        own = light.own_shares[k] if light.own_shares else (0.0, 0.0)
        shares = beam_shares(light.beam_share or 0.0, own, spot, light.lens_var_px2)
        thick = thick_footing(
            *of_leg, slant_of_leg(state, k, camera),
            spot_px=spot, across_px=across, share=shares.across, deep=shares.deep,
        )  # fmt: skip
        feet = thick.feet
        beam = _SeenBeam(thick, shares, growth, print_.slope_ps_per_px)
    heading = light.lines[k].heading_rad(along)
    seen = seen_line(across, spot, heading, active_px=light.active_px)
    return _SeenLeg(
        k, print_, by_state, across, across_by_state, along, spot, growth, seen, corners, feet, beam
    )


@dataclass(frozen=True, eq=False)
class _Slopes:
    """How one leg in n pixels follows the path's freedom and the shared errors; (n, q) each.

    Attributes
    ----------
    arrival : array of float
        Arrival time from the foot, ps.
    across : array of float
        Distance of the pixel from the leg's image, px.
    before : array of float
        Picture distance to the corner before the foot, px.
    after : array of float
        To the corner after it, px.
    """

    arrival: Floats
    across: Floats
    before: Floats
    after: Floats


def _slopes(
    seen: _SeenLeg,
    state: PathState,
    points: Floats,
    basis: Floats,
    medium: Medium,
    nudges: Nudges | None,
) -> _Slopes:
    """Columns of the freedom, then of the shared errors; `points` (n, 2) are the pixels' places."""
    n_shared = 0 if nudges is None else len(nudges)
    moves = basis if nudges is None else np.column_stack((basis, nudges.as_moves(state)))
    found = _Slopes(
        seen.arrival_by_state @ moves,
        seen.across_by_state @ moves,
        seen.corners.before_by_state @ moves,
        seen.corners.after_by_state @ moves,
    )
    if nudges is None:
        return found
    own, k = slice(moves.shape[1] - n_shared, None), seen.leg
    found.arrival[:, own] = nudges.arrivals(state, seen.print_, seen.arrival_by_state, medium)
    for slopes, vertex, place, cut in (
        (found.before, int(state.leg_starts[k]), 0.0, seen.corners.before),
        (found.after, k + 1, 1.0, seen.corners.after),
    ):
        along = state.tangents_mm(k, np.array([place]))
        slide = nudges.slides(state.vertices_mm[vertex : vertex + 1], along)
        slopes[:, own] += np.where(np.isfinite(cut)[:, np.newaxis], slide, 0.0)
    for error, there in nudges.undistorted(points).items():
        lens = nudges.lenses[error]
        across, _ = line_offsets(state, camera=lens, legs=seen.print_.leg, anchors=there)
        found.across[:, basis.shape[1] + error] += (across - seen.across_px) / NUDGE
    return found


def _fill_leg(
    local: Local,
    seen: _SeenLeg,
    slopes: _Slopes,
    light: Light,
    modes_ps: Floats,
    modes: Floats,
    layout: Layout,
    here: Indices,
) -> None:
    """Write one leg's columns of `local`, and its rows of the jacobian, in the pixels `here`."""
    k, feet, across = seen.leg, seen.feet, seen.across_px
    inwards = 0.5 * light.lines[k].curvature(seen.along_px)
    spot, pulse_var = seen.spot_px, np.exp(2 * light.log_std_ps)
    design = BSpline.design_matrix(seen.along_px, light.knots[k], 3).toarray()
    local.log_photons[here, k] = np.maximum(
        design @ light.coefficients[k]
        + feet.log_share.value
        + seen.across.log_light
        + inwards * across,
        _DARK_LOG,
    )
    wider, wider_by_spline = _wider_by_bend(seen, light)
    std = np.sqrt(pulse_var + feet.variance_ps2.value + wider)
    local.std_ps[here, k] = std
    local.third_ps3[here, k] = feet.third_ps3
    ahead_px, per_px = seen.across.ahead_px, seen.print_.slope_ps_per_px
    mean_ps = seen.print_.arrival_ps + feet.offset_ps.value + per_px * ahead_px
    if seen.beam is not None:
        mean_ps -= seen.beam.early_ps
    local.arrival_ps[here, k] = mean_ps + modes_ps @ modes
    jacobian, at, splines = local.jacobian, 3 * k, layout.spline_starts[k]
    to_spline = slice(splines, splines + design.shape[1])
    to_slope = slopes_of_splines(light.knots[k], seen.along_px)
    # d ln(std) = d(variance) / (2 variance).
    to_log_std = 0.5 / std**2
    scales = np.array((np.ones_like(std), np.ones_like(std), to_log_std))
    by_path = np.zeros((3, len(here), slopes.arrival.shape[1]))
    by_spot = np.zeros((3, len(here)))
    by_growth = np.zeros((3, len(here)))
    for row, moment in enumerate((feet.log_share, feet.offset_ps, feet.variance_ps2)):
        cut = moment.by_before[:, np.newaxis] * slopes.before
        by_path[row] = cut + moment.by_after[:, np.newaxis] * slopes.after
        by_path[row] *= scales[row][:, np.newaxis]
        by_slope = scales[row] * moment.by_slope
        jacobian[here, at + row, to_spline] = by_slope[:, np.newaxis] * to_slope
        by_growth[row] = by_slope * (2.0 + (across / spot) ** 2)
        twice = 2.0 * by_slope * seen.growth
        by_spot[row] = scales[row] * moment.by_log_spot - twice * (across / spot) ** 2
        by_path[row] += (twice * across / spot**2)[:, np.newaxis] * slopes.across
    if seen.beam is not None:
        by_across, spots_of_beam, growths_of_beam, by_shares = seen.beam.follows(scales)
        by_path += by_across[:, :, np.newaxis] * slopes.across
        by_spot += spots_of_beam
        by_growth += growths_of_beam
        if layout.beam is not None:
            jacobian[here, at : at + 3, layout.beam] = by_shares[:, 0].T
        if light.own_shares:
            first = layout.own_shares[k]
            jacobian[here, at : at + 3, first : first + 2] = np.moveaxis(by_shares[:, 1:], 2, 0)
    by_spot[0] += seen.across.by_log_spot
    by_spot[1] += per_px * seen.across.ahead_by_log_spot
    by_path[0] += (seen.across.by_across + inwards)[:, np.newaxis] * slopes.across
    by_ahead = per_px * seen.across.ahead_by_across
    by_path[1] += slopes.arrival + by_ahead[:, np.newaxis] * slopes.across
    own = layout.of_path_and_shared
    for row in range(3):
        jacobian[here[:, np.newaxis], at + row, own] = by_path[row]
    if light.spots:
        first, spots = layout.spot_starts[k], light.spots[k]
        shares, growths = spots.shares(seen.along_px), spots.growth_shares(seen.along_px)
        for row in range(3):
            jacobian[here, at + row, first : first + 3] = (
                by_spot[row][:, np.newaxis] * shares + by_growth[row][:, np.newaxis] * growths
            )
    jacobian[here, at : at + 3, -2] = by_spot.T
    jacobian[here, at, to_spline] += design
    jacobian[here, at + 2, to_spline] += to_log_std[:, np.newaxis] * wider_by_spline
    jacobian[here, at + 1, layout.n_free : layout.n_free + len(modes)] = modes_ps
    jacobian[here, at + 2, -1] = pulse_var / std**2


def _wider_by_bend(seen: _SeenLeg, light: Light) -> tuple[Floats, Floats]:
    """What light that is not log-linear adds to the variance of times in a pixel, ps^2.

    Of light seen through a Gaussian spot s that is s^4 (ln I)'' times the slope of the times,
    squared (`docs/explanation/method.md`); where a corner leaves a share of the footprint, less by
    its square. Also (n, c), how it follows the coefficients of the leg's spline.
    """
    knots, coefficients = light.knots[seen.leg], light.coefficients[seen.leg]
    bends = BSpline(knots, np.eye(len(coefficients)), 3).derivative(2)(seen.along_px)
    bend = seen.spot_px**2 * (bends @ coefficients)
    lit = np.clip(np.exp(seen.feet.log_share.value), 0.0, 1.0)
    per_bend = (lit * seen.print_.slope_ps_per_px * seen.spot_px) ** 2
    believed = np.abs(bend) < _MOST_BENT
    by_spline = (per_bend * believed * seen.spot_px**2)[:, np.newaxis] * bends
    return np.clip(bend, -_MOST_BENT, _MOST_BENT) * per_bend, by_spline


def _fill_uneven(
    local: Local, uneven: LightModes, modes: Floats, layout: Layout, here: Indices, k: int
) -> None:
    """Add to `local` what light does in the pixels `here` that is more uneven than its spline."""
    last = layout.n_free + layout.n_modes
    own = slice(last - len(modes), last)
    by_photons, by_time, by_std = (local.jacobian[here, 3 * k + row] for row in range(3))
    local.log_photons[here, k] += uneven.ln[here, k] @ modes
    local.arrival_ps[here, k] += uneven.late_ps[here, k] @ modes
    by_photons[:, own], by_time[:, own] = uneven.ln[here, k], uneven.late_ps[here, k]
    before = local.std_ps[here, k] ** 2
    after = np.maximum(before + uneven.wider_ps2[here, k] @ modes, LEAST_OWN_VARIANCE * before)
    local.std_ps[here, k] = np.sqrt(after)
    by_std *= (before / after)[:, np.newaxis]
    by_std[:, own] = uneven.wider_ps2[here, k] / (2.0 * after[:, np.newaxis])
    local.jacobian[here, 3 * k : 3 * k + 3] = np.stack((by_photons, by_time, by_std), axis=1)
