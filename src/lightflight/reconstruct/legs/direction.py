"""Legs in the picture, and whether their times run the way that straight light's must.

Takes the pulses of one recording; a clock that runs backwards is noticed here, before any path
is fitted, and where nothing tells its direction the user is asked.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from lightflight.errors import CalibrationError, NothingFoundError, SuspectDataWarning
from lightflight.flight import Medium
from lightflight.reconstruct.legs.bend import bend_significance
from lightflight.reconstruct.legs.find import ImageLeg, find_legs
from lightflight.reconstruct.model.setting import Setting, earliest_arrival_ps
from lightflight.reconstruct.model.sighting import Sighting, first_of_each_view
from lightflight.timing.pulses.same_camera import scatter_of_neighbours

if TYPE_CHECKING:
    from lightflight.camera.model import Camera
    from lightflight.timing.clock.code_clock import CodeClock
    from lightflight.timing.pulses.arrivals import Arrivals

MUCH_SCATTER = 0.2
"""A fifth of a pulse is more than counting and a good clock leave."""
_NO_DEPTH_PS = 10.0
"""At 7 mm of depth for each ps: a tenth of a metre, and more than delays and gains of a sharp clock
(a streak camera's pixels scatter by 2 ps, those of an array without a flat by 100 and more). With
13 ps the same: of pulses wider than 65 ps, as those of arrays, `MUCH_SCATTER` asks for more."""
_CLOCKS_SHARE = 0.3
"""Pixels of an uncalibrated clock scatter each by itself: by most of what the times miss by."""


def _one_medium(medium: Medium) -> bool:
    """True where the half-angle law bends every arrival curve upwards."""
    return abs(medium.path_group_index / medium.return_group_index - 1) < 0.02


def search_legs(
    arrivals: Arrivals,
    sighting: Sighting,
    setting: Setting,
    n_legs: int | None,
    *,
    convex: bool | None = None,
) -> tuple[ImageLeg, ...]:
    """Legs in the picture of one table of arrivals; `convex` None: as the media ask for.

    Parameters
    ----------
    arrivals : Arrivals
        Pulses on the clock.
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    setting : Setting
        Camera, source, medium and waypoints.
    n_legs : int or None
        How many legs there are, where the user knows it; None: as many as the data show.
    convex : bool, optional
        Whether arrival curves must bend upwards; None: as the media ask for.

    Returns
    -------
    tuple of ImageLeg
        In the order of flight.

    Raises
    ------
    NothingFoundError
        Where no straight leg stands out.
    """
    folded = arrivals.laser_period_ps is not None
    legs = find_legs(
        arrivals,
        camera=setting.camera,
        n_legs=n_legs,
        earliest_ps=earliest_arrival_ps(setting) if folded else None,
        convex=_one_medium(setting.medium) if convex is None else convex,
        computed_cube=not sighting.histograms.poisson,
    )
    return tuple(replace(leg, view=sighting.view) for leg in legs) if sighting.view else legs


def legs_of_straight_light(
    sighting: Sighting, setting: Setting, n_legs: int | None
) -> tuple[ImageLeg, ...]:
    """Legs in the picture; a clock that runs backwards is noticed here.

    Straight light gives d^2 t_a / d psi^2 > 0 (half-angle law); a clock read backwards turns that
    round. Where the legs found bend the wrong way beyond chance, or hardly any are found, the
    search is made on the clock run backwards too, and the clearer picture decides.

    Parameters
    ----------
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    setting : Setting
        Camera, source, medium and waypoints.
    n_legs : int or None
        How many legs there are, where the user knows it; None: as many as the data show.

    Returns
    -------
    tuple of ImageLeg
        In the order of flight.

    Raises
    ------
    NothingFoundError
        Where no straight leg stands out, whichever way the clock runs.
    CalibrationError
        Where the clock runs backwards.
    """
    try:
        legs = search_legs(sighting.arrivals, sighting, setting, n_legs)
    except NothingFoundError:
        refuse_if_clearer_backwards((), sighting, setting, n_legs)
        raise
    # Six errors: a second search is dear, and chance or an unseen corner bends by less.
    if bend_significance(legs, sighting, setting.camera) < -6.0:
        refuse_if_clearer_backwards(legs, sighting, setting, n_legs)
    return legs


def legs_in_all_pictures(
    sightings: Sequence[Sighting],
    setting: Setting,
    n_legs: int | None = None,
    *,
    either_way: bool = False,
) -> tuple[ImageLeg, ...]:
    """Legs in the picture of each camera, in the order of flight within each.

    Parameters
    ----------
    sightings : sequence of Sighting
        Recordings of one flight, on the clock and with their pulses found.
    setting : Setting
        Cameras, source, medium and waypoints.
    n_legs : int, optional
        How many legs there are, where the user knows it; None: as many as the data show.
    either_way : bool, optional
        Whether the way in which a clock runs is not asked again.

    Returns
    -------
    tuple of ImageLeg
        Of repeats the first is searched; none of a camera in whose picture no leg stands out.

    Raises
    ------
    NothingFoundError
        Where none stands out in any picture.
    CalibrationError
        Where a clock runs backwards.
    """

    def legs_of(seen: Sighting, own: Setting) -> tuple[ImageLeg, ...]:
        if either_way:
            return search_legs(seen.arrivals, seen, own, n_legs)
        return legs_of_straight_light(seen, own, n_legs)

    found: list[ImageLeg] = []
    problem: NothingFoundError | None = None
    for seen in first_of_each_view(sightings):
        try:
            found += legs_of(seen, setting.at(seen.view))
        except NothingFoundError as none:
            problem = problem or none
    if not found:
        assert problem is not None
        raise problem
    return tuple(found)


def refuse_if_clearer_backwards(
    legs: tuple[ImageLeg, ...],
    sighting: Sighting,
    setting: Setting,
    n_legs: int | None,
) -> None:
    """Raise CalibrationError where the clock run backwards shows legs as clear, rightly bent.

    Parameters
    ----------
    legs : tuple of ImageLeg
        Legs found on the clock as it is; none: ().
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    setting : Setting
        Camera, source, medium and waypoints.
    n_legs : int or None
        How many legs there are, where the user knows it; None: as many as the data show.

    Raises
    ------
    CalibrationError
        Where the codes run backwards.
    """
    if not _one_medium(setting.medium):
        return
    # No period: folding would undo the mirror.
    backwards = replace(sighting.arrivals, arrival_ps=-sighting.arrival_ps, laser_period_ps=None)
    try:
        mirrored = search_legs(backwards, sighting, setting, n_legs)
    except NothingFoundError:
        return

    def clarity(found: tuple[ImageLeg, ...]) -> float:
        return float(sum(leg.n_pixels**2 for leg in found))

    turned = replace(sighting, arrivals=backwards, arrival_ps=backwards.arrival_ps)
    bend = bend_significance(mirrored, turned, setting.camera)
    if clarity(mirrored) >= clarity(legs) and bend > 3.0:
        now = sighting.histograms.reversed_codes
        raise CalibrationError(
            "the arrival times bend the wrong way for straight light, so the codes run backwards: "
            f"read the recording with reversed_codes={not now} (it says {now})"
        )


def ask_which_way(
    legs: tuple[ImageLeg, ...],
    sighting: Sighting,
    camera: Camera,
    timing: CodeClock | None,
    problem: Exception,
) -> None:
    """Where no path fits on a clock nobody calibrated and its direction does not show, ask.

    Parameters
    ----------
    legs : tuple of ImageLeg
        Legs as found in the picture, in the order of flight.
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    camera : Camera
        The camera that sees it.
    timing : TimingCalibration or None
        Its calibrated clock; None: nominal codes.
    problem : Exception
        Why no path fits.

    Raises
    ------
    CalibrationError
        Where nobody calibrated the clock and its direction does not show.
    """
    # A calibrated clock has shown its direction, and so has a clear bend.
    if timing is not None or bend_significance(legs, sighting, camera) > 6.0:
        return
    now = sighting.histograms.reversed_codes
    raise CalibrationError(
        "no path fits these arrival times, and without a calibration they do not show which way "
        f"the codes run: give timing=, or try reversed_codes={not now} (the recording says {now})"
    ) from problem


def refuse_if_clock_scatters(sighting: Sighting, std_ps: float) -> None:
    """Refuse an unknown source on a clock that nobody calibrated, where its pixels disagree.

    Depth then rests on the bend of the arrival curves alone: 7 mm for each ps that a pixel errs.

    Parameters
    ----------
    sighting : Sighting
        The recording, on the nominal clock and with its pulses found.
    std_ps : float
        Typical standard deviation of a pulse, ps.

    Raises
    ------
    CalibrationError
        Where neighbouring pixels disagree by more than `MUCH_SCATTER` of a pulse, their errors and
        `_NO_DEPTH_PS`.
    """
    neighbours = scatter_of_neighbours(sighting.arrivals, sighting.timing)
    # Five errors: where light is starved, counting scatters as much.
    most = 0.0 if neighbours is None else max(MUCH_SCATTER * std_ps, 5.0 * neighbours[2])
    if neighbours is not None and neighbours[0] > max(most, _NO_DEPTH_PS):
        raise CalibrationError(
            "neither the source nor the clock is known, and the times of neighbouring pixels "
            f"scatter by {neighbours[0]:.0f} ps: no depth can be told; calibrate the clock "
            "(timing=), or give the source's place and time"
        )


def warn_of_scatter(
    floor_ps: float, legs: tuple[ImageLeg, ...], sighting: Sighting, camera: Camera
) -> None:
    """Say that an uncalibrated clock ruins the times, and that its direction may be wrong too.

    A clock that nobody calibrated scatters neighbouring pixels; where those agree, it is not what
    the times miss the path by.

    Parameters
    ----------
    floor_ps : float
        How much the times scatter beyond their errors, ps.
    legs : tuple of ImageLeg
        Legs as found in the picture, in the order of flight.
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    camera : Camera
        The camera that sees it.
    """
    neighbours = scatter_of_neighbours(sighting.arrivals, sighting.timing)
    if neighbours is not None and neighbours[0] < _CLOCKS_SHARE * floor_ps:
        warnings.warn(
            f"the times miss the path by {floor_ps:.0f} ps and those of neighbouring pixels agree "
            f"to {neighbours[0]:.0f} ps, so the clock is not to blame: check source, camera and "
            "the number of legs",
            SuspectDataWarning,
            stacklevel=3,
        )
        return
    now = sighting.histograms.reversed_codes
    either_way = bend_significance(legs, sighting, camera) < 6.0
    doubt = (
        f", and do not show which way the codes run (the recording says reversed_codes={now}; if "
        f"in doubt try reversed_codes={not now})"
        if either_way
        else ""
    )
    warnings.warn(
        f"the times scatter by {floor_ps:.0f} ps about the path: calibrate the clock{doubt}",
        SuspectDataWarning,
        stacklevel=3,
    )
