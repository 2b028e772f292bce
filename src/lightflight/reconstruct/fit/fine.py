"""The last fit of a path: lines and times as the light is.

Spots that vary along a leg, pixels that count unequally and light that is uneven within a pixel
move a path by a few of its errors, and could hide that it has a leg too few. So they have a place
once it is known which legs there are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import GeometryError, NothingFoundError
from lightflight.reconstruct.fit.active_area import areas_of_path, with_area_errors
from lightflight.reconstruct.fit.broad_beams import with_broad_beams
from lightflight.reconstruct.fit.joint import JointFit, as_found, pulse_std_ps, told_lines
from lightflight.reconstruct.fit.membership import (
    MOST_SHIFT,
    mode_columns,
    shift_by_ends_ps,
    stacked,
    time_data,
    tips_in_view,
)
from lightflight.reconstruct.fit.pictures import pictures_of
from lightflight.reconstruct.fit.robust import check_enough, solve_robustly
from lightflight.reconstruct.fit.slanted_spots import (
    asks_for_slanted_spots,
    with_slanted_spots,
)
from lightflight.reconstruct.fit.uneven import RestAlong, Uneven, uneven_light
from lightflight.reconstruct.model.geometry import footprints
from lightflight.reconstruct.model.picture import footprint_corrections
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting

Floats = NDArray[np.float64]


def with_fine_light(fit: JointFit, setting: Setting) -> JointFit:
    """The fit with lines and times as the light is: spots that vary, unequal pixels, uneven light.

    Parameters
    ----------
    fit : JointFit
        Whose legs are to stay: which there are needs no such care, and could be hidden by it.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    JointFit
        Of the same pulses.
    """
    settled = fit
    while True:
        try:
            settled = _finely_solved(_clear_of_ends(fit, setting), setting)
        except (GeometryError, NothingFoundError, np.linalg.LinAlgError):
            # The last step led a leg to the edge of what its pixels tell: as it was found, then.
            return settled
        areas = areas_of_path(settled, setting)
        if areas is not None:
            fit = replace(settled, active_px=areas)
        elif asks_for_slanted_spots(settled, setting):
            fit = replace(settled, slanted=True)
        else:
            return settled


def _clear_of_ends(fit: JointFit, setting: Setting) -> JointFit:
    """The fit without pulses that an end of their leg's light moves: until now ends were rough."""
    seen, _ = as_found(fit.solution, setting, list(fit.sightings))
    clear = np.ones(len(fit.times.leg), dtype=bool)
    state = fit.solution.state
    for number, (picture, sighting) in enumerate(zip(fit.pictures, fit.sightings, strict=True)):
        view = seen.at(sighting.view)
        tips = tips_in_view(fit.tips, state, seen, sighting.view)
        for leg in state.seen:
            own = np.flatnonzero((fit.sighting_of == number) & (fit.times.leg == leg))
            print_ = footprints(
                state, camera=view.camera, medium=seen.medium, legs=leg,
                rows=fit.times.row[own], cols=fit.times.col[own],
            )  # fmt: skip
            shift = shift_by_ends_ps(print_, leg, picture.spot_std_px, state, tips, view)
            error = np.sqrt(fit.times.photon_var[own] + fit.times.pixel_var[own])
            clear[own] = shift < MOST_SHIFT * np.hypot(error, fit.floor_ps)
    times = fit.times.of(clear)
    try:
        check_enough(times, fit.freedom.n_unknown)
    except NothingFoundError:
        return fit
    solution = replace(fit.solution, residual_ps=fit.solution.residual_ps[clear])
    return replace(fit, solution=solution, times=times, sighting_of=fit.sighting_of[clear])


def _finely_solved(fit: JointFit, setting: Setting) -> JointFit:
    shown = finely_lit(fit, list(fit.sightings), setting)
    times = replace(shown.times, weight=np.ones_like(shown.times.weight))
    solution, times, floor = solve_robustly(
        fit.solution.state, times, shown.lines, fit.freedom, setting, fit.solution.shared
    )
    return replace(shown, solution=solution, times=times, floor_ps=floor)


def finely_lit(fit: JointFit, sightings: list[Sighting], setting: Setting) -> JointFit:
    """The fit with lines, and what light does to the times, measured finely; no path moves.

    Parameters
    ----------
    fit : JointFit
        Of the recordings as they were.
    sightings : list of Sighting
        Perhaps with light found that is no leg's.
    setting : Setting
        As told.

    Returns
    -------
    JointFit
        Of the same pulses, with other pictures and lines.

    Raises
    ------
    GeometryError, NothingFoundError
        Where a leg does not cross the picture, or has too few pixels.
    """
    seen, clock = as_found(fit.solution, setting, list(fit.sightings))
    std = pulse_std_ps(sightings)
    moved = [replace(o, found=same.found) for o, same in zip(sightings, clock, strict=True)]
    pictures = pictures_of(
        fit.solution.state, moved, seen, std_ps=std, fine=True, active_px=fit.active_px
    )
    shown = replace(fit, pictures=pictures, lines=told_lines(pictures, sightings, setting, seen))
    feet, uneven = _feet_and_rest(shown, sightings, setting)
    times = replace(
        fit.times,
        footprint_ps=feet + uneven.late_ps,
        modes_ps=np.hstack((fit.times.modes_ps[:, : _n_of_clock(fit)], uneven.columns_ps)),
    )
    shown = with_broad_beams(replace(shown, times=times), setting)
    return with_area_errors(with_slanted_spots(shown, setting), setting)


