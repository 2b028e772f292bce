"""The legs as the camera's picture measures them: lines, brightness and spot, from the counts.

Takes a path that is roughly right and a recording, gives the lines that `least_squares` holds the
legs to and the corrections that turn a pixel's time into that of its weighted footprint.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from lightflight.errors import NothingFoundError
from lightflight.flight import Medium
from lightflight.reconstruct.model.geometry import Footprint, Indices, PathState, footprints
from lightflight.reconstruct.model.image_plane import undistorted_px
from lightflight.reconstruct.model.lateral import LineFit, dark_line, fit_lines
from lightflight.reconstruct.model.leg_in_picture import DARK_LEG, LegInPicture, leg_in_picture
from lightflight.reconstruct.model.light import Diffuse
from lightflight.reconstruct.model.line_problem import Halo, LineData
from lightflight.reconstruct.model.sighting import Sighting, photons_at_times
from lightflight.reconstruct.model.spread import WIDE_PX
from lightflight.reconstruct.model.strength import span_of_knots
from lightflight.reconstruct.model.thick_beam import (
    OWN_SHARE,
    USUAL_SPOT_PX,
    clear_of_corners_px,
    share_beyond_lens,
)

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

PICTURE_REACH_PX = 3.2
"""Pixels this near to a leg's line share its light and are counted for it, px: eight stds of a
usual spot, so that dark pixels beside the line tell how wide it is."""

_LEAST_PIXELS = 4
"""Fewer pixels than this do not say where a leg's line runs; on it within half a spot, places."""
_SPOTS_LOOKED_AT = 17
"""Along a leg, on which the spot is a parabola."""
_ON_LINE_PX = 0.75
"""A pixel this near to a leg's line shows a place of it, px: one at each of a slanting line's."""


@dataclass(frozen=True, eq=False)
class LineDataInPicture:
    """Measured lines of the legs: undistorted picture points they run through.

    Attributes
    ----------
    leg : array of int, shape (A,)
        Leg of each anchor; the anchors of a leg follow each other: two, of a bent leg one more for
        each shape of its bend.
    anchors : array of float, shape (A, 2)
        Undistorted (u, v), px.
    whitening : array of float, shape (A, A)
        Turns offsets in px into independent unit-variance residuals.
    view : array of int, shape (A,)
        In which camera's picture.
    modes : array of float, shape (A, k) or None
        One-sigma columns of the last k errors that the times share, in whitened offsets; None:
        those move no line.
    """

    leg: Indices
    anchors: Floats
    whitening: Floats
    view: Indices
    modes: Floats | None = None


@dataclass(frozen=True, eq=False)
class Picture:
    """What the counts say about the legs.

    Attributes
    ----------
    legs : tuple of LegInPicture
        Lines the measurement was made about.
    fits : tuple of LineFit
        Offsets, spot and strength of each leg.
    spot_std_px : float
        Standard deviation of the spot, px.
    """

    legs: tuple[LegInPicture, ...]
    fits: tuple[LineFit, ...]
    spot_std_px: float

    @property
    def spot_variances_px2(self) -> tuple[float, float]:
        """Least and largest variance of a spot along the legs; the lens makes the least at most."""
        stds = [
            line.spot_std_at(np.linspace(*span_of_knots(line.spline.t), _SPOTS_LOOKED_AT))
            for leg, line in zip(self.legs, self.fits, strict=True)
            if not leg.dark
        ]
        all_stds = np.concatenate(stds) if stds else np.array([self.spot_std_px])
        return float(all_stds.min()) ** 2, float(all_stds.max()) ** 2


@dataclass(frozen=True, eq=False)
class _NearPixels:
    rows: Indices
    cols: Indices
    near: Bools
    along: Floats
    across: Floats


def _pixels_near(legs: Sequence[LegInPicture], camera: Camera, blind: Bools) -> _NearPixels:
    rows, cols = (index.ravel() for index in np.indices(camera.shape))
    points = undistorted_px(camera, rows, cols)
    along, across = np.empty((len(rows), len(legs))), np.empty((len(rows), len(legs)))
    near = np.zeros((len(rows), len(legs)), dtype=bool)
    for k, leg in enumerate(legs):
        along[:, k], across[:, k] = leg.along_across(points)
        inside = (along[:, k] > leg.span_px[0]) & (along[:, k] < leg.span_px[1])
        near[:, k] = inside & (np.abs(across[:, k]) < PICTURE_REACH_PX)
    keep = near.any(axis=1) & ~blind.ravel()
    return _NearPixels(rows[keep], cols[keep], near[keep], along[keep], across[keep])


