"""LightPath: where the pulse was and when, with error bars, and how that was found out.

Takes what `reconstruct` fits, gives positions, times, angles and tables with their errors.
`path_error` compares a path with the truth by the metrics every table of ours uses.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.arguments import finite_number, shown, whole_number
from lightflight.display import Card, Drawn, Labelled, Tabled, at_most, count, with_error
from lightflight.errors import LimitError
from lightflight.flight import (
    Medium,
    Source,
    elevation_from_direction,
)
from lightflight.path.alternative import Alternative, checked_alternatives
from lightflight.path.bends import Bend, checked_bend_covariance, checked_bends
from lightflight.path.cavity import RoundTrip, round_trip_of_path
from lightflight.path.gaps import Gap, checked_unseen, gaps_of_path
from lightflight.path.glass import glass_of
from lightflight.path.leg import Leg as Leg, paper_angle_from_leg as paper_angle_from_leg
from lightflight.path.on_bends import (
    angle_variance,
    course_of_leg,
    position_jacobian,
    positions_on,
    whole_covariance,
)
from lightflight.path.on_legs import covariance_on_legs, sliding_maps
from lightflight.path.second_pulse import SecondPulse
from lightflight.path.tables import RESIDUAL_DTYPE, SAMPLE_DTYPE, Explained, Goodness
from lightflight.path.tree import (
    branches_of,
    checked_forks,
    last_legs,
    leg_starts,
    legs_alight,
    starts_of,
    ways,
)
from lightflight.path.verdict import NOT_EXAMINED, Verdict

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

FARTHEST_MM = 1e15
"""An hour of light; squares of more have no place in the 32 bits of pictures."""

SHORTEST_MM = 1e-9
"""Of a leg; what is shorter has no direction."""

FARTHEST_PS = 1e16
"""Light is there before; times of more have no picoseconds left."""

MOST_LEGS = 100
"""No search finds more than a few; drawing takes time for each, and errors grow by its square."""


_MOST_OF_VERDICT, _MOST_VERTICES = 6, 7
"""Lines of a path on a terminal: 15 with its two others."""


@dataclass(frozen=True, eq=False, repr=False)
class LightPath(Drawn, Tabled, Labelled):
    """The path of a pulse in space and time: straight legs between vertices.

    Vertex 0 is the source (unknown source: entry into view), the last vertex the exit from view,
    those between are the corners, in or outside the picture. At a beam splitter a path forks: every
    leg k still ends at vertex k + 1, `forks` says which begin elsewhere than where the leg before
    ends, and each of `branches` has an exit of its own (`ends`). Light that crosses a block of the
    medium flies on three legs, the middle one within the glass: its two ends follow the others.

    Attributes
    ----------
    vertices_mm : array of float, shape (m, 3)
        M = n_legs + 1; world, mm.
    vertex_times_ps : array of float, shape (m,)
        Event times on the calibrated clock, ps.
    covariance : array of float, shape (4m, 4m)
        Total: x, y, z (mm), t (ps) of vertex 0, then of vertex 1 ...
    camera : Camera
        The camera that saw it.
    source : Source
        What was known of the source.
    medium : Medium
        The medium as it was found: its indices moved within the errors that were told of them.
    method : str
        "paper", "joint" or "photon".
    goodness : Goodness
        How well the path explains the recording.
    covariance_parts : Mapping[str, array of float]
        Shares of `covariance`, each (4m, 4m): "photon" (independent), "pixel" (calibration of the
        pixels: does not average over repeats), "shared" (scale, emission time, pose, source).
    residuals : array, shape (n,)
        dtype `RESIDUAL_DTYPE`: one row per pulse.
    prior : str
        What was taken as known, in words: every figure names its prior.
    statements : tuple of str
        What these data fix and do not fix, and what the result rests on; one sentence each.
    prices : tuple of str
        What was taken as exact, and by how much the path would be off where it is not; one
        sentence each.
    truth : object
        What made the recording, where a simulator knows it.
    provenance : mapping of str
        Inputs, settings, versions and seed that made it.
    verdict : Verdict
        Whether it may be trusted, and what contradicts it.
    explained : Explained or None
        How much of what was found in the recordings lies on it; None where that is not known.
    unseen_legs : tuple of int
        Legs, by number, that ran outside of every picture: the way between is not known, its delay
        is (`gaps`). Both their ends are mirrors that may stand elsewhere.
    forks : tuple of (int, int)
        Legs that begin at another vertex than the end of the leg before, each (leg, vertex): at a
        beam splitter two legs leave. () of a chain.
    bends : tuple of Bend
        Legs that are smooth curves, with their coefficients; all others are straight.
    bend_covariance : array of float, shape (4m + b, b)
        Of the b coefficients of all bends (mm), in their order, with x, y, z, t of every vertex and
        then with each other.
    group_index_std : float
        One-sigma error of `medium.path_group_index` as it was found; 0: it was told as exact.
    alternatives : tuple of Alternative
        Other paths that explain the recording about as well, the likeliest first.
    second_pulse : SecondPulse or None
        That flew the same path, by a fitted delay apart; None: the counts show none.
    """

    vertices_mm: Floats
    vertex_times_ps: Floats
    covariance: Floats
    camera: Camera = field(kw_only=True)
    source: Source = field(kw_only=True)
    medium: Medium = field(default_factory=Medium, kw_only=True)
    method: str = field(default="joint", kw_only=True)
    goodness: Goodness = field(kw_only=True)
    covariance_parts: Mapping[str, Floats] = field(default_factory=dict, kw_only=True, repr=False)
    residuals: NDArray[np.void] = field(
        default_factory=lambda: np.empty(0, RESIDUAL_DTYPE), kw_only=True, repr=False
    )
    prior: str = field(default="", kw_only=True)
    statements: tuple[str, ...] = field(default=(), kw_only=True)
    prices: tuple[str, ...] = field(default=(), kw_only=True)
    truth: Any = field(default=None, kw_only=True, repr=False)
    provenance: Mapping[str, Any] = field(default_factory=dict, kw_only=True, repr=False)
    verdict: Verdict = field(default=NOT_EXAMINED, kw_only=True)
    explained: Explained | None = field(default=None, kw_only=True)
    unseen_legs: tuple[int, ...] = field(default=(), kw_only=True)
    forks: tuple[tuple[int, int], ...] = field(default=(), kw_only=True)
    bends: tuple[Bend, ...] = field(default=(), kw_only=True)
    bend_covariance: Floats | None = field(default=None, kw_only=True, repr=False)
    group_index_std: float = field(default=0.0, kw_only=True)
    alternatives: tuple[Alternative, ...] = field(default=(), kw_only=True, repr=False)
    second_pulse: SecondPulse | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        vertices = np.array(self.vertices_mm, dtype=float)
        times = np.array(self.vertex_times_ps, dtype=float)
        m = len(times)
        if times.ndim != 1 or vertices.shape != (m, 3) or m < 2:
            raise ValueError(
                "a path needs vertices_mm of shape (m, 3) and vertex_times_ps of shape (m,) with "
                f"m >= 2, got {vertices.shape} and {times.shape}"
            )
        if m > MOST_LEGS + 1:
            raise LimitError(f"a path has at most {MOST_LEGS} legs, got {m - 1}")
        covariance = np.array(self.covariance, dtype=float)
        if covariance.shape != (4 * m, 4 * m):
            raise ValueError(f"covariance must be ({4 * m}, {4 * m}), got {covariance.shape}")
        if not np.isfinite(vertices).all():
            bad = int(np.argmin(np.isfinite(vertices).all(axis=1)))
            raise ValueError(f"vertices_mm must be finite: vertex {bad} is {vertices[bad]}")
        if np.abs(vertices).max() > FARTHEST_MM:
            raise LimitError(f"vertices_mm must lie within {FARTHEST_MM:g} mm, got {vertices}")
        forks = checked_forks(self.forks, m - 1)
        starts = leg_starts(m - 1, forks)
        if not (np.abs(vertices[1:] - vertices[starts]).max(axis=1) > SHORTEST_MM).all():
            raise ValueError(f"vertices_mm must differ from one to the next, got {vertices}")
        if np.abs(times).max() > FARTHEST_PS:
            raise LimitError(f"vertex_times_ps must lie within {FARTHEST_PS:g} ps, got {times}")
        if not (np.isfinite(times).all() and (times[1:] > times[starts]).all()):
            raise ValueError(
                f"vertex_times_ps must be finite and ascend{' along each leg' * bool(forks)}, got "
                f"{times}"
            )
        object.__setattr__(self, "forks", forks)
        object.__setattr__(self, "unseen_legs", checked_unseen(self.unseen_legs, m - 1, forks))
        object.__setattr__(self, "bends", checked_bends(self.bends, m - 1, self.unseen_legs))
        if forks and self.bends:
            raise ValueError(
                "a path with branches has straight legs: give forks or bends, not both"
            )
        finite_number("group_index_std", self.group_index_std, "be finite and >= 0", low=0.0)
        of_bends = checked_bend_covariance(self.bend_covariance, self.bends, 4 * m)
        object.__setattr__(self, "bend_covariance", of_bends)
        object.__setattr__(self, "alternatives", checked_alternatives(self.alternatives))
        for array in (vertices, times, covariance):
            array.setflags(write=False)
        object.__setattr__(self, "vertices_mm", vertices)
        object.__setattr__(self, "vertex_times_ps", times)
        object.__setattr__(self, "covariance", covariance)

    def _card(self) -> Card:
        from lightflight.path.card import card_of_path

        return card_of_path(self)

    def __repr__(self) -> str:
        return str(self)

    def __str__(self) -> str:
        """The verdict first, then what it is about, vertex by vertex; at most 15 lines."""
        explains = [] if self.explained is None else [f"explains {self.explained}"]
        length = sum(leg.length_mm for leg in self.legs)
        unseen = f", {len(self.unseen_legs)} of them unseen" if self.unseen_legs else ""
        unseen += f", {len(self.legs_in_glass)} of them in glass" if self.legs_in_glass else ""
        forked = f" on {len(self.ends) - 1} branches" if self.forks else ""
        whole = f"{self.method}: {count(self.n_legs, 'leg')}{unseen}{forked}, {length:.1f} mm"
        of_fork = {leg + 1: f", from {vertex}" for leg, vertex in self.forks}
        vertices = [
            f"{k}  ({', '.join(map(with_error, place, std[:3]))}) mm"
            f" at {with_error(time, std[3])} ps{of_fork.get(k, '')}"
            for k, (place, time, std) in enumerate(
                zip(self.vertices_mm, self.vertex_times_ps, self.vertex_std, strict=True)
            )
        ]
        found = at_most(list(self.verdict.lines), _MOST_OF_VERDICT)
        return "\n".join((*found, *explains, whole, *at_most(vertices, _MOST_VERTICES)))

    @property
    def n_legs(self) -> int:
        """Number of straight legs."""
        return len(self.vertex_times_ps) - 1

    @property
    def emission_time_ps(self) -> float:
        """Event time at vertex 0: when the pulse left the source (or entered the view), ps."""
        return float(self.vertex_times_ps[0])

    @property
    def vertex_std(self) -> Floats:
        """(m, 4), one-sigma errors of x, y, z (mm) and t (ps) of each vertex."""
        std: Floats = np.sqrt(np.maximum(np.diag(self.covariance), 0.0)).reshape(-1, 4)
        return std

    @property
    def legs(self) -> tuple[Leg, ...]:
        """The legs, each after the one whose light it carries on."""
        return tuple(self._leg(i) for i in range(self.n_legs))

    @property
    def ends(self) -> tuple[int, ...]:
        """Vertices at which the path begins, and then where each of its branches stops."""
        return (0, *(leg + 1 for leg in last_legs(starts_of(self))))

    @property
    def branches(self) -> tuple[LightPath, ...]:
        """Each way of the light from vertex 0 to one of `ends`, a chain of its own.

        With its own vertices, their errors and pulses; verdict, goodness and truth are those of
        the whole path. A chain is its own one branch.
        """
        return branches_of(self)

    def _branch(self, branch: int) -> LightPath:
        """One of the branches, by its number."""
        branches = self.branches
        number = whole_number("branch", branch)
        if not 0 <= number < len(branches):
            raise ValueError(f"branch must be from 0 to {len(branches) - 1}, got {shown(branch)}")
        return branches[number]

    def _leg(self, i: int) -> Leg:
        """One leg, with the error of its angle from the covariance of its two ends."""
        first = int(starts_of(self)[i])
        start, end = self.vertices_mm[first], self.vertices_mm[i + 1]
        normal = self.camera.backward_axis
        course = course_of_leg(self, i)
        step = end - start if course is None else course.tangents_mm(np.zeros(1))[0]
        length = float(np.linalg.norm(step))
        d = step / length
        along = float(d @ normal)
        # d(asin(d.n)) = n.(1 - d d^T) d(step) / (|step| cos(alpha))
        # Along the axis the angle is at its maximum and its first derivative has no limit.
        across = max(np.sqrt(max(0.0, 1.0 - along**2)), 1e-9)
        gradient = (normal - along * d) / (length * across)
        block = np.r_[4 * first : 4 * first + 3, 4 * i + 4 : 4 * i + 7]
        weights = np.concatenate((-gradient, gradient))
        if course is None:
            variance = weights @ self.covariance[np.ix_(block, block)] @ weights
        else:
            variance = angle_variance(self, course, block, weights, gradient)
        paper = paper_angle_from_leg(
            start, start + step, camera_center_mm=self.camera.center_mm, normal=normal
        )
        seen = i not in self.unseen_legs
        known = 1.0 if seen else np.nan
        return Leg(
            start_mm=start,
            end_mm=end,
            start_time_ps=float(self.vertex_times_ps[first]),
            end_time_ps=float(self.vertex_times_ps[i + 1]),
            angle_deg=known * float(np.rad2deg(elevation_from_direction(d, normal))),
            angle_std_deg=known * float(np.rad2deg(np.sqrt(np.maximum(variance, 0.0)))),
            paper_angle_deg=known * float(np.rad2deg(paper)),
            seen=seen,
            number=i,
            # The leg that ends where this one begins.
            parent=first - 1 if first else None,
            start_vertex=first,
            end_vertex=i + 1,
            course=course,
        )

    @property
    def open_vertices(self) -> tuple[int, ...]:
        """Vertices that end a leg nobody saw: mirrors that may stand elsewhere."""
        return tuple(sorted({vertex for k in self.unseen_legs for vertex in (k, k + 1)}))

    @property
    def legs_in_glass(self) -> tuple[int, ...]:
        """Legs, by number, that run through a block of the medium, from face to face."""
        return tuple(leg for leg, _ in glass_of(self.vertices_mm, self.medium.blocks))

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Where the light was lost from sight, in the order of flight: what is known of the way."""
        return gaps_of_path(self)

    @property
    def round_trip(self) -> RoundTrip | None:
        """Time and mirrors of light that goes to and fro between two; None where it does not."""
        return round_trip_of_path(self)

    def is_seen_at(
        self, event_times_ps: ArrayLike, *, branch: int | None = None
    ) -> NDArray[np.bool_]:
        """Whether the pulse is on a leg that a picture showed, at each event time.

        Parameters
        ----------
        event_times_ps : array of float, shape (n,)
            ps.
        branch : int, optional
            As in `position_at`.

        Returns
        -------
        array of bool, shape (n,)
        """
        return ~np.isin(self.leg_at(event_times_ps, branch=branch), self.unseen_legs)

    def leg_at(self, event_times_ps: ArrayLike, *, branch: int | None = None) -> NDArray[np.int64]:
        """Index of the leg on which the pulse is at each event time.

        Parameters
        ----------
        event_times_ps : array of float, shape (n,)
            ps.
        branch : int, optional
            As in `position_at`.

        Returns
        -------
        array of int, shape (n,)
            0-based, clipped to the ends.

        Raises
        ------
        ValueError
            As `position_at`.
        """
        times = np.atleast_1d(np.asarray(event_times_ps, dtype=float))
        if branch is not None:
            alone = self._branch(branch)
            return np.array(ways(starts_of(self))[branch])[alone.leg_at(times)]
        if self.forks:
            return legs_alight(starts_of(self), self.vertex_times_ps, times)
        index = np.searchsorted(self.vertex_times_ps, times, side="right") - 1
        return np.clip(index, 0, self.n_legs - 1)

    def position_at(self, event_times_ps: ArrayLike, *, branch: int | None = None) -> Floats:
        """Position of the pulse at event times.

        Parameters
        ----------
        event_times_ps : array of float, shape (n,)
            ps.
        branch : int, optional
            Which of `branches`; None: where light is on one leg alone at all these times, as it
            is everywhere on a chain and before a path's first fork.

        Returns
        -------
        array of float, shape (n, 3)
            World, mm; NaN off the path's two ends, and on legs that nobody saw.

        Raises
        ------
        ValueError
            Where light is on several legs at once and no branch is named.
        """
        times = np.atleast_1d(np.asarray(event_times_ps, dtype=float))
        if branch is not None:
            return self._branch(branch).position_at(times)
        leg = self.leg_at(times)
        position = self._position_on(leg, times)
        last = self.vertex_times_ps.max()
        span = last - self.vertex_times_ps[0]
        # Both ends are on the path, whatever rounding says.
        slack = 1e-12 * max(abs(last), span, 1.0)
        outside = (times < self.vertex_times_ps[0] - slack) | (times > last + slack)
        position[outside | np.isin(leg, self.unseen_legs)] = np.nan
        return position

    def _position_on(self, leg: NDArray[np.int64], times_ps: Floats) -> Floats:
        """(n, 3), mm: on these legs at event times, each leg prolonged beyond its ends."""
        if self.bends:
            return positions_on(self, times_ps)
        start = starts_of(self)[leg]
        fraction = self._fractions(leg, times_ps)[:, np.newaxis]
        position: Floats = (1 - fraction) * self.vertices_mm[start] + fraction * self.vertices_mm[
            leg + 1
        ]
        return position

    def _fractions(self, leg: NDArray[np.int64], times_ps: Floats) -> Floats:
        """(n,), share of these legs behind the pulse at event times; not clipped."""
        t0, t1 = self.vertex_times_ps[starts_of(self)[leg]], self.vertex_times_ps[leg + 1]
        fraction: Floats = (times_ps - t0) / (t1 - t0)
        return fraction

    def direction_at(self, event_times_ps: ArrayLike, *, branch: int | None = None) -> Floats:
        """Direction of flight at event times.

        Parameters
        ----------
        event_times_ps : array of float, shape (n,)
            ps.
        branch : int, optional
            As in `position_at`.

        Returns
        -------
        array of float, shape (n, 3)
            Unit, world; NaN off the path's two ends, and on legs that nobody saw.

        Raises
        ------
        ValueError
            As `position_at`.
        """
        times = np.atleast_1d(np.asarray(event_times_ps, dtype=float))
        found, of_leg = np.full((len(times), 3), np.nan), self.leg_at(times, branch=branch)
        for k in np.unique(of_leg):
            here = of_leg == k
            found[here] = self._leg(int(k)).direction_at(times[here])
        return found

    def position_covariance_at(
        self, event_times_ps: ArrayLike, *, branch: int | None = None
    ) -> Floats:
        """Covariance of `position_at` at fixed event times.

        Parameters
        ----------
        event_times_ps : array of float, shape (n,)
            ps.
        branch : int, optional
            As in `position_at`.

        Returns
        -------
        array of float, shape (n, 3, 3)
            mm^2, world axes: J C J^T with J by the two vertices of the leg; NaN where no leg was
            seen.

        Raises
        ------
        ValueError
            As `position_at`.
        """
        times = np.atleast_1d(np.asarray(event_times_ps, dtype=float))
        if branch is not None:
            return self._branch(branch).position_covariance_at(times)
        return self._covariance_on(self.leg_at(times), times)

    def _covariance_on(self, legs: NDArray[np.int64], times_ps: Floats) -> Floats:
        """(n, 3, 3), mm^2: of the position on these legs at fixed event times; NaN where unseen."""
        out, covariance = np.empty((len(times_ps), 3, 3)), whole_covariance(self)
        for k, (time, leg) in enumerate(zip(times_ps, legs, strict=True)):
            jacobian, block = self._position_jacobian(time, int(leg))
            out[k] = jacobian @ covariance[np.ix_(block, block)] @ jacobian.T
        out[np.isin(legs, self.unseen_legs)] = np.nan
        return out

    def _position_jacobian(self, time_ps: float, leg: int) -> tuple[Floats, NDArray[np.int64]]:
        """d(position at a fixed event time) / d(x, y, z, t of the leg's two vertices, and bend)."""
        course = course_of_leg(self, leg)
        if course is not None:
            return position_jacobian(self, course, time_ps)
        start = int(starts_of(self)[leg])
        t0, t1 = self.vertex_times_ps[[start, leg + 1]]
        step = self.vertices_mm[leg + 1] - self.vertices_mm[start]
        fraction = (time_ps - t0) / (t1 - t0)
        jacobian = np.zeros((3, 8))
        jacobian[:, 0:3] = (1 - fraction) * np.eye(3)
        jacobian[:, 4:7] = fraction * np.eye(3)
        jacobian[:, 3] = -(1 - fraction) * step / (t1 - t0)
        jacobian[:, 7] = -fraction * step / (t1 - t0)
        return jacobian, np.r_[4 * start : 4 * start + 4, 4 * leg + 4 : 4 * leg + 8]

    def sample(self, n: int = 1000) -> NDArray[np.void]:
        """Points at equal event times from first to last vertex; where a path forks, leg by leg.

        Parameters
        ----------
        n : int
            How many, at least 2.

        Returns
        -------
        array, shape (n,)
            dtype `SAMPLE_DTYPE`. `x_std_mm` ... are errors of the position at that event time;
            `event_time_std_ps` is the error of the time at which the pulse passes that fraction
            of its leg. On legs that nobody saw all but leg and event time are NaN. Of a path that
            forks each leg comes once, at the same step in time: event times start again at a fork.

        Raises
        ------
        ValueError
            For n < 2.
        """
        if n < 2:
            raise ValueError(f"n must be at least 2, got {n}")
        leg, times = self._equal_times(n)
        position = self._position_on(leg, times)
        out = np.zeros(n, SAMPLE_DTYPE)
        out["leg"], out["event_time_ps"] = leg, times
        out["x_mm"], out["y_mm"], out["z_mm"] = position.T
        back = self.camera.return_times_ps(
            position, return_group_index=self.medium.return_group_index
        )
        out["arrival_time_ps"] = times + back
        # Where a position is exact (a leg's start moves in time as along the leg), rounding leaves
        # variances a hair below zero.
        variance = np.diagonal(self._covariance_on(leg, times), axis1=1, axis2=2)
        out["x_std_mm"], out["y_std_mm"], out["z_std_mm"] = np.sqrt(np.maximum(variance, 0.0)).T
        out["event_time_std_ps"] = np.sqrt(
            np.maximum(self._time_variance(times, leg, position), 0.0)
        )
        out["in_view"] = self.camera.sees(position)
        unseen = np.isin(leg, self.unseen_legs)
        out["in_view"][unseen] = False
        for name in (n for n in SAMPLE_DTYPE.names or () if out[n].dtype.kind == "f"):
            if name != "event_time_ps":
                out[name][unseen] = np.nan
        return out

    def _equal_times(self, n: int) -> tuple[NDArray[np.int64], Floats]:
        """(n,) legs and event times, ps, at equal steps: over the legs one after the other."""
        if not self.forks:
            times = np.linspace(self.vertex_times_ps[0], self.vertex_times_ps[-1], n)
            return self.leg_at(times), times
        begun = self.vertex_times_ps[starts_of(self)]
        lasting = self.vertex_times_ps[1:] - begun
        before = np.concatenate(([0.0], np.cumsum(lasting)))
        flown = np.linspace(0.0, before[-1], n)
        leg = np.clip(np.searchsorted(before, flown, side="right") - 1, 0, self.n_legs - 1)
        return leg, begun[leg] + (flown - before[leg])

    def _time_variance(self, times: Floats, leg: NDArray[np.int64], points: Floats) -> Floats:
        """(n,), ps^2: of the event time at these fractions of a leg, or planes of sight."""
        found = covariance_on_legs(
            self.covariance, leg, self._fractions(leg, times), starts=starts_of(self)
        )
        row = sliding_maps(self, leg, points)[:, 3]
        variance: Floats = np.einsum("ni,nij,nj->n", row, found, row)
        return variance

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the path to one HDF5 file, whole or not at all.

        Parameters
        ----------
        path : path
            The file; an existing one is replaced only at the end.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        from lightflight.path.file import save_path

        save_path(self, path)

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, try_newer: bool = False) -> LightPath:
        """Read a path written by `save`.

        Parameters
        ----------
        path : path
            The file.
        try_newer : bool
            Of a file by a newer version, read what this one knows; `statements` say so.

        Returns
        -------
        LightPath
            Equal to the one that was kept.

        Raises
        ------
        FileFormatError
            For any other file.
        """
        from lightflight.path.file import load_path

        return load_path(path, make=cls, try_newer=try_newer)
