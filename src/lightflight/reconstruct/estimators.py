"""Estimators by name: the one place where one more is made known.

Light to import, for the command line and the set-up ask for the names alone: what an estimator
needs is loaded when it fits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lightflight.path.light_path import LightPath
    from lightflight.reconstruct.fit.joint import JointFit
    from lightflight.reconstruct.ways.request import Request


@dataclass(frozen=True)
class Estimator:
    """One way from the pulses of a recording to a path.

    Attributes
    ----------
    name : str
        For `method=`.
    summary : str
        What it does, in the words of docs/how-to/choose-estimator.md.
    fit : Callable[[Request], tuple[LightPath, JointFit | None]]
        The path, on whatever lap of the clock it comes out, and the fit of pulses that it rests on.
    needs_counts : bool
        True where scaled intensities (`poisson=False`) will not do.
    several_cameras : bool
        True where it fits what several cameras saw of one flight.
    least_squares : bool
        True where its pulses are found as the paper does: one Gaussian per pixel, by least squares.
    through_windows : bool
        True where the cameras may look through interfaces.
    of_fit : Callable[[JointFit, Request], LightPath] or None
        The path from a fit of pulses that has legs nobody saw; None: it knows no such legs.
    """

    name: str
    summary: str
    fit: Callable[[Request], tuple[LightPath, JointFit | None]]
    needs_counts: bool = False
    several_cameras: bool = False
    least_squares: bool = False
    through_windows: bool = True
    of_fit: Callable[[JointFit, Request], LightPath] | None = None


def _paper(request: Request) -> tuple[LightPath, JointFit | None]:
    from lightflight.reconstruct.ways.paper import path_by_paper

    return path_by_paper(request), None


def _joint(request: Request) -> tuple[LightPath, JointFit | None]:
    from lightflight.reconstruct.ways.joint import path_by_joint

    return path_by_joint(request)


def _photon(request: Request) -> tuple[LightPath, JointFit | None]:
    from lightflight.reconstruct.ways.photon import path_by_photon

    return path_by_photon(request)


def _joint_of_fit(fit: JointFit, request: Request) -> LightPath:
    from lightflight.reconstruct.ways.joint import path_of_pulses

    return path_of_pulses(fit, request)


def _photon_of_fit(fit: JointFit, request: Request) -> LightPath:
    from lightflight.reconstruct.all_counts.photon import path_of_all_counts
    from lightflight.reconstruct.ways.joint import path_of_fit

    return path_of_all_counts(fit, path_of_fit(fit, request), request.setting)


ESTIMATORS = (
    Estimator(
        "paper",
        "the estimator of Zheng et al. 2020, to the letter",
        _paper,
        least_squares=True,
        through_windows=False,
    ),
    Estimator(
        "joint",
        "time and error of each pulse, then all vertices and nuisances in one weighted fit",
        _joint,
        of_fit=_joint_of_fit,
        several_cameras=True,
    ),
    Estimator(
        "photon",
        "likelihood of every count; dim pixels count too",
        _photon,
        of_fit=_photon_of_fit,
        needs_counts=True,
        several_cameras=True,
    ),
)
"""From the paper's to the limit."""

METHODS = tuple(estimator.name for estimator in ESTIMATORS)
"""Their names."""


def estimator_named(method: str) -> Estimator:
    """The estimator of a name.

    Parameters
    ----------
    method : str
        One of `METHODS`.

    Returns
    -------
    Estimator
        The first that has this name.

    Raises
    ------
    ValueError
        Where none has it.
    """
    for estimator in ESTIMATORS:
        if isinstance(method, str) and estimator.name == method:
            return estimator
    raise ValueError(f"method must be one of {', '.join(METHODS)}, got {method!r:.60}")