def measure_picture(
    state: PathState,
    sighting: Sighting,
    *,
    camera: Camera,
    medium: Medium,
    std_ps: float,
    fine: bool = False,
    active_px: float | None = None,
    may_miss: Collection[int] = (),
) -> Picture:
    """Lines, spot and strength of all legs of a path that is roughly right.

    Parameters
    ----------
    state : PathState
        The path as it is now.
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    camera : Camera
        The camera that sees it.
    medium : Medium
        Group indices out and back.
    std_ps : float
        Typical standard deviation of a pulse, ps.
    fine : bool, optional
        Whether each leg has a spot of its own and pixels are unequal: once the legs are known, and
        only of photons.
    active_px : float, optional
        Side of the pixels' active area, in a fine picture; None: what the counts say of it.
    may_miss : collection of int, optional
        Legs that another camera may show better: dark where too few places along them are in view.

    Returns
    -------
    Picture
        One line per leg, in their order.

    Raises
    ------
    GeometryError
        Where a leg does not cross the picture.
    NothingFoundError
        Where a leg has too few pixels of its own.
    """
    legs = [
        leg_in_picture(state, k, camera) if k in state.seen else DARK_LEG
        for k in range(state.n_legs)
    ]
    if not state.seen:
        dark = (dark_line(USUAL_SPOT_PX),) * state.n_legs
        return Picture(tuple(legs), dark, USUAL_SPOT_PX)
    counted = _counted(state, legs, sighting, camera, medium, std_ps, fine=fine)
    # Scaled intensities do not scatter as photons do: of them nobody knows what is a pixel's own.
    fine = fine and sighting.histograms.poisson

    def measured(spans: dict[int, tuple[float, float]]) -> Picture:
        shown, data = _lines_told(state, legs, counted, camera, spans, may_miss)
        # All legs at once, because they share the spot.
        found = fit_lines(data, fine=fine, active_px=active_px) if data else []
        spot = found[0].spot_std_px if found else USUAL_SPOT_PX
        fits = [dark_line(spot)] * len(shown)
        told = (k for k in state.seen if not shown[k].dark)
        for k, line in zip(told, found, strict=True):
            fits[k] = line
        return Picture(shown, tuple(fits), spot)

    def clear(spot_px: float) -> dict[int, tuple[float, float]]:
        return {k: _clear_span(legs[k], k, state, camera, spot_px) for k in state.seen}

    usual = clear(USUAL_SPOT_PX)
    picture = measured(usual)
    # The wider the spot, the farther from a corner its light is cut.
    spans = clear(picture.spot_std_px)
    return picture if spans == usual else measured(spans)


@dataclass(frozen=True, eq=False)
class _Counted:
    """What the counts hold of the n pixels near the legs; (n, L) each."""

    pixels: _NearPixels
    photons: Floats
    empty: Floats
    halo: Floats
    unknown: Floats
    blended: Bools
    diffuse: Diffuse | None


def _counted(
    state: PathState,
    legs: Sequence[LegInPicture],
    sighting: Sighting,
    camera: Camera,
    medium: Medium,
    std_ps: float,
    *,
    fine: bool,
) -> _Counted:
    """Photons of each leg in the pixels near it, and whose light is mixed with another's."""
    pixels = _pixels_near(legs, camera, sighting.blind)
    arrival, width = _times_of_legs(state, pixels, camera, medium, std_ps)
    photons, empty = photons_at_times(sighting, pixels.rows, pixels.cols, arrival, width)
    halo, unknown, diffuse = np.zeros(photons.shape), np.zeros((len(photons), 0)), None
    if fine and sighting.diffuse is not None and sighting.diffuse.has_halo:
        # A halo is as bright as the line that it is of: what it adds says how bright that is.
        diffuse = sighting.diffuse
        bare = replace(sighting, diffuse=diffuse.without_halo())
        bright, empty = photons_at_times(bare, pixels.rows, pixels.cols, arrival, width)
        halo = np.maximum(bright - photons, 0.0)
        unknown = diffuse.halo_unknown(pixels.rows, pixels.cols, camera.shape)
    return _Counted(pixels, photons, empty, halo, unknown, _blended(arrival, width), diffuse)


