"""Spots that are wide because the beam is: a lens spreads light along a leg as well.

The counts say how wide a leg's spot is across its flight. Along it, which is where times are mixed,
it is as wide where the lens is out of focus, and no wider than ever where the beam itself fans out:
behind a mirror that shakes, a cylindrical lens, a focus. How much of what is wider is the beam's is
a number of each leg in each camera's picture, an error that the leg's pulses share, about one half
(`picture.footprint_corrections`). Where spots are alike it changes nothing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.fit.uneven import pulses_by_leg, stacked_by_leg
from lightflight.reconstruct.model.picture import arrival_curvature
from lightflight.reconstruct.model.setting import Setting

Floats = NDArray[np.float64]

_SHARE_STD = 1.0
"""Of what the beam makes of what is wider, as times show it: about a half, none where it is the
lens, all where it is the beam, less or up to twice as much where that is as wide in depth."""


def with_broad_beams(fit: JointFit, setting: Setting) -> JointFit:
    """The fit with what is the beams' of their spots as errors that the pulses of a leg share.

    Parameters
    ----------
    fit : JointFit
        With fine pictures.
    setting : Setting
        As told.

    Returns
    -------
    JointFit
        Whose last shared errors these are.
    """
    columns: dict[tuple[int, int], Floats] = {}
    lens_px2 = [picture.spot_variances_px2[0] for picture in fit.pictures]
    for some in pulses_by_leg(fit, setting):
        sighting = fit.sightings[some.number]
        if not sighting.histograms.poisson:
            continue
        along, across = some.line.along_across(some.points_px)
        curvature = arrival_curvature(
            some.prints, state=fit.solution.state, camera=fit.solution.cameras[sighting.view],
            medium=setting.medium,
        )  # fmt: skip
        (by_lens, lens), (by_beam, none) = (
            some.light.looks_ahead(
                along, across, lens_var_px2=lens_px2[some.number], own_share=share
            )
            for share in (0.0, 1.0)
        )
        late = some.prints.slope_ps_per_px * (by_beam - by_lens) + 0.5 * curvature * (none - lens)
        column = columns.setdefault((sighting.view, some.leg), np.zeros(len(fit.times.leg)))
        column[some.rows] = _SHARE_STD * late
    modes = np.hstack((fit.times.modes_ps, stacked_by_leg(columns, fit)))
    return replace(fit, times=replace(fit.times, modes_ps=modes), broad=tuple(columns))
