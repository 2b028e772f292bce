"""What an experiment can reach: error against light by place of the camera, and by angle.

Takes a Plan (`reconstruct.planning`), gives Axes or a Figure.
"""

from __future__ import annotations

from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from lightflight.view import style

if TYPE_CHECKING:
    from lightflight import Plan

_COLOURS = (style.EVENT, style.ARRIVAL, *style.OTHERS)


@style.styled
def draw_error_against_light(plan: Plan, ax: Axes | None = None) -> Axes:
    """Position error in view against photons in the brightest pixel, a line per placement.

    Each line falls with the square root of the light to the floor that the priors leave; dots
    mark the light asked about, a cross the wanted error.

    Parameters
    ----------
    plan : Plan
        Places of the camera and what they allow.
    ax : Axes, optional
        Where to draw; None makes a figure of its own.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    ax = style.axes_or_new(ax, 90, 70) if ax is None else ax
    light = np.geomspace(10.0, 1e7, 120)
    for place, colour in zip(plan.placements, cycle(_COLOURS), strict=False):
        here = place.bounds
        # The floor is found by a limit of its own: rounding may put it a hair above the whole.
        photon_share = max(here.position_rms_mm**2 - place.floor_mm**2, 0.0)
        error = np.sqrt(
            photon_share * here.photons_per_pixel / light + min(place.floor_mm, 1e9) ** 2
        )
        ax.loglog(light, error, color=colour, label=place.name)
        ax.plot(here.photons_per_pixel, here.position_rms_mm, "o", color=colour, markersize=4)
    wanted = plan.wanted.get("position_rms_mm")
    if wanted:
        ax.axhline(wanted, color=style.QUIET, linewidth=0.8, linestyle=(0, (4, 2)))
        ax.annotate(
            f"wanted: {wanted:g} mm", (light[0], wanted), ha="left", va="bottom", fontsize=7
        )
    ax.set_xlabel("photons in the brightest pixel")
    ax.set_ylabel("position error in view (mm, rms)")
    style.title(ax, "Error against light", "dots: the light told")
    ax.legend(loc="upper right")
    ax.grid(visible=True)
    return ax


@style.styled
def draw_angle_sensitivity(plan: Plan, ax: Axes | None = None) -> Axes:
    """Error of each leg's angle per ps of error in each pixel, against the leg's angle.

    Parameters
    ----------
    plan : Plan
        Places of the camera and what they allow.
    ax : Axes, optional
        Where to draw; None makes a figure of its own.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    ax = style.axes_or_new(ax, 90, 70) if ax is None else ax
    for place, colour in zip(plan.placements, cycle(_COLOURS), strict=False):
        angles = [leg.angle_deg for leg in place.bounds.path.legs]
        ax.semilogy(angles, place.angle_deg_per_ps, "o", color=colour, label=place.name)
    # Of one leg alone the scale would be a point: at least two octaves about it.
    low, high = ax.get_ylim()
    ax.set_ylim(min(low, 0.5 * high), max(high, 2.0 * low))
    ax.axvline(0.0, color=style.HAIR, zorder=0)
    ax.set_xlim(-92, 92)
    ax.set_xticks(range(-90, 91, 30))
    ax.set_xlabel("leg's elevation (deg): away | towards the camera")
    ax.set_ylabel("deg of angle per ps in each pixel")
    ax.set_title("Sharpness of each leg")
    ax.grid(visible=True)
    return ax


@style.styled
def draw_array_choice(plan: Plan, ax: Axes | None = None) -> Axes:
    """Position error of the same light on arrays of more and fewer pixels.

    Parameters
    ----------
    plan : Plan
        Places of the camera and what they allow.
    ax : Axes, optional
        Where to draw; None makes a figure of its own.

    Returns
    -------
    Axes
        The axes drawn on.
    """
    ax = style.axes_or_new(ax, 90, 70) if ax is None else ax
    sizes = [choice.shape[1] for choice in plan.arrays]
    shapes = [choice.shape for choice in plan.arrays]
    errors = [choice.bounds.position_rms_mm for choice in plan.arrays]
    ax.loglog(sizes, errors, "o-", color=style.EVENT)
    ax.set_xticks(
        sizes, [f"{rows}²" if rows == cols else f"{rows}x{cols}" for rows, cols in shapes]
    )
    ax.set_ylim(0.5 * min(errors), 2.0 * max(errors))
    ax.set_xlabel("pixels behind the same field of view")
    ax.set_ylabel("position error in view (mm, rms)")
    ax.set_title("The same light, other arrays")
    # The sizes themselves are the ticks; powers of ten between them would run into them.
    ax.xaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.grid(visible=True)
    return ax


@style.styled
def plan_figure(plan: Plan) -> Figure:
    """Error against light, sharpness of the legs, and choice of array in one figure.

    Parameters
    ----------
    plan : Plan
        Places of the camera and what they allow.

    Returns
    -------
    Figure
        The page, to be saved or shown.
    """
    figure = style.new_figure(240.0, 80.0)
    axes = figure.subplots(1, 3, gridspec_kw={"wspace": 0.42})
    figure.subplots_adjust(left=0.075, right=0.98, bottom=0.17, top=0.9)
    draw_error_against_light(plan, axes[0])
    draw_angle_sensitivity(plan, axes[1])
    draw_array_choice(plan, axes[2])
    return figure