def _lines_told(
    state: PathState,
    legs: Sequence[LegInPicture],
    counted: _Counted,
    camera: Camera,
    spans: dict[int, tuple[float, float]],
    may_miss: Collection[int],
) -> tuple[tuple[LegInPicture, ...], list[LineData]]:
    """Legs of which the pixels tell a line, the others dark, and those pixels leg by leg."""
    shown, data, pixels = list(legs), [], counted.pixels
    for k in state.seen:
        first, last = spans[k]
        clear = (pixels.along[:, k] > first) & (pixels.along[:, k] < last)
        seen = pixels.near[:, k] & np.isfinite(counted.empty[:, k])
        own = seen & ~counted.blended[:, k]
        on_line = own & clear & (np.abs(pixels.across[:, k]) < _ON_LINE_PX)
        if k in may_miss and len(np.unique(np.rint(pixels.along[on_line, k]))) < _LEAST_PIXELS:
            shown[k] = DARK_LEG
            continue
        # A leg of few pixels takes those it shares as well: better a rough line than none.
        use = next((some for some in (own & clear, own, seen) if some.sum() >= _LEAST_PIXELS), own)
        if use.sum() < _LEAST_PIXELS:
            raise NothingFoundError(
                f"leg {k + 1} of the path has {int(use.sum())} pixels of its own in the picture, "
                "too few to say where it runs: give a smaller n_legs or another start"
            )
        of_bend = sum(bend.orders for bend in state.bends if bend.leg == k)
        places = pixels.along[use, k], pixels.across[use, k]
        spread = (
            None
            if counted.diffuse is None
            else _halo_of_leg(
                counted.diffuse,
                k,
                legs[k],
                camera,
                places,
                counted.halo[use, k],
                counted.unknown[use],
            )
        )
        photons = counted.photons[use, k] + (0.0 if spread is None else spread.photons)
        data.append(
            LineData(
                *places, photons, counted.empty[use, k], n_offsets=2 + of_bend,
                heading_rad=legs[k].heading_rad(places[0]), halo=spread,
            )
        )  # fmt: skip
    return tuple(shown), data


def _times_of_legs(
    state: PathState, pixels: _NearPixels, camera: Camera, medium: Medium, std_ps: float
) -> tuple[Floats, Floats]:
    """When each leg's light comes to pixels, and how wide its pulse is there, (n, L); ps."""
    arrival = np.full(pixels.near.shape, np.nan)
    width = np.full(pixels.near.shape, std_ps)
    for k in state.seen:
        here = pixels.near[:, k]
        print_ = footprints(
            state,
            camera=camera,
            medium=medium,
            legs=k,
            rows=pixels.rows[here],
            cols=pixels.cols[here],
        )
        arrival[here, k] = print_.arrival_ps
        # Across a pixel the time runs by the slope: a third of that is its spread.
        width[here, k] = np.hypot(std_ps, 0.35 * print_.slope_ps_per_px)
    return arrival, width


def _halo_of_leg(
    diffuse: Diffuse,
    k: int,
    leg: LegInPicture,
    camera: Camera,
    places: tuple[Floats, Floats],
    photons: Floats,
    unknown: Floats,
) -> Halo | None:
    """A leg's halo among the photons at some places along and across; None: no light is told of."""
    own = diffuse.beam.of(diffuse.beam.leg == k)
    if len(own.photons) < 2:
        return None
    along = leg.along_across(undistorted_px(camera, *own.points_px.T))[0]
    per_px = np.maximum(own.photons / np.maximum(np.abs(np.gradient(along)), 1e-9), 1e-9)
    gap2 = np.subtract.outer(places[0], along) ** 2 + places[1][:, np.newaxis] ** 2
    shares = np.zeros(gap2.shape)
    for share, reach in zip(diffuse.strengths.wide[: len(WIDE_PX)], WIDE_PX, strict=True):
        shares += share / reach**2 * np.exp(-0.5 * gap2 / reach**2)
    # Where there is less than none, from all places alike.
    shares = np.maximum(shares, 1e-12) * own.photons
    return Halo(photons, along, np.log(per_px), shares / shares.sum(axis=1, keepdims=True), unknown)


def _clear_span(
    leg: LegInPicture, k: int, state: PathState, camera: Camera, spot_px: float
) -> tuple[float, float]:
    """Span without the neighbourhood of corners, where two legs share the pixels."""
    first, last = leg.span_px
    before, after = clear_of_corners_px(state, k, camera, spot_px, share=share_beyond_lens(spot_px))
    return (
        first + (before if k > 0 else 0.0),
        last - (0.0 if k in state.last_legs else after),
    )


def _blended(arrival: Floats, width: Floats) -> Bools:
    """True where another leg's pulse is too near in time to tell the two apart."""
    blended = np.zeros(arrival.shape, dtype=bool)
    for a in range(arrival.shape[1]):
        for b in range(arrival.shape[1]):
            if a != b:
                with np.errstate(invalid="ignore"):
                    gap = np.abs(arrival[:, a] - arrival[:, b])
                    blended[:, a] |= gap < 1.5 * (width[:, a] + width[:, b])
    return blended


