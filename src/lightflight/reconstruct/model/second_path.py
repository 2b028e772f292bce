"""The light of a second path: a flat mirror (wall, window, table) shows the path once more.

The image x' = x + 2 (d - n x) n of a place sends its light to the camera at the same event time,
over a longer way, with a share of the light of each leg. One plane and these shares say where its
light falls in every pixel and when, also where its pulses merge with those of the path.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.path.verdict import FindingName
from lightflight.reconstruct.model.cells import Cells, as_counted
from lightflight.reconstruct.model.pulse_shape import GAUSSIAN, Shape
from lightflight.reconstruct.model.sizes import PLAUSIBLE
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_REACH_SPOTS = 4.5
"""Light of a place falls this far in the picture, in standard deviations of the spot."""
_FAINT = 1e-3
"""Fewer photons than this in a pixel are none."""
_GATE_STDS = 4.0
"""A pulse this near to the time of an image may be the image's, in standard deviations."""
_PLANE_PRIOR = (1.0, 1.0, 1e-6)
"""Precision of what is known of a mirror beforehand: turns to 1 rad, its distance to 1 m."""
_FAR_PLANE, _LONGEST_SHARE = (0.05, 0.05, 5.0), 0.3
"""Most that a mirror turns, rad, and moves, mm, in a round: its image stays on the same pulses; and
most that a share moves."""
_STEPS = (1e-4, 1e-4, 0.02)
"""Steps of derivatives by the plane: two turns, rad, and its distance, mm."""


@dataclass(frozen=True, eq=False)
class Places:
    """Places along the legs, as far as a picture could show them or their images.

    Attributes
    ----------
    points_mm : array of float, shape (k, 3)
    leg : array of int, shape (k,)
    beyond : array of bool, shape (k,)
        True where the picture does not show the leg: its light there is a guess.
    event_ps : array of float, shape (k,)
        When the pulse is there.
    light : array of float, shape (k,)
        Photons per pixel on its line times the square of its way to the camera, mm^2 px.
    spot_px : float
        Standard deviation of the spot, px.
    std_ps : float
        Standard deviation of a pulse, ps.
    return_ps_per_mm : float
        Time that a mm of the way to the camera takes.
    shape : Shape
        Of a pulse.
    """

    points_mm: Floats
    leg: Indices
    beyond: NDArray[np.bool_]
    event_ps: Floats
    light: Floats
    spot_px: float
    std_ps: float
    return_ps_per_mm: float
    shape: Shape = GAUSSIAN

    @property
    def n_legs(self) -> int:
        """Number of legs."""
        return int(self.leg.max(initial=-1)) + 1


def return_ps_per_mm(index: float) -> float:
    """Time that a mm of the way to the camera takes at a group index, ps."""
    return index / SPEED_OF_LIGHT_MM_PER_PS


@dataclass(frozen=True, eq=False)
class Mirror:
    """A flat mirror, and the share of each leg's light that it sends on.

    Attributes
    ----------
    normal : array of float, shape (3,)
        Unit, away from the path.
    distance_mm : float
        Of the plane: n x = d.
    share : array of float, shape (L,)
        Of the light that goes straight to the camera from as far away.
    """

    normal: Floats
    distance_mm: float
    share: Floats

    def moved(self, step: Floats) -> Mirror:
        """After two turns, rad, a shift, mm, and steps of the shares (L,)."""
        normal = self.normal + step[:2] @ self.across()
        share = self.share + step[3:]
        return Mirror(normal / np.linalg.norm(normal), self.distance_mm + float(step[2]), share)

    def across(self) -> Floats:
        """(2, 3), unit vectors in the plane."""
        rows: Floats = np.linalg.svd(self.normal[np.newaxis])[2][1:]
        return rows

    def image_of(self, points_mm: Floats) -> Floats:
        """(k, 3), where points are seen, mm."""
        behind = self.distance_mm - points_mm @ self.normal
        image: Floats = points_mm + 2.0 * behind[:, np.newaxis] * self.normal
        return image


@dataclass(frozen=True, eq=False)
class Glow:
    """Light of the images of the legs in n pixels, (n, 2 L), or in a picture, (rows, cols, 2 L).

    The first L are of what the picture shows of the legs, the others of what lies beyond it.

    Attributes
    ----------
    photons : array of float
        At a share of one.
    arrival_ps, std_ps : array of float
        Its mean time on the clock, and the standard deviation about it, ps.
    shape : Shape
        Of its pulses; that of pixel (r, c) of a picture is the (cols r + c)-th.
    own_ps : float
        Standard deviation of a pulse before flight draws it out, ps.
    """

    photons: Floats
    arrival_ps: Floats
    std_ps: Floats
    shape: Shape
    own_ps: float

    def at(self, rows: Indices, cols: Indices) -> Glow:
        """Some pixels (n,) of a picture."""
        flat = rows * self.photons.shape[1] + cols
        return replace(
            self,
            photons=self.photons[rows, cols],
            arrival_ps=self.arrival_ps[rows, cols],
            std_ps=self.std_ps[rows, cols],
            shape=self.shape.of(flat),
        )

    def come(self, lit: Indices, leg: int, late_ps: Floats) -> Floats:
        """Share of the light of one leg in some pixels (k,) that came by times (k, m), ps."""
        std = self.std_ps[lit, leg, np.newaxis] if self.shape.is_gaussian else self.own_ps
        return self.shape.of(lit, leg).come(late_ps / std)


