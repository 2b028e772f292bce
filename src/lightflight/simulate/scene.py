"""Scene: the laboratory as it truly is, for the digital twin.

Takes vertices of a path, a camera, a source and a detector; `light.py` draws photons from it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.arguments import check_kinds, finite_number, finite_numbers, one_of
from lightflight.camera.refraction import refuse_other_medium
from lightflight.display import Card, Shown, number, size_facts
from lightflight.flight import Medium, Source, event_times_from_vertices
from lightflight.path.glass import Faced, Flown, late_ps, refuse_other_crossings, with_faces
from lightflight.path.light_path import FARTHEST_MM
from lightflight.path.tree import (
    Forks,
    checked_forks,
    leg_starts,
    way_before,
    ways,
)
from lightflight.simulate.detector import Detector
from lightflight.simulate.scattering import Scattering, polarizations_from_vertices

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]
_PARTS = ("camera", "source", "medium", "detector")
Brightness = Callable[[Floats], ArrayLike] | Sequence[ArrayLike] | ArrayLike | None


def _checked_vertices(vertices_mm: ArrayLike, forks: object) -> tuple[Floats, Forks]:
    must = f"be positions in mm, finite and within {FARTHEST_MM:g} mm"
    far = FARTHEST_MM
    vertices = finite_numbers("vertices_mm", vertices_mm, must, low=-far, high=far)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or len(vertices) < 2:
        raise ValueError(
            f"vertices_mm must have shape (m, 3) with m >= 2, got {vertices.shape}: "
            "give source, mirrors and end of the path"
        )
    told = checked_forks(forks, len(vertices) - 1)
    starts = leg_starts(len(vertices) - 1, told)
    lengths = np.linalg.norm(vertices[1:] - vertices[starts], axis=1)
    if (lengths < 1e-9).any():
        leg = int(np.argmin(lengths))
        raise ValueError(f"vertices {starts[leg]} and {leg + 1} are the same point: remove one")
    # A frozen record must not change under the light that is drawn from it.
    vertices.setflags(write=False)
    return vertices, told


_MOST_VERTICES = 6
"""Corners of a scene that are told on a terminal."""


@dataclass(frozen=True, eq=False, repr=False)
class Scene(Shown):
    """A pulse on a path of straight legs, seen by a camera.

    `source` may say what an experimenter would know (position with an error, emission time
    unknown); what is true is in `vertices_mm` and in the fields named `true_...`, which stand in
    wherever `source` leaves a number open.

    Attributes
    ----------
    vertices_mm : ArrayLike
        (m, 3), source, mirrors, end; world, mm.
    camera : Camera
        The camera that looks on.
    source : Source
        What is known of the source. Its emission time and pulse width are true where given.
    medium : Medium
        The medium the light crosses. A leg that crosses one of its blocks of glass is bent at the
        faces and late behind them; none of the light that is scattered within glass is seen.
    detector : Detector
        What catches the light and writes the recording.
    brightness : Brightness
        Scattering strength per mm of path, relative. None: the same everywhere. A function of the
        path length from the source (mm, array in and out), or one number per leg, or a table
        (lengths_mm, strengths), interpolated linearly.
    background : float or ArrayLike
        Background light: expected counts per pixel over the whole recording, at any time alike,
        before any is lost to earlier photons; one number, or (rows, cols).
    true_emission_time_ps : float
        When the pulse leaves the first vertex, ps, where `source` does not say.
    true_pulse_fwhm_ps : float
        Full width at half maximum of the laser pulse, ps, where `source` does not say.
    beam_diameter_mm : float
        1/e^2 diameter of the (Gaussian) beam, mm. 0: a line.
    scattering : Scattering
        "uniform": alike in all directions. "rayleigh": by Rayleigh's phase function.
    polarization : ArrayLike or None
        (3,), direction of the field on the first leg, world; None: unpolarised.
    inverse_square : bool
        Light thins with the square of the distance to the camera.
    cos4_falloff : bool
        The lens darkens towards the rim of its field.
    vignetting : float
        Share of light that the lens's mount holds back in the farthest corner of the picture; it
        grows with the fourth power of the distance from the optical axis. 0: none.
    forks : tuple of (int, int)
        Legs that begin at another vertex than the end of the leg before, each (leg, vertex): at a
        beam splitter two legs leave. `brightness` says, leg by leg, how much light goes where.
    """

    vertices_mm: ArrayLike

    camera: Camera = field(kw_only=True)

    source: Source = field(default_factory=Source, kw_only=True)

    medium: Medium = field(default_factory=Medium, kw_only=True)

    detector: Detector = field(default_factory=Detector, kw_only=True)

    brightness: Brightness = field(default=None, kw_only=True)

    background: float | ArrayLike = field(default=0.0, kw_only=True)

    true_emission_time_ps: float = field(default=2000.0, kw_only=True)

    true_pulse_fwhm_ps: float = field(default=68.0, kw_only=True)

    beam_diameter_mm: float = field(default=0.0, kw_only=True)

    scattering: Scattering = field(default="uniform", kw_only=True)

    polarization: ArrayLike | None = field(default=None, kw_only=True)

    inverse_square: bool = field(default=True, kw_only=True)

    cos4_falloff: bool = field(default=False, kw_only=True)

    vignetting: float = field(default=0.0, kw_only=True)

    forks: tuple[tuple[int, int], ...] = field(default=(), kw_only=True)

    def _card(self) -> Card:
        places = [
            f"({', '.join(number(x, 5) for x in v)}) mm" for v in np.asarray(self.vertices_mm)
        ]
        background = float(np.mean(np.asarray(self.background, dtype=float)))
        more = len(places) - _MOST_VERTICES
        light = "even" if self.brightness is None else "uneven"
        return Card(
            "Scene",
            [
                *((f"vertex {k}", place) for k, place in enumerate(places[:_MOST_VERTICES])),
                *((("", f"and {more} more"),) if more > 0 else ()),
                *size_facts(self.camera.shape),
                ("leaves at", f"{number(self.true_emission_time_ps, 6)} ps"),
                ("pulse", f"{number(self.true_pulse_fwhm_ps)} ps wide (FWHM)"),
                ("light", f"{light} along the path, {self.scattering} scattering"),
                ("background", f"{number(background)} photons a pixel"),
            ],
        )

    def __post_init__(self) -> None:
        vertices, forks = _checked_vertices(self.vertices_mm, self.forks)
        object.__setattr__(self, "vertices_mm", vertices)
        object.__setattr__(self, "forks", forks)
        check_kinds(*_PARTS, **{name: getattr(self, name) for name in _PARTS})
        refuse_other_medium(self.camera, self.medium)
        must = "be finite and >= 0: it is an expected count"
        background = finite_numbers("background", self.background, must, low=0.0)
        if background.shape not in ((), self.camera.shape):
            raise ValueError(
                f"background has shape {background.shape} but the camera has "
                f"{self.camera.shape} pixels: give one number or one per pixel"
            )
        finite_number("true_emission_time_ps", self.true_emission_time_ps)
        for name in ("true_pulse_fwhm_ps", "beam_diameter_mm"):
            finite_number(name, getattr(self, name), "be finite and not negative", low=0.0)
        must = "lie between 0 and 1"
        finite_number("vignetting", self.vignetting, must, low=0.0, high=1.0)
        one_of("scattering", self.scattering, ("uniform", "rayleigh"))
        if self.polarization is not None:
            if forks:
                raise ValueError(
                    "polarization cannot be told of a path that forks: what a splitter does to the "
                    "field is not modelled; leave it out"
                )
            polarizations_from_vertices(vertices, self.polarization)
        object.__setattr__(self, "_strength", _strength_from(self.brightness, self.n_legs))
        object.__setattr__(self, "_flown", self._with_faces(vertices))

    def _with_faces(self, vertices: Floats) -> Faced:
        """The path with the places where it meets faces of glass."""
        blocks = self.medium.blocks
        if not blocks:
            return Faced(vertices, (), np.arange(len(vertices) - 1))
        if self.forks or self.polarization is not None:
            raise ValueError(
                "a path through blocks of glass can neither fork nor be polarised: leave the "
                "blocks out, or forks and polarization"
            )
        flown = with_faces(vertices, blocks)
        refuse_other_crossings(flown.vertices_mm, blocks)
        flown.vertices_mm.setflags(write=False)
        return flown

    _flown: Faced = field(default=None, init=False, repr=False)  # type: ignore[assignment]

    _strength: Callable[[Floats, int], Floats] = field(
        default=None,  # type: ignore[assignment]
        init=False,
        repr=False,
    )

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of the camera."""
        return self.camera.shape

    @property
    def n_legs(self) -> int:
        """Number of straight legs."""
        return len(np.asarray(self.vertices_mm)) - 1

    @property
    def flown_mm(self) -> Floats:
        """(m + 2 k,), the vertices, and between them the places where light meets k blocks; mm."""
        return self._flown.vertices_mm

    @property
    def n_pieces(self) -> int:
        """Number of straight pieces: legs, of which one that crosses a block is three."""
        return len(self.flown_mm) - 1

    @property
    def leg_starts_mm(self) -> Floats:
        """(n_pieces,), path length from the first vertex to where each piece begins, mm."""
        starts = leg_starts(self.n_pieces, self.forks)
        return way_before(starts, np.linalg.norm(self.leg_steps_mm, axis=1))[starts]

    @property
    def leg_steps_mm(self) -> Floats:
        """(n_pieces, 3), from where each piece begins to its end, mm."""
        vertices = self.flown_mm
        steps: Floats = vertices[1:] - vertices[leg_starts(self.n_pieces, self.forks)]
        return steps

    @property
    def emission_time_ps(self) -> float:
        """True time at which the pulse leaves the first vertex, ps."""
        known = self.source.emission_time_ps
        return self.true_emission_time_ps if known is None else known

    @property
    def pulse_fwhm_ps(self) -> float:
        """True full width at half maximum of the laser pulse, ps."""
        known = self.source.pulse_fwhm_ps
        return self.true_pulse_fwhm_ps if known is None else known

    @property
    def vertex_times_ps(self) -> Floats:
        """(m,), true event time at each vertex, ps."""
        return self._times_ps[self._told] if self._flown.glass else self._times_ps

    @property
    def _told(self) -> NDArray[np.int64]:
        """(m,), places of the vertices among `flown_mm`."""
        return np.append(0, np.flatnonzero(np.diff(self._flown.of_leg, append=self.n_legs)) + 1)

    @property
    def flown(self) -> Scene | Flown:
        """Where the light was and when, with the places where it meets faces of glass."""
        return Flown(self.flown_mm, self._times_ps) if self._flown.glass else self

    @property
    def _times_ps(self) -> Floats:
        """(m + 2 k,), true event time at each of `flown_mm`, ps."""
        told = {
            "emission_time_ps": self.emission_time_ps,
            "path_group_index": self.medium.path_group_index,
        }
        vertices, times = self.flown_mm, np.empty(self.n_pieces + 1)
        for way in ways(leg_starts(self.n_pieces, self.forks)):
            on_way = [0, *(leg + 1 for leg in way)]
            times[on_way] = event_times_from_vertices(vertices[on_way], **told)
        return times + self._late_ps if self._flown.glass else times

    @property
    def _late_ps(self) -> Floats:
        """(m + 2 k,), what glass before each place adds to its event time, ps."""
        return late_ps(self.flown_mm, self._flown.glass, self.medium.path_group_index)

    def late_at(self, length_mm: Floats) -> Floats | float:
        """What glass adds to the event times at path lengths (n,) from the first vertex, ps."""
        if not self._flown.glass:
            return 0.0
        places = np.append(0.0, np.cumsum(np.linalg.norm(self.leg_steps_mm, axis=1)))
        return np.asarray(np.interp(length_mm, places, self._late_ps))

    def strength(self, length_mm: Floats, leg: int) -> Floats:
        """Relative scattering strength per mm at path lengths on one leg.

        Parameters
        ----------
        length_mm : array of float, shape (n,)
            Path length from the first vertex, mm.
        leg : int
            Which piece.

        Returns
        -------
        array of float, shape (n,)
            As `brightness` says of the leg that it is a piece of; nothing within glass.

        Raises
        ------
        ValueError
            Where `brightness` is negative or not finite.
        """
        if leg in dict(self._flown.glass):
            return np.zeros_like(length_mm)
        strength = self._strength(length_mm, int(self._flown.of_leg[leg]))
        if not (np.isfinite(strength) & (strength >= 0)).all():
            raise ValueError(f"brightness must be finite and >= 0; it is not on leg {leg}")
        return strength


def _strength_from(brightness: Brightness, n_legs: int) -> Callable[[Floats, int], Floats]:
    """One function of (path length, leg) from the forms `brightness` may take."""
    if brightness is None:
        return lambda length, _leg: np.ones_like(length)
    if callable(brightness):
        return lambda length, _leg: np.broadcast_to(
            np.asarray(brightness(length), dtype=float), length.shape
        )
    is_number = getattr(brightness, "ndim", 1) == 0
    if isinstance(brightness, Sequence | np.ndarray) and not is_number and len(brightness):
        if np.ndim(brightness[0]) == 0 and len(brightness) == n_legs:
            per_leg = finite_numbers("brightness", brightness)
            return lambda length, leg: np.full_like(length, per_leg[leg])
        if np.ndim(brightness[0]) == 1 and len(brightness) == 2:
            lengths, values = (finite_numbers("brightness", part) for part in brightness)
            if lengths.shape == values.shape and (np.diff(lengths) > 0).all():
                return lambda length, _leg: np.interp(length, lengths, values)
    raise ValueError(
        f"brightness must be a function of path length, {n_legs} numbers (one per leg), or a table "
        "(lengths_mm ascending, strengths)"
    )
