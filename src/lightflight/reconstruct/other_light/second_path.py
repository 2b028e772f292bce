"""Looks for a second path: the mirror whose image of the legs the counts show best.

Every pixel says how much better its counts would fit with a pulse more at any time, its own
unknowns following. These scores are added up along the images of the legs in many mirrors; the best
of them is where a fit of the mirror starts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from lightflight.camera.stand_in import stand_in_of
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.model.cells import as_counted
from lightflight.reconstruct.model.counted import Pixels
from lightflight.reconstruct.model.pulse_shape import shape_of
from lightflight.reconstruct.model.second_path import (
    Mirror,
    Places,
    SecondPath,
    return_ps_per_mm,
)
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.other_light.around import Group, Seen
from lightflight.reconstruct.other_light.lit_places import lit_places
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_BEYOND = 0.5
"""Of the picture's longer side: light this far outside of it has its image in it, where a mirror
stands as far behind the path as that is from the camera."""
_TURNS = (-4.0, -2.0, -1.2, -0.8, -0.5, -0.35, -0.23, -0.11)
"""Tangents of a mirror's turn out of the picture's plane that are tried, with their opposites: a
turn by 6 degrees shifts the image's times along 200 mm by a pulse."""
_GAPS_MM = tuple(np.cumsum(np.concatenate(([4.0], np.geomspace(4.0, 25.0, 44)))).tolist())
"""Distances from the middle of the path that are tried, mm; a pulse of 160 ps is 24 mm. Where the
path reaches far back they go on with the last step, to half of the last of them behind its end."""
_COARSE = 12
"""Places per leg with which all mirrors are tried."""
_LAGS_STD = 0.6
"""Step of the times between which scores are looked up, in standard deviations of a pulse."""
_EARLIEST_STDS, _LATEST_PS = 4.0, 3500.0
"""Where an image's pulses are looked for about the pixel's own."""
_MOST_PIXELS = 3000
"""Of very many pixels an even sample serves."""
_MOST_MIRRORS = 4
"""Of those that are told; the next is fitted where the fit of one does not come to an end."""
LEAST_GAIN = 40.0
"""Chi-square by which the counts must be explained better. What the strengths leave unexplained
brings a mirror past it before it is fitted (in 8 of 12 undisturbed recordings), and the fit then
refuses it: no other pulse was named in 3,200 undisturbed recordings."""


