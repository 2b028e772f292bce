"""What a record shows of itself: its figures by name, and its table.

Takes any record, gives a Figure or a DataFrame. One list of names for `lightflight plot` and for
the records' own `plot`. pandas is imported here only.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from lightflight.errors import optional_package

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

PATH_FIGURES = ("summary", "space", "times", "errors", "residuals", "residual-map", "pulls")
CLOCK_FIGURES = ("clock", "gain", "phases", "delays", "response", "pixels")
_NAMES = {
    "LightPath": PATH_FIGURES,
    "TimingCalibration": CLOCK_FIGURES,
    "Histograms": ("counts",),
    "Arrivals": ("picture",),
    "Plan": ("plan",),
    "CampaignTable": ("campaign",),
}
_DRAWERS = {
    "summary": "demo_figure",
    "clock": "calibration_figure",
    "counts": "recording_figure",
    "picture": "draw_camera_picture",
    "plan": "plan_figure",
    "space": "draw_path_3d",
    "times": "draw_times",
    "errors": "draw_time_errors",
    "residuals": "draw_residuals_along",
    "residual-map": "draw_residual_map",
    "pulls": "draw_pulls",
    "gain": "draw_gain_map",
    "phases": "draw_phases",
    "delays": "draw_delay_map",
    "response": "draw_response_widths",
    "pixels": "draw_bad_pixels",
}
"""Functions of `lightflight.view` that need nothing but the record."""


def figure_of(record: Any, what: str | None = None) -> Figure:
    """A figure of a record.

    Parameters
    ----------
    record : object
        LightPath, TimingCalibration, Histograms, Arrivals, Plan or CampaignTable.
    what : str, optional
        Which figure, as `lightflight plot --what` calls it; None: the one that shows most.

    Returns
    -------
    Figure
        To be shown, or written by `view.write_figure`.

    Raises
    ------
    ValueError
        Where no such figure can be drawn of it.
    TypeError
        For a record of another kind.
    """
    from lightflight import view

    kind = type(record).__name__
    if kind not in _NAMES:
        raise TypeError(f"no figure is known of a {kind}: draw one of {', '.join(_NAMES)}")
    known = _NAMES[kind]
    what = known[0] if what is None else what
    if what not in known:
        raise ValueError(f"what={what!r}: of a {kind} can be drawn: {', '.join(map(repr, known))}")
    if what == "campaign":
        return view.campaign_figure(record.repeats(), verdicts=record.n_by_verdict)
    drawn = getattr(view, _DRAWERS[what])(record)
    figure: Figure = drawn.get_figure(root=True) if hasattr(drawn, "get_figure") else drawn
    return figure


def dataframe_of(record: Any) -> DataFrame:
    """The table of a record, errors beside the values, units in the names of the columns.

    Parameters
    ----------
    record : object
        LightPath: its corners, one row each; Arrivals, Pulses: one row per pulse; Plan: one row per
        place of the camera; CampaignTable: one row per recording.

    Returns
    -------
    pandas.DataFrame

    Raises
    ------
    TypeError
        For a record of another kind.
    MissingExtraError
        Without pandas.
    """
    pandas = optional_package(
        "pandas", "tables of records need pandas, which is not installed: pip install pandas"
    )
    kind = type(record).__name__
    if kind not in _COLUMNS:
        raise TypeError(f"no table is known of a {kind}: there is one of {', '.join(_COLUMNS)}")
    return pandas.DataFrame(_COLUMNS[kind](record))


def _corners(path: Any) -> dict[str, object]:
    columns: dict[str, object] = {"vertex": range(path.n_legs + 1)}
    if path.forks:
        columns["from_vertex"] = [-1, *(leg.start_vertex for leg in path.legs)]
    values = (*path.vertices_mm.T, path.vertex_times_ps)
    names = ("x", "mm"), ("y", "mm"), ("z", "mm"), ("event_time", "ps")
    for (axis, unit), value, std in zip(names, values, path.vertex_std.T, strict=True):
        columns |= {f"{axis}_{unit}": value, f"{axis}_std_{unit}": std}
    return columns


def _pulses(table: Any) -> dict[str, object]:
    shape = table.row.shape
    return {name: v for name, v in vars(table).items() if getattr(v, "shape", None) == shape}


def _places(plan: Any) -> list[dict[str, object]]:
    return [
        {
            "place": place.name,
            "position_rms_mm": place.bounds.position_rms_mm,
            "event_time_rms_ps": place.bounds.event_time_rms_ps,
            "angle_std_deg": float(place.bounds.angle_std_deg.max()),
            "photons_per_pixel": place.photons_per_pixel,
            "seconds": place.seconds,
        }
        for place in plan.placements
    ]


_COLUMNS: dict[str, Callable[[Any], Any]] = {
    "LightPath": _corners,
    "Arrivals": _pulses,
    "Pulses": _pulses,
    "Plan": _places,
    "CampaignTable": lambda table: [
        {name: row.get(name) for name in table.columns} for row in table.rows
    ],
}
