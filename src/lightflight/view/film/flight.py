"""The flight as a film: event time and arrival time side by side (the paper's Visualization 1).

Takes a LightPath, gives frames or a file. Left, where the pulse is when the clock of the events
shows a reading; right, what a camera sees when its own clock shows the same reading. Both count
from the light of vertex 0. The pulse is drawn with its true width in time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from lightflight.errors import GeometryError
from lightflight.path.second_view import DEFAULT_PULSE_FWHM_PS, Observation, observe
from lightflight.path.trace import (
    Trace,
    event_time_from_arrival_on,
    parted,
    position_at,
    trace_from_path,
    traces_of_branches,
)
from lightflight.units import std_from_fwhm
from lightflight.view import style
from lightflight.view.figures.path import draw_path_3d
from lightflight.view.figures.timing import leg_mark, shade_out_of_view, watched
from lightflight.view.film.encode import Frame, Progress, check_length, check_movie, write_frames
from lightflight.view.film.stage import Stage
from lightflight.view.page.tables import heading
from lightflight.view.types import FilePath, Floats
from lightflight.view.viewpoint import Projector, Viewpoint

if TYPE_CHECKING:
    from lightflight import Camera, LightPath


_INCHES_WIDE = 10.0
_PIECES = 24
"""Short lines that a pulse is drawn of."""
_LEAD_PS = 120.0
"""Time shown before the first light and after the last, ps."""


@dataclass(frozen=True)
class MovieSettings:
    """How a film looks and runs.

    Attributes
    ----------
    size_px : (int, int)
        (width, height), px, even.
    frames_per_second : float
        Of the film.
    pace_ps_per_s : float
        Picoseconds of flight shown in a second of film.
    orbit_deg : float
        How far the viewer goes around the scene in the whole film, deg. 0: stands still.
    """

    size_px: tuple[int, int] = (1280, 720)

    frames_per_second: float = 25.0

    pace_ps_per_s: float = 300.0

    orbit_deg: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.pace_ps_per_s) and self.pace_ps_per_s > 0):
            raise ValueError(f"pace_ps_per_s must be positive, got {self.pace_ps_per_s}")
        if not np.isfinite(self.orbit_deg):
            raise ValueError(f"orbit_deg must be finite, got {self.orbit_deg}")


def readings(trace: Trace, settings: MovieSettings) -> Floats:
    """(n,), what both clocks show in each frame, ps since the light of vertex 0."""
    if len(trace.leg) == 0:
        return np.zeros(1)
    event = float(trace.event_time_ps.max() - trace.event_time_ps[0])
    arrival = float(trace.arrival_ps.max() - trace.arrival_ps[0])
    # Without a camera there is no arrival time.
    last = np.nanmax([event, arrival]) + _LEAD_PS
    step = settings.pace_ps_per_s / settings.frames_per_second
    check_length((last + _LEAD_PS) / step, shorter="a larger pace, or fewer frames per second")
    return np.arange(-_LEAD_PS, last + step, step)


def movie_frames(
    path: LightPath,
    *,
    camera: Camera | None = None,
    settings: MovieSettings | None = None,
    view: Viewpoint | None = None,
) -> Iterator[Frame]:
    """Frames (height, width, 3) uint8 of the flight, in the order of `readings`.

    Parameters
    ----------
    path : LightPath
        The path.
    camera : Camera, optional
        Whose picture to show at the right; None: the path's own. Any camera will do: its picture is
        computed from the path (`observe`).
    settings : MovieSettings, optional
        Size, rate, pace, orbit.
    view : Viewpoint, optional
        Where the viewer of the left picture stands.

    Raises
    ------
    GeometryError
        Where `camera` sees nothing of the path.
    """
    settings = MovieSettings() if settings is None else settings
    # The style is left between frames: whoever takes them may draw with settings of their own.
    with style.figure_style():
        stage = _FlightStage(path, camera, settings, Viewpoint() if view is None else view)
    every = readings(stage.trace, settings)
    for k, reading in enumerate(every):
        with style.figure_style():
            yield stage.frame(float(reading), k / max(len(every) - 1, 1))


def write_movie(
    path: LightPath,
    file: FilePath,
    *,
    camera: Camera | None = None,
    settings: MovieSettings | None = None,
    view: Viewpoint | None = None,
    progress: Progress | None = None,
) -> None:
    """Write the flight as MP4 or GIF; parameters as in `movie_frames`.

    Parameters
    ----------
    path : LightPath
        The path.
    file : path
        Where to write.
    camera : Camera, optional
        Whose picture to show at the right; None: the path's own.
    settings : MovieSettings, optional
        Size, rate, pace, orbit.
    view : Viewpoint, optional
        From where the scene is seen.
    progress : callable, optional
        Called with (frames done, in all).

    Raises
    ------
    ValueError, MissingExtraError
        As `lightflight.view.film.encode.check_movie`.
    """
    settings = MovieSettings() if settings is None else settings
    rate = settings.frames_per_second
    check_movie(file, size_px=settings.size_px, frames_per_second=rate)
    trace = trace_from_path(path, camera=camera)
    write_frames(
        movie_frames(path, camera=camera, settings=settings, view=view),
        file,
        n_frames=len(readings(trace, settings)),
        size_px=settings.size_px,
        frames_per_second=rate,
        progress=progress,
    )


class _FlightStage(Stage):
    """The figure of a film: everything that stands still is drawn once."""

    def __init__(
        self, path: LightPath, camera: Camera | None, settings: MovieSettings, view: Viewpoint
    ) -> None:
        super().__init__(settings.size_px, inches_wide=_INCHES_WIDE)
        self.path = path
        self.camera = getattr(path, "camera", None) if camera is None else camera
        self.settings = settings
        self.view = view
        self.turned = view
        self.trace = trace_from_path(path, camera=self.camera)
        # Where a path forks, a pulse flies on each of its branches.
        self.chains = getattr(path, "branches", (path,))
        self.traces = traces_of_branches(self.trace, path)
        self.observed = _observed(path, self.camera)
        source = getattr(path, "source", None)
        self.fwhm_ps = float(getattr(source, "pulse_fwhm_ps", None) or DEFAULT_PULSE_FWHM_PS)
        self.space = self.figure.add_axes((0.01, 0.30, 0.60, 0.60))
        self.picture = self.figure.add_axes((0.655, 0.335, 0.30, 0.50))
        self.clock = self.figure.add_axes((0.06, 0.085, 0.895, 0.165))
        self._draw_still()
        self._add_moving()
        self.keep_background()

    # --- what stands still ------------------------------------------------------------------

    def _draw_still(self) -> None:
        self.figure.text(0.03, 0.945, heading(self.path), fontsize=14, fontweight="bold")
        for x, text, color in (
            (0.03, "event time: what happened", style.EVENT),
            (0.655, "arrival time: what the camera sees", style.ARRIVAL),
        ):
            self.figure.text(x, 0.895, text, fontsize=9, color=color)
        self._draw_space()
        self._draw_picture()
        self._draw_clock()

    def _draw_space(self) -> None:
        if len(self.trace.leg) == 0:
            style.message(self.space, "the path has no legs")
            return
        self._draw_scene(self.view)
        self.figure.text(
            0.31,
            0.275,
            "filled: the pulse    ring: where the camera sees it at this reading",
            fontsize=7.5,
            color=style.QUIET,
            ha="center",
        )

    def _draw_scene(self, view: Viewpoint) -> None:
        draw_path_3d(self.path, self.space, show_truth=False, legend=False, view=view)
        # A film shows the flight: the path itself steps back behind the pulse.
        for line in self.space.lines:
            if line.get_color() == style.EVENT:
                line.set_alpha(0.3)

    def _draw_picture(self) -> None:
        if self.camera is None or self.observed is None:
            why = "no camera is known" if self.camera is None else "the camera sees no light"
            style.message(self.picture, why)
            return
        rows, cols = self.camera.shape
        self.picture.set(xlim=(-0.5, cols - 0.5), ylim=(rows - 0.5, -0.5))
        self.picture.set(xlabel="column", ylabel="row")
        self.picture.set_aspect("equal")
        trace = self.trace
        for leg in np.unique(trace.leg):
            seen = (trace.leg == leg) & trace.in_view
            row, col = self.camera.pixels_from_points(trace.points_mm[seen])
            self.picture.plot(col, row, color=style.QUIET, lw=0.6, alpha=0.5)

    def _draw_clock(self) -> None:
        trace = self.trace
        if len(trace.leg) == 0:
            self.clock.set_axis_off()
            return
        event = parted(trace, trace.event_time_ps - trace.event_time_ps[0])
        length = parted(trace, trace.length_mm)
        self.clock.plot(event, length, color=style.EVENT, lw=1.6, label="pulse")
        if np.isfinite(trace.arrival_ps).all():
            arrival = trace.arrival_ps - trace.arrival_ps[0]
            shade_out_of_view(self.clock, *watched(trace, self.path, arrival))
            self.clock.plot(
                parted(trace, arrival), length, color=style.ARRIVAL, lw=1.2, label="its picture"
            )
        every = readings(trace, self.settings)
        self.clock.set(xlim=(every[0], every[-1]), ylim=(0, None))
        self.clock.set(xlabel="reading of either clock (ps)", ylabel="path (mm)")
        self.clock.legend(loc="upper left", ncols=2)

    # --- what moves -------------------------------------------------------------------------

    def _add_moving(self) -> None:
        self.reading = self.figure.text(
            0.97, 0.945, "", fontsize=14, ha="right", animated=True, family="DejaVu Sans Mono"
        )
        self.body = LineCollection([], linewidths=8.0, zorder=20, animated=True, capstyle="butt")
        self.space.add_collection(self.body, autolim=False)
        (self.dot,) = self.space.plot(
            [], [], "o", ms=5.5, mfc=style.EVENT, mec=style.PAPER, mew=0.8, zorder=21,
            animated=True,
        )  # fmt: skip
        (self.seen,) = self.space.plot(
            [], [], "o", ms=7, mfc="none", mec=style.ARRIVAL, mew=1.3, zorder=19, animated=True
        )
        self.cursor = self.clock.axvline(0.0, color=style.INK, lw=1.0, animated=True)
        self.clock_event, self.clock_arrival = (
            self.clock.plot(
                [], [], leg_mark(0), color=color, ls="none", ms=4.5, zorder=6, animated=True
            )[0]
            for color in (style.EVENT, style.ARRIVAL)
        )
        self.moving: list[tuple[Axes | Figure, Artist]] = [
            (self.space, self.seen), (self.space, self.body), (self.space, self.dot),
            (self.clock, self.cursor), (self.clock, self.clock_event),
            (self.clock, self.clock_arrival), (self.figure, self.reading),
        ]  # fmt: skip
        self.light = None
        if self.observed is not None:
            shape = self.observed.camera.shape
            self.light = self.picture.imshow(
                np.zeros(shape), cmap=_light_colormap(), vmin=0, vmax=1, zorder=1, animated=True
            )
            self.moving.insert(0, (self.picture, self.light))

    def frame(self, reading: float, progress: float) -> Frame:
        """The picture when both clocks show `reading`."""
        if self.settings.orbit_deg:
            self._turn(progress)
        self._move(reading)
        # The light hides the legs' lines, which are part of the background: once more over it.
        lines = () if self.light is None else self.picture.lines
        return self.snapshot([*self.moving, *((self.picture, line) for line in lines)])

    def _turn(self, progress: float) -> None:
        # By steps of a pixel at the picture's edge: drawing takes up to a second for many legs.
        step = float(np.degrees(1.0 / (0.3 * self.settings.size_px[0])))
        turned = self.settings.orbit_deg * (progress - 0.5)
        turned = round(turned / step) * step
        azimuth = self.view.azimuth_deg + turned
        if self.turned is not self.view and self.turned.azimuth_deg == azimuth:
            return
        if self.turned is self.view:
            self.keep_all_but(self.space)
        # Everything in space turns, so it is drawn anew; the moving parts are put back.
        self.space.clear()
        self.turned = replace(self.view, azimuth_deg=azimuth)
        self._draw_scene(self.turned)
        self.space.add_collection(self.body, autolim=False)
        self.space.add_line(self.dot)
        self.space.add_line(self.seen)
        self.renew(self.space)

    def _move(self, reading: float) -> None:
        trace = self.trace
        self.reading.set_text(f"{reading:7.0f} ps".replace("-", "\u2212"))
        self.cursor.set_xdata([reading, reading])
        if len(trace.leg) == 0:
            return
        view: Projector = self.turned
        start = float(trace.event_time_ps[0])
        bodies = [
            pulse_body(chain, start + reading, fwhm_ps=self.fwhm_ps, view=view, color=style.EVENT)
            for chain in self.chains
        ]
        self.body.set_segments([piece for segments, _ in bodies for piece in segments])
        self.body.set_color([tuple(color) for _, colors in bodies for color in colors])
        self._put(self.dot, view, [start + reading] * len(self.chains))
        seen = [
            float(event_time_from_arrival_on(own, trace.arrival_ps[0] + reading))
            for own in self.traces
        ]
        self._put(self.seen, view, seen)
        at = [reading] * len(self.traces)
        flown = [np.interp(reading, own.event_time_ps - start, own.length_mm)
                 for own in self.traces]  # fmt: skip
        self.clock_event.set_data(at, flown)
        shown = [
            np.interp(reading, own.arrival_ps - trace.arrival_ps[0], own.length_mm)
            if np.isfinite(when)
            else np.nan
            for own, when in zip(self.traces, seen, strict=True)
        ]
        self.clock_arrival.set_data(at, shown)
        if self.light is not None and self.observed is not None:
            moment = float(trace.arrival_ps[0]) + reading
            # The root of the light, as an eye would see it: faint legs stay in the picture.
            self.light.set_data(np.sqrt(self.observed.frames(moment)[0]))

    def _put(self, mark: Line2D, view: Projector, event_times_ps: list[float]) -> None:
        """A mark on each branch where its pulse is at its event time; none off its ends."""
        places = np.array(
            [position_at(chain, [when])[0]
             for chain, when in zip(self.chains, event_times_ps, strict=True) if np.isfinite(when)]
        ).reshape(-1, 3)  # fmt: skip
        places = places[np.isfinite(places).all(axis=1)]
        mark.set_data(*(view.project(places).T if len(places) else ([], [])))


def pulse_body(
    path: LightPath,
    event_time_ps: float,
    *,
    fwhm_ps: float,
    view: Projector,
    color: str,
) -> tuple[list[Floats], Floats]:
    """The pulse at an event time as short lines whose opacity follows its Gaussian shape.

    Returns
    -------
    (list of arrays, array of float)
        Segments, each (2, 2) on the page; colours (n, 4). Empty before and after the flight.
    """
    std = std_from_fwhm(fwhm_ps)
    # At 1.3 FWHM from the middle a Gaussian is down to 1 %.
    edges = event_time_ps + np.linspace(-1.3 * fwhm_ps, 1.3 * fwhm_ps, _PIECES + 1)
    points = view.project(position_at(path, edges))
    middle = (edges[:-1] + edges[1:]) / 2
    opacity = np.exp(-0.5 * ((middle - event_time_ps) / std) ** 2)
    pairs = np.stack((points[:-1], points[1:]), axis=1)
    good = np.isfinite(pairs).all(axis=(1, 2))
    rgba = np.ones((int(good.sum()), 4))
    rgba[:, :3] = to_rgb(color)
    rgba[:, 3] = opacity[good]
    return list(pairs[good]), rgba


def _observed(path: LightPath, camera: Camera | None) -> Observation | None:
    """What `camera` sees; None without one, or where the path's own sees nothing of it."""
    if camera is None:
        return None
    try:
        return observe(path, camera)
    except GeometryError:
        # A camera that was asked for must see something; the path's own gives an empty picture.
        if camera is not getattr(path, "camera", None):
            raise
        return None


def _light_colormap() -> LinearSegmentedColormap:
    """From the page's wash to the colour of arrival time; dark is bright, so that it prints."""
    return LinearSegmentedColormap.from_list("lightflight_light", [style.WASH, style.ARRIVAL])
