"""Records as labelled arrays: xarray, with units and errors beside the values.

Takes a LightPath, Histograms, TimingCalibration or a table (Arrivals, Pulses), gives an
`xarray.Dataset`. xarray is imported here only.
"""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from lightflight.errors import optional_package

if TYPE_CHECKING:
    from lightflight import Arrivals, Histograms, LightPath, Pulses, TimingCalibration


_UNITS = (("_mm", "mm"), ("_ps", "ps"), ("_deg", "deg"), ("_px", "px"))


def _unit_of(name: str) -> dict[str, str]:
    """The unit that a name ends in (or has before `_std`), as xarray's attribute."""
    for ending, unit in _UNITS:
        if name.endswith(ending):
            return {"units": unit}
    return {}


def to_xarray(record: Any, *, samples: int = 1000) -> Any:
    """A record as an xarray.Dataset.

    A LightPath becomes points at equal event times (dimension `event_time_ps`), its vertices
    (`vertex`) and its pulses (`pulse`); Histograms become `counts` over (row, col, code), with the
    delay of the codes where it is known; a TimingCalibration its maps over (row, col); Arrivals
    and Pulses a table over `pulse`.

    Parameters
    ----------
    record : object
        LightPath, Histograms, TimingCalibration, Arrivals or Pulses.
    samples : int, optional
        Points along the path.

    Raises
    ------
    TypeError
        For anything else.
    MissingExtraError
        Without xarray.
    """
    xr = optional_package(
        "xarray", "labelled arrays need xarray, which is not installed: pip install xarray"
    )
    # By their fields: none of the records' modules needs to be loaded.
    if hasattr(record, "vertices_mm") and hasattr(record, "sample"):
        return _path_dataset(xr, record, samples)
    if hasattr(record, "counts"):
        return _histogram_dataset(xr, record)
    if hasattr(record, "gain") and hasattr(record, "phases"):
        return _clock_dataset(xr, record)
    if hasattr(record, "row") and hasattr(record, "photons"):
        return _table_dataset(xr, record)
    raise TypeError(
        f"to_xarray knows LightPath, Histograms, TimingCalibration, Arrivals and Pulses, "
        f"got {type(record).__name__}"
    )


def _path_dataset(xr: ModuleType, path: LightPath, samples: int) -> Any:
    table = path.sample(samples)
    when = table["event_time_ps"]
    variables: dict[str, object] = {
        name: ("event_time_ps", table[name], _unit_of(name))
        for name in table.dtype.names or ()
        if name != "event_time_ps"
    }
    axes = ["x", "y", "z"]
    variables["vertices_mm"] = (("vertex", "axis"), path.vertices_mm, {"units": "mm"})
    variables["vertex_times_ps"] = ("vertex", path.vertex_times_ps, {"units": "ps"})
    if path.forks:
        came_from = [-1, *(leg.start_vertex for leg in path.legs)]
        variables["from_vertex"] = ("vertex", np.array(came_from), {"comment": "-1: the first"})
    variables["vertex_std_mm"] = (("vertex", "axis"), path.vertex_std[:, :3], {"units": "mm"})
    variables["vertex_time_std_ps"] = ("vertex", path.vertex_std[:, 3], {"units": "ps"})
    for name in path.residuals.dtype.names or ():
        variables[f"pulse_{name}"] = ("pulse", path.residuals[name], _unit_of(name))
    return xr.Dataset(
        variables,
        coords={"event_time_ps": ("event_time_ps", when, {"units": "ps"}), "axis": axes},
        attrs={"method": path.method, "prior": path.prior, "made_by": "lightflight"},
    )


def _histogram_dataset(xr: ModuleType, hist: Histograms) -> Any:
    rows, cols = hist.shape
    coords: dict[str, object] = {
        "row": np.arange(rows),
        "col": np.arange(cols),
        "code": np.arange(hist.n_codes),
    }
    if hist.bin_width_ps is not None:
        lower, upper = hist.code_intervals_ps()
        coords["delay_ps"] = ("code", (lower + upper) / 2, {"units": "ps"})
    known = {
        name: getattr(hist, name)
        for name in (
            "bin_width_ps",
            "laser_period_ps",
            "n_frames",
            "periods_per_frame",
            "first_edge_ps",
            "no_photon_code",
        )
        if getattr(hist, name) is not None
    }
    # xarray's writers (netCDF) know no Booleans in attributes.
    known["reversed_codes"] = int(hist.reversed_codes)
    return xr.Dataset(
        {"counts": (("row", "col", "code"), hist.counts, {"units": "counts"})},
        coords=coords,
        attrs=known,
    )


def _clock_dataset(xr: ModuleType, timing: TimingCalibration) -> Any:
    variables: dict[str, object] = {}
    for name in ("gain", "gain_std", "end_code", "skew_ps", "skew_std_ps", "response_std_ps"):
        values = getattr(timing, name, None)
        if values is not None:
            variables[name] = (("row", "col"), np.asarray(values), _unit_of(name))
    variables["phases"] = (("row", "col", "phase"), np.asarray(timing.phases))
    variables["flags"] = (("row", "col"), np.asarray(timing.flags))
    rows, cols = timing.shape
    return xr.Dataset(
        variables,
        coords={"row": np.arange(rows), "col": np.arange(cols)},
        attrs={"bin_width_ps": timing.bin_width_ps, "scale_std": timing.scale_std},
    )


def _table_dataset(xr: ModuleType, table: Arrivals | Pulses) -> Any:
    n = len(table.row)
    variables = {
        name: ("pulse", value, _unit_of(name))
        for name, value in vars(table).items()
        if isinstance(value, np.ndarray) and value.shape == (n,)
    }
    return xr.Dataset(variables, attrs={"rows": table.shape[0], "cols": table.shape[1]})