Images = tuple[Glow, ...]
"""A mirror's pictures: as it stands and, with light, a step on and back of each of `_STEPS`."""


def glow(mirror: Mirror, places: Places, camera: Camera) -> Glow:
    """Photons, mean time and width of each leg's image in the picture, at a share of one."""
    image = mirror.image_of(places.points_mm)
    row, col = camera.pixels_from_points(image)
    way = np.linalg.norm(image - camera.center_mm, axis=1)
    index = places.return_ps_per_mm * SPEED_OF_LIGHT_MM_PER_PS
    arrival = places.event_ps + camera.return_times_ps(image, return_group_index=index)
    spot, (n_rows, n_cols) = places.spot_px, camera.shape
    half = int(np.ceil(_REACH_SPOTS * spot))
    with np.errstate(invalid="ignore"):
        seen = (np.abs(row - 0.5 * n_rows) < 0.5 * n_rows + half) & (
            np.abs(col - 0.5 * n_cols) < 0.5 * n_cols + half
        )
    # What flies beyond the plane has no image.
    seen &= places.points_mm @ mirror.normal < mirror.distance_mm
    found, times, stds = np.zeros((3, n_rows, n_cols, 2 * places.n_legs))
    stds[:] = places.std_ps
    part_of = places.leg + places.n_legs * places.beyond
    window = np.arange(-half, half + 1)
    for k in range(found.shape[2]):
        own = np.flatnonzero(seen & (part_of == k))
        if not len(own):
            continue
        down, across = (np.rint(each[own])[:, np.newaxis] + window for each in (row, col))
        gaps = ((down - row[own, np.newaxis]) ** 2, (across - col[own, np.newaxis]) ** 2)
        part = [np.exp(-0.5 * gap / spot**2) for gap in gaps]
        inside = [
            (each >= 0) & (each < size)
            for each, size in zip((down, across), camera.shape, strict=True)
        ]
        light = places.light[own] / way[own] ** 2 / (2.0 * np.pi * spot**2)
        weight = (light[:, np.newaxis] * part[0] * inside[0])[:, :, np.newaxis]
        weight = weight * (part[1] * inside[1])[:, np.newaxis]
        pixel = np.clip(down, 0, n_rows - 1)[:, :, np.newaxis] * n_cols
        pixel = (pixel + np.clip(across, 0, n_cols - 1)[:, np.newaxis]).astype(np.int64)
        middle = float(np.median(arrival[own]))
        late = (arrival[own] - middle)[:, np.newaxis, np.newaxis]
        photons, first, second = (
            np.bincount(pixel.ravel(), (weight * late**j).ravel(), n_rows * n_cols).reshape(
                n_rows, n_cols
            )
            for j in range(3)
        )
        safe = np.maximum(photons, 1e-300)
        mean, square = first / safe, second / safe
        found[:, :, k], times[:, :, k] = photons, middle + mean
        stds[:, :, k] = np.sqrt(np.maximum(square - mean**2, 0.0) + places.std_ps**2)
    flight = 0.5 * ((stds / places.std_ps) ** 2 - 1.0)
    shape = places.shape.drawn_out(flight.reshape(-1, 2 * places.n_legs))
    return Glow(found, times, stds, shape, places.std_ps)


def in_cells(shown: Glow, cells: Cells, reference_ps: Floats) -> Floats:
    """(n, m, 2 L): counts of the images in cells of the pixels, at a share of one."""
    out = np.zeros((*cells.counts.shape, shown.photons.shape[1]))
    for k in range(shown.photons.shape[1]):
        lit = np.flatnonzero(shown.photons[:, k] > _FAINT)
        late = shown.arrival_ps[lit, k] - reference_ps[lit]
        come = shown.come(lit, k, cells.edges_ps[lit] - late[:, np.newaxis])
        out[lit, :, k] = shown.photons[lit, k, np.newaxis] * np.diff(come, axis=1)
    return as_counted(cells, out)