def lines_from_picture(picture: Picture, view: int) -> LineDataInPicture:
    """Anchors through which the legs' images must run, with their errors.

    Parameters
    ----------
    picture : Picture
        Lines, brightness and spot of the legs, as the counts showed them.
    view : int
        The camera whose picture it is.

    Returns
    -------
    LineDataInPicture
        Two anchors per straight leg.
    """
    legs: list[int] = []
    anchors: list[Floats] = []
    blocks: list[Floats] = []
    for k, (leg, fit) in enumerate(zip(picture.legs, picture.fits, strict=True)):
        if leg.dark:
            continue
        along, offset = np.array(fit.anchors_along_px), np.array(fit.offset_px)
        if leg.bent:
            # What was measured is the ridge of the light, inside of the curve.
            offset = offset - 0.5 * fit.spot_std_at(along) ** 2 * leg.curvature(along)
        anchors.extend(leg.points_px(along, offset))
        legs.extend([k] * len(fit.anchors_along_px))
        # Two anchors measured alike leave no room for Cholesky: 1e-5 px keeps it.
        covariance = fit.offset_covariance + 1e-10 * np.eye(len(fit.offset_px))
        blocks.append(np.linalg.inv(np.linalg.cholesky(covariance)))
    whitening = block_diag(*blocks) if blocks else np.zeros((0, 0))
    of_leg = np.array(legs, dtype=np.int64)
    places = np.array(anchors).reshape(-1, 2)
    return LineDataInPicture(of_leg, places, whitening, np.full(len(legs), view))


def footprint_corrections(
    picture: Picture,
    print_: Footprint,
    *,
    rows: Floats,
    cols: Floats,
    camera: Camera,
    state: PathState,
    medium: Medium,
) -> Floats:
    """Mean arrival time over each pixel's weighted footprint, minus that at its foot; (n,), ps.

    With strength a(s) on the line and a spot of variance v, the mean over the footprint is
    t_a + v (t_a' a'/a + t_a''/2): 1.5 ps where brightness changes by 30 % per pixel. What of a
    spot is the beam's spreads no light along the leg (`LineFit.looks_ahead`). A large active area
    looks ahead of the foot or behind it: t_a' times that is added (`seen_line`).

    Parameters
    ----------
    picture : Picture
        Lines, brightness and spot of the legs, as the counts showed them.
    print_ : Footprint
        Where each pixel looks along its leg.
    rows : array of float, shape (n,)
        Pixel rows.
    cols : array of float, shape (n,)
        Pixel columns.
    camera : Camera
        The camera that sees it.
    state : PathState
        The path as it is now.
    medium : Medium
        Group indices out and back.

    Returns
    -------
    array of float, shape (n,)
        ps.
    """
    points = undistorted_px(camera, rows, cols)
    lens, _ = picture.spot_variances_px2
    variance, ahead = np.zeros((2, len(rows)))
    for k, (leg, fit) in enumerate(zip(picture.legs, picture.fits, strict=True)):
        here = print_.leg == k
        along, across = leg.along_across(points[here])
        ahead[here], variance[here] = fit.looks_ahead(
            along, across, lens_var_px2=lens, own_share=OWN_SHARE
        )
        ahead[here] += fit.seen(along, across, leg.heading_rad(along)).ahead_px
    curvature = arrival_curvature(print_, state=state, camera=camera, medium=medium)
    correction: Floats = print_.slope_ps_per_px * ahead + 0.5 * variance * curvature
    return correction


def arrival_curvature(
    print_: Footprint, *, state: PathState, camera: Camera, medium: Medium
) -> Floats:
    """d^2 t_a / d(picture length)^2 at each foot, ps per px^2.

    Parameters
    ----------
    print_ : Footprint
        Where each pixel looks along its leg.
    state : PathState
        The path as it is now.
    camera : Camera
        The camera that sees it.
    medium : Medium
        Group indices out and back.

    Returns
    -------
    array of float, shape (n,)
        ps per px^2; 0 where the picture cannot tell.
    """
    # Half a pixel to each side: the footprint's own scale.
    half_px = 0.5
    values, places = [], []
    for side in (-1.0, 0.0, 1.0):
        fraction = print_.fraction + side * half_px / print_.px_per_leg
        points = state.points_mm(print_.leg, fraction)
        event = state.event_times_ps(print_.leg, fraction, medium)
        back = camera.return_times_ps(points, return_group_index=medium.return_group_index)
        values.append(event + back)
        places.append(np.column_stack(camera.pixels_from_points(points)))
    before = np.linalg.norm(places[1] - places[0], axis=1)
    after = np.linalg.norm(places[2] - places[1], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        bend = ((values[2] - values[1]) / after - (values[1] - values[0]) / before) / (
            0.5 * (before + after)
        )
    finite: Floats = np.nan_to_num(bend, nan=0.0, posinf=0.0, neginf=0.0)
    return finite
