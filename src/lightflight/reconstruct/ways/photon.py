"""`photon`: the likelihood of every count, from where `joint` or pooled pixels lead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lightflight.errors import CalibrationError, GeometryError, NothingFoundError
from lightflight.path.light_path import LightPath
from lightflight.path.tables import RESIDUAL_DTYPE
from lightflight.reconstruct.all_counts.counts import merged
from lightflight.reconstruct.all_counts.photon import path_of_all_counts, photon_path
from lightflight.reconstruct.all_counts.pooled import pooled_camera, pooled_sighting
from lightflight.reconstruct.fit.joint import JointFit, pulse_std_ps
from lightflight.reconstruct.sightings import unwrapped_sighting
from lightflight.reconstruct.ways.joint import fit_of_request, path_of_fit
from lightflight.reconstruct.ways.request import Request

_POOLING = (2, 4)
"""Pixels pooled along each axis where single ones are too dim."""


def path_by_photon(request: Request) -> tuple[LightPath, JointFit | None]:
    """The path by all counts at once.

    Parameters
    ----------
    request : Request
        What is asked.

    Returns
    -------
    path : LightPath
        On some lap of the clock.
    fit : JointFit or None
        The fit of single pulses that it set out from; None where none could be fitted alone.

    Raises
    ------
    GeometryError
        Where camera, source and path are in a degenerate position.
    NothingFoundError
        Where not even pooled pixels show a path.
    """
    try:
        fit = fit_of_request(request)
        rough = path_of_fit(fit, request)
    except NothingFoundError:
        # Only the likelihood of all counts can go on from here; the joint fit rests on single
        # pulses, and there is none that could tell of the tips.
        if request.start is not None:
            raise
        rough, std_ps = _pooled_path(request)
        return photon_path(request.sightings, request.setting, rough, std_ps=std_ps), None
    try:
        return path_of_all_counts(fit, rough, request.setting), fit
    except (GeometryError, NothingFoundError):
        if not (request.arms_first and fit.solution.state.forks):
            raise
    # With arms that the counts lead nowhere from: they are none.
    return path_by_photon(replace(request, arms_first=False))


def _pooled_path(request: Request) -> tuple[LightPath, float]:
    """A rough path where no pixel can be fitted alone, and the pulses' std, ps.

    Pixels are pooled two by two, four by four ... until legs appear.

    Raises
    ------
    NothingFoundError
        Where even the coarsest picture shows no path.
    """
    setting = request.setting
    wholes = [
        merged([one for one in request.sightings if one.view == view])
        for view in range(len(setting.cameras))
    ]
    problem: Exception | None = None
    for factor in _POOLING:
        # Four pixels along an axis are the least that a leg is looked for in.
        if min(min(camera.shape) for camera in setting.cameras) // factor < 4:
            break
        first, *others = (pooled_camera(camera, factor) for camera in setting.cameras)
        coarse = replace(setting, camera=first, others=tuple(others))
        try:
            # Pooled counts lie on their own clock, which must be folded like the recording's own.
            pooled = [
                unwrapped_sighting(
                    replace(pooled_sighting(whole, factor), view=whole.view), coarse.at(whole.view)
                )
                for whole in wholes
            ]
            asked = replace(request, sightings=pooled, setting=coarse, arms_first=False)
            path = path_of_fit(fit_of_request(asked), asked)
        except (GeometryError, NothingFoundError, CalibrationError) as found:
            problem = found
            continue
        # Residuals of pooled pixels mean nothing for single ones.
        rough = replace(path, camera=setting.camera, residuals=np.empty(0, RESIDUAL_DTYPE))
        return rough, pulse_std_ps(pooled)
    raise NothingFoundError(
        "too little light: no pixel can be fitted alone and pooled pixels show no path; record "
        "longer, or give a starting path (start=)"
    ) from problem