@dataclass(frozen=True, eq=False)
class SecondPath:
    """A mirror, and the places whose light it sends to a camera.

    Attributes
    ----------
    mirror : Mirror
    places : Places
    camera : Camera
    """

    mirror: Mirror
    places: Places
    camera: Camera

    @property
    def size(self) -> int:
        """Unknowns: two turns, the distance, and a share for each leg."""
        return 3 + len(self.mirror.share)

    @property
    def value(self) -> Floats:
        """(3 + L,), what priors hold: a plane is as likely as any other, shares are not."""
        return np.append(np.zeros(3), self.mirror.share)

    @property
    def precision(self) -> Floats:
        """(3 + L,), of what is known of them beforehand."""
        of_share = PLAUSIBLE[FindingName.HAZE].size ** -2.0
        return np.append(_PLANE_PRIOR, np.full(len(self.mirror.share), of_share))

    @property
    def longest(self) -> Floats:
        """(3 + L,), most that they move in a round."""
        return np.append(_FAR_PLANE, np.full(len(self.mirror.share), _LONGEST_SHARE))

    def moved(self, step: Floats) -> SecondPath:
        """After a step of the unknowns."""
        return replace(self, mirror=self.mirror.moved(step))

    def times(self, factor: float) -> SecondPath:
        """The same of a recording `factor` times as long."""
        return replace(self, places=replace(self.places, light=factor * self.places.light))

    def of_width(self, std_ps: float) -> SecondPath:
        """The same of pulses of this standard deviation, ps."""
        return replace(self, places=replace(self.places, std_ps=std_ps))

    def images(self) -> Images:
        """The pictures from which `light` tells counts and how they follow the unknowns."""
        mirrors = [self.mirror]
        # Of images without light none changes as their mirror moves: a search begins with those.
        if not self.mirror.share.any():
            return (glow(self.mirror, self.places, self.camera),)
        for step in np.diag(np.append(_STEPS, np.zeros(self.size - 3)))[:3]:
            mirrors.extend((self.mirror.moved(step), self.mirror.moved(-step)))
        return tuple(glow(mirror, self.places, self.camera) for mirror in mirrors)

    def light(
        self,
        cells: Cells,
        rows: Indices,
        cols: Indices,
        reference_ps: Floats,
        images: Images | None = None,
    ) -> tuple[Floats, Floats, Floats]:
        """Counts in cells of pixels, and how they follow the unknowns.

        Of all images (n, m), of what lies beyond the picture alone (n, m), and derivatives
        (n, m, 3 + L). `images` are those of `images()`, where they are drawn already.
        """
        drawn = self.images() if images is None else images
        here, *moved = (in_cells(each.at(rows, cols), cells, reference_ps) for each in drawn)
        share, by_plane = self.mirror.share, np.zeros((*cells.counts.shape, len(_STEPS)))
        for k, (ahead, back) in enumerate(zip(moved[::2], moved[1::2], strict=True)):
            by_plane[:, :, k] = (ahead - back) @ self._shares / (2.0 * _STEPS[k])
        shown, beyond = np.split(here, 2, axis=2)
        by_share = shown + beyond
        columns = np.concatenate((by_plane, by_share), axis=2)
        return by_share @ share, beyond @ share, columns

    @property
    def _shares(self) -> Floats:
        """(2 L,), of what the picture shows of the legs and of what it does not."""
        return np.tile(self.mirror.share, 2)

    def shows(
        self, rows: Indices, cols: Indices, arrival_ps: Floats, photons: Floats
    ) -> NDArray[np.bool_]:
        """(n,), True for pulses of which the images bring at least half of the light."""
        shown = glow(self.mirror, self.places, self.camera).at(rows, cols)
        near = np.abs(shown.arrival_ps - arrival_ps[:, np.newaxis]) < _GATE_STDS * shown.std_ps
        brought = np.sum(near * self._shares * shown.photons, axis=1)
        mostly: NDArray[np.bool_] = brought > 0.5 * photons
        return mostly

    @property
    def behind_mm(self) -> float:
        """Of the plane, from the nearest place that the picture shows, mm."""
        shown = self.places.points_mm[~self.places.beyond]
        return float(np.min(self.mirror.distance_mm - shown @ self.mirror.normal))

    @property
    def mean_share(self) -> float:
        """Of the light of all legs, by their light in the picture."""
        shown = ~self.places.beyond
        light = np.bincount(
            self.places.leg[shown], self.places.light[shown], len(self.mirror.share)
        )
        return float(light @ self.mirror.share / light.sum())

    def guessed(self) -> Floats:
        """(rows, cols), photons of the images of what the picture does not show."""
        n_legs = len(self.mirror.share)
        photons = glow(self.mirror, self.places, self.camera).photons
        guessed: Floats = photons[:, :, n_legs:] @ self.mirror.share
        return guessed

    def counts(
        self,
        rows: Indices,
        cols: Indices,
        intervals_ps: tuple[Floats, Floats],
        period_ps: float,
        *,
        only_guessed: bool = False,
    ) -> Floats:
        """(n, codes), counts in codes from, to `intervals_ps`, on the clock of arrivals.

        With `only_guessed` of the images alone of what the picture does not show.
        """
        shown = glow(self.mirror, self.places, self.camera).at(rows, cols)
        out = np.zeros(intervals_ps[0].shape)
        n_legs = len(self.mirror.share)
        for k in range(n_legs if only_guessed else 0, 2 * n_legs):
            share = self._shares[k]
            lit = np.flatnonzero(shown.photons[:, k] > _FAINT)
            late = shown.arrival_ps[lit, k, np.newaxis]
            low, up = (each[lit] - late for each in intervals_ps)
            if period_ps > 0.0:
                lap = period_ps * np.rint(0.5 * (low + up) / period_ps)
                low, up = low - lap, up - lap
            part = np.maximum(shown.come(lit, k, up) - shown.come(lit, k, low), 0.0)
            out[lit] += share * shown.photons[lit, k, np.newaxis] * part
        return out