def rests_of_light(fit: JointFit, setting: Setting) -> dict[int, tuple[RestAlong, ...]]:
    """How uneven light is along the legs of a fit beyond splines, by camera.

    Of a camera's repeats the first tells.

    Parameters
    ----------
    fit : JointFit
        With fine pictures.
    setting : Setting
        As told.

    Returns
    -------
    dict of int to tuple of RestAlong
    """
    try:
        rests = _feet_and_rest(fit, list(fit.sightings), setting)[1].rests
    except np.linalg.LinAlgError:
        # Of pulses that tell nothing of it nothing is told.
        return {}
    views = [one.view for one in fit.sightings]
    return {
        view: tuple(one for one in rests if one.number == views.index(view)) for view in set(views)
    }


def _feet_and_rest(
    fit: JointFit, sightings: list[Sighting], setting: Setting
) -> tuple[Floats, Uneven]:
    """What the light does to each pulse: that of the splines of its pictures, and what they miss.

    `fit`: with pictures as they are now, and times as they were solved.
    """
    seen, _ = as_found(fit.solution, setting, list(fit.sightings))
    feet, n_of_clock = _feet(fit, seen), _n_of_clock(fit)
    # What was known of uneven light before stands behind the errors of the clock.
    of_light = fit.times.modes_ps[:, n_of_clock:] @ fit.solution.modes[n_of_clock:]
    of_light -= fit.late_ps(fit.broad_modes) + fit.late_ps(fit.leaning_modes)
    left = fit.solution.residual_ps + fit.times.footprint_ps + of_light - feet
    return feet, uneven_light(fit, sightings, setting, left)


def _n_of_clock(fit: JointFit) -> int:
    """How many of the pulses' shared errors are the clock's: the first."""
    return max((own.stop for own in mode_columns(list(fit.sightings)).values()), default=0)


def _feet(fit: JointFit, seen: Setting) -> Floats:
    """(n,), mean time over each pulse's footprint minus that at its foot as pictures say, ps."""
    feet, state = np.zeros(len(fit.times.leg)), fit.solution.state
    for number, (picture, sighting) in enumerate(zip(fit.pictures, fit.sightings, strict=True)):
        here = np.flatnonzero(fit.sighting_of == number)
        rows, cols = fit.times.row[here], fit.times.col[here]
        camera = seen.cameras[sighting.view]
        print_ = footprints(
            state, camera=camera, medium=seen.medium, legs=fit.times.leg[here], rows=rows, cols=cols
        )
        feet[here] = footprint_corrections(
            picture, print_, rows=rows, cols=cols, camera=camera, state=state, medium=seen.medium
        )
    return feet


def fitted_again(fit: JointFit, sightings: list[Sighting], setting: Setting) -> JointFit:
    """The same pulses with other times, errors and modes: of these recordings, row by row.

    Parameters
    ----------
    fit : JointFit
        Of the recordings as they were.
    sightings : list of Sighting
        With rows of arrivals as before; those without a time take no part.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    JointFit
        With the same lines, and feet as before.

    Raises
    ------
    NothingFoundError
        Where too few pulses are left.
    """
    parts, kept = [], []
    for number, sighting in enumerate(sightings):
        here = np.flatnonzero(fit.sighting_of == number)
        here = here[np.isfinite(sighting.arrival_ps[fit.times.index[here]])]
        leg, feet = fit.times.leg[here], fit.times.footprint_ps[here]
        parts.append(time_data(sighting, fit.times.index[here], leg, feet))
        kept.append(here)
    times = stacked(parts, mode_columns(sightings))
    # Errors of uneven light stand behind those of the clock, and stay.
    uneven = fit.times.modes_ps[np.concatenate(kept), _n_of_clock(fit) :]
    times = replace(times, modes_ps=np.hstack((times.modes_ps, uneven)))
    check_enough(times, fit.freedom.n_unknown)
    solution, times, floor = solve_robustly(
        fit.solution.state, times, fit.lines, fit.freedom, setting, fit.solution.shared
    )
    return replace(
        fit,
        solution=solution,
        times=times,
        sighting_of=np.repeat(np.arange(len(parts)), [len(part.leg) for part in parts]),
        floor_ps=floor,
        sightings=tuple(sightings),
    )