def places_of_path(
    fit: JointFit, number: int, whole: Sighting, std_ps: float, *, source_told: bool
) -> Places:
    """Places along the legs with the light that they give, in the picture and about it.

    Parameters
    ----------
    fit : JointFit
        The path.
    number : int
        The recording whose picture of the path is taken.
    whole : Sighting
        All recordings alike.
    std_ps : float
        Typical standard deviation of a pulse, ps.
    source_told : bool
        Whether the path begins at its source, and not where it enters the view.

    Returns
    -------
    Places
        Outside of the picture a leg is as bright as where it leaves it; none where none is in it.
    """
    camera, medium = fit.solution.cameras[whole.view], fit.solution.medium
    beyond_px = _BEYOND * max(camera.shape)
    parts = [(np.zeros((0, 3)), *(np.zeros(0, dtype=each) for each in (int, bool, float, float)))]
    for of in lit_places(fit, number, whole, source_told=source_told, near_px=beyond_px):
        way2 = np.sum((of.points_mm - camera.center_mm) ** 2, axis=1)
        of_leg = np.full(len(of.beyond), of.leg)
        parts.append((of.points_mm, of_leg, of.beyond, of.event_ps, of.photons * way2))
    if all(beyond.all() for _, _, beyond, _, _ in parts):
        parts = parts[:1]
    points, leg, beyond, event, light = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Places(
        points, leg, beyond, event, light, fit.pictures[number].spot_std_px, std_ps,
        return_ps_per_mm(medium.return_group_index), shape_of(whole.timing.response),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Scores:
    """How counts would take a pulse more: n pixels, g times.

    Attributes
    ----------
    place : array of int, shape (rows, cols)
        Which of the n each pixel is; -1, the last of them, which says nothing: none.
    reference_ps : array of float, shape (n,)
        Arrival time at which lags are zero, ps on the clock.
    lags_ps : array of float, shape (g,)
    score, information : array of float, shape (n, g)
        Of the photons of such a pulse.
    """

    place: Indices
    reference_ps: Floats
    lags_ps: Floats
    score: Floats
    information: Floats

    def along(
        self, row: Floats, col: Floats, arrival_ps: Floats, light: Floats, spot_px: float
    ) -> Floats:
        """(c,), chi-square of light of a free strength at places (c, k) with their times."""
        (rows, cols), g = self.place.shape, len(self.lags_ps)
        # Of two mirrors in five nothing falls into the picture.
        seen = (row >= -1.0) & (row < rows) & (col >= -1.0) & (col < cols) & (light > 0.0)
        mirror, place = np.nonzero(seen)
        row, col, lag, light = (one[mirror, place] for one in (row, col, arrival_ps, light))
        # A frame of pixels that say nothing: what falls outside of the picture is looked up there.
        framed = np.pad(self.place % len(self.reference_ps), 1, constant_values=len(self.score) - 1)
        step = self.lags_ps[1] - self.lags_ps[0]
        first, lag = (self.reference_ps + self.lags_ps[0]) / step, lag / step
        score, information = self.score.ravel(), self.information.ravel()
        total, across = np.zeros((2, len(mirror))), _either_side(col, cols, spot_px)
        for r, near in _either_side(row, rows, spot_px):
            bright = light * near
            for c, too in across:
                at = framed[r, c]
                late = np.rint(np.clip(lag - first[at], 0, g - 1)).astype(np.int64)
                late += at * g
                weight = bright * too
                total[0] += weight * score[late]
                weight *= weight
                total[1] += weight * information[late]
        says, knows = (np.bincount(mirror, each, minlength=len(seen)) for each in total)
        # Light cannot be less than none.
        found: Floats = np.maximum(says, 0.0) ** 2 / np.maximum(knows, 1e-12)
        return found


def _either_side(at: Floats, size: int, spot_px: float) -> list[tuple[Indices, Floats]]:
    """The lines of a framed picture before and behind places, with the light that falls there."""
    low = np.floor(at)
    return [
        (
            (np.clip(line, -1, size) + 1).astype(np.int64),
            np.exp(-0.5 * ((line - at) / spot_px) ** 2),
        )
        for line in (low, low + 1.0)
    ]


def _scores(
    seen: Seen, pixels: Pixels, dark: Group | None, places: Places, shape: tuple[int, int]
) -> _Scores:
    std_ps = places.std_ps
    lags = np.arange(-_EARLIEST_STDS * std_ps, _LATEST_PS, _LAGS_STD * std_ps)
    parts = [_score_of(pixels, lags, places)]
    rows, cols, reference = [seen.rows], [seen.cols], [seen.arrival_ps[:, 0]]
    if dark is not None:
        some = np.unique(np.linspace(0, len(dark.points_px) - 1, _MOST_PIXELS).astype(np.int64))
        kept = np.zeros(len(dark.points_px), dtype=bool)
        kept[some] = True
        parts.append(_score_of(dark.pixels.of(kept), lags, places))
        rows.append(dark.points_px[kept, 0])
        cols.append(dark.points_px[kept, 1])
        reference.append(dark.reference_ps[kept])
    place = np.full(shape, -1)
    row, col = np.concatenate(rows), np.concatenate(cols)
    place[row, col] = np.arange(len(row))
    nothing = np.zeros((1, len(lags)))
    score, information = (np.concatenate((*part, nothing)) for part in zip(*parts, strict=True))
    # At the ends of the lags stands what lies beyond: nothing.
    score[:, [0, -1]], information[:, [0, -1]] = 0.0, 0.0
    return _Scores(place, np.append(np.concatenate(reference), 0.0), lags, score, information)


def _score_of(pixels: Pixels, lags_ps: Floats, places: Places) -> tuple[Floats, Floats]:
    """Score and information (n, g) of one photon more at each lag, own unknowns eliminated."""
    cells = pixels.cells
    z = (cells.edges_ps[:, :, np.newaxis] - lags_ps) / places.std_ps
    columns = as_counted(cells, np.diff(places.shape.come(z), axis=1))
    score, information = pixels.said_of_each(columns)
    return score, np.maximum(information, 0.0)


def second_paths_in(
    seen: Seen, pixels: Pixels, dark: Group | None, places: Places, camera: Camera
) -> tuple[SecondPath, ...]:
    """The mirrors that explain most of what the legs and their diffuse light do not.

    Parameters
    ----------
    seen : Seen
        The n pixels that the legs light.
    pixels : Pixels
        These, fitted.
    dark : Group or None
        Some that no leg lights, fitted.
    places : Places
        Of the path.
    camera : Camera
        Who sees it.

    Returns
    -------
    tuple of SecondPath
        With shares of nothing yet, the best first; (): none explains more than chance does. There
        are several, since an image that lies on its leg looks much the same in many mirrors.
    """
    scores = _scores(seen, pixels, dark, places, camera.shape)
    return tuple(SecondPath(one, places, camera) for one in _best_mirrors(scores, places, camera))


def _best_mirrors(scores: _Scores, places: Places, camera: Camera) -> list[Mirror]:
    """Of all mirrors that are tried those with more chi-square than any turned a little more."""
    # Thousands of mirrors: a stand-in tells them apart, the fit that follows sees through windows.
    per_mm = places.return_ps_per_mm
    camera, more_mm = stand_in_of(camera, per_mm * SPEED_OF_LIGHT_MM_PER_PS)
    late_ps = more_mm / SPEED_OF_LIGHT_MM_PER_PS
    places = replace(places, event_ps=places.event_ps + late_ps) if more_mm else places
    row, col = camera.pixels_from_points(places.points_mm)
    rows, cols = camera.shape
    shown = np.flatnonzero((row > -3) & (row < rows + 2) & (col > -3) & (col < cols + 2))
    few = np.concatenate([
        own[np.linspace(0, len(own) - 1, _COARSE).astype(int)]
        for own in (shown[places.leg[shown] == k] for k in range(places.n_legs)) if len(own)
    ])  # fmt: skip
    frame, gaps = _frame(camera), _gaps_of(places.points_mm[few])
    turns = np.array([*_TURNS, 0.0, *(-t for t in reversed(_TURNS))])
    highest = np.zeros((len(turns), len(turns)))
    mirrors: dict[tuple[int, int], Mirror] = {}
    for i, turn in enumerate(turns):
        # All turns the other way at once: numpy is slow to begin.
        normals = frame[2] + turn * frame[0] + turns[:, np.newaxis] * frame[1]
        directions = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        middle = np.median(directions @ places.points_mm[few].T, axis=1)
        normals = np.repeat(directions, len(gaps), axis=0)
        distances = middle[:, np.newaxis] + gaps
        value = _chi2_of(scores, places, few, camera, normals, distances.ravel())
        value = value.reshape(distances.shape)
        best = np.argmax(value, axis=1)
        highest[i] = value.max(axis=1)
        for j in np.flatnonzero(highest[i] >= LEAST_GAIN):
            distance = float(distances[j, best[j]])
            mirrors[i, int(j)] = Mirror(directions[j], distance, np.zeros(places.n_legs))
    around = np.pad(highest, 1)
    tops = highest >= sliding_window_view(around, (3, 3)).max(axis=(2, 3))
    order = sorted(mirrors, key=lambda at: -highest[at])
    return [mirrors[at] for at in order if tops[at]][:_MOST_MIRRORS]


def _gaps_of(points_mm: Floats) -> Floats:
    """(g,), distances of mirrors from the middle of a path through points (k, 3), mm."""
    step = _GAPS_MM[-1] - _GAPS_MM[-2]
    deep = np.max(np.linalg.norm(points_mm - np.median(points_mm, axis=0), axis=1))
    more = int(max(deep - _GAPS_MM[-1] / 2.0, 0.0) / step)
    gaps: Floats = np.append(_GAPS_MM, _GAPS_MM[-1] + step * np.arange(1, more + 1))
    return gaps


def _chi2_of(
    scores: _Scores,
    places: Places,
    some: Indices,
    camera: Camera,
    normals: Floats,
    distances: Floats,
) -> Floats:
    """(c,), chi-square of mirrors with normals (c, 3) at distances (c,)."""
    points = places.points_mm[some]
    behind = distances[:, np.newaxis] - normals @ points.T
    image = points + 2.0 * behind[:, :, np.newaxis] * normals[:, np.newaxis]
    row, col = camera.pixels_from_points(image)
    way = np.linalg.norm(image - camera.center_mm, axis=2)
    arrival = places.event_ps[some] + places.return_ps_per_mm * way
    light = np.where(behind > 0.0, places.light[some] / way**2, 0.0)
    return scores.along(row, col, arrival, light, places.spot_px)


def _frame(camera: Camera) -> Floats:
    """(3, 3), unit vectors down and across the picture, and away from the camera."""
    rows, cols = camera.shape
    middle = 0.5 * (rows - 1), 0.5 * (cols - 1)
    rays = camera.rays_from_pixels(
        np.array([middle[0], middle[0] + 1.0]), np.array([middle[1], middle[1]])
    )
    away = rays[0]
    down = rays[1] - (rays[1] @ away) * away
    down = down / np.linalg.norm(down)
    frame: Floats = np.array([down, np.cross(away, down), away])
    return frame
