"""Records as napari layers: the pulse as tracks, vertices and pulses as points, counts as an image.

Takes a LightPath or Histograms, gives layer tuples (array, attributes, kind) that napari adds;
napari itself is not imported. `napari_get_reader` is the reader plug-in of `napari.yaml`: dropping
one of our files on napari's window opens it.

Axes are (time, z, y, x) in ps and mm, whole steps of time to make napari's slider useful. The
data keep the world's signs; an affine turns them by 180 degrees about x, since napari draws y
downwards and z away from the viewer.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lightflight.path.trace import (
    Trace,
    places_from_path,
    trace_from_path,
    traces_of_branches,
)
from lightflight.view.types import Floats

if TYPE_CHECKING:
    from lightflight import Histograms, LightPath

Layer = tuple[NDArray[np.generic], dict[str, Any], str]
"""(array, attributes, kind of layer)."""

UNITS = ("ps", "mm", "mm", "mm")

_STEP_PS = 5.0
"""Time from one position of napari's slider to the next, ps."""

_EVENT, _ARRIVAL = "#c8440a", "#0b63ce"


def layers_from_path(path: LightPath, *, step_ps: float = _STEP_PS) -> list[Layer]:
    """A path as layers: both clocks as tracks, then vertices and measured pulses as points.

    Parameters
    ----------
    path : LightPath
        The path.
    step_ps : float, optional
        Time from one position of the slider to the next, ps.

    Returns
    -------
    list of (array, dict, str)
        Layers, in the order in which they are drawn; those that would be empty are left out. Times
        count from vertex 0, those of arrival from the arrival of its light.

    Raises
    ------
    ValueError
        For a step that is not positive.
    """
    if not (np.isfinite(step_ps) and step_ps > 0):
        raise ValueError(f"step_ps must be positive, got {step_ps}")
    trace = trace_from_path(path)
    if len(trace.leg) == 0:
        return []
    common = {
        "scale": (step_ps, 1.0, 1.0, 1.0),
        "units": UNITS,
        "axis_labels": ("time", "z", "y", "x"),
        "affine": np.diag([1.0, -1.0, -1.0, 1.0, 1.0]),
        "metadata": {"method": getattr(path, "method", ""), "prior": getattr(path, "prior", "")},
    }
    branches = traces_of_branches(trace, path)
    event = [own.event_time_ps - trace.event_time_ps[0] for own in branches]
    arrival = [own.arrival_ps - trace.arrival_ps[0] for own in branches]
    layers = [_tracks(branches, event, step_ps, {**common, "name": "pulse, event time"})]
    if np.isfinite(trace.arrival_ps).all():
        more = {**common, "name": "its picture, arrival"}
        layers.append(_tracks(branches, arrival, step_ps, more))
    layers.append(_vertex_points(path, step_ps, common))
    pulses = _pulse_points(path, float(trace.event_time_ps[0]), step_ps, common)
    return layers if pulses is None else [*layers, pulses]


def _tracks(
    branches: Sequence[Trace],
    times_ps: Sequence[Floats],
    step_ps: float,
    attributes: dict[str, object],
) -> Layer:
    """One point per branch and step of the slider: (n, 5), id, time (steps), z, y, x."""
    rows, legs, longest = [], [], 0
    for number, (trace, times) in enumerate(zip(branches, times_ps, strict=True)):
        steps = np.arange(int(np.floor(times[-1] / step_ps)) + 1)
        place = [np.interp(steps * step_ps, times, trace.points_mm[:, k]) for k in (2, 1, 0)]
        rows.append(np.column_stack((np.full(len(steps), float(number)), steps, *place)))
        at = np.minimum(np.searchsorted(times, steps * step_ps), len(times) - 1)
        legs.append(trace.leg[at])
        longest = max(longest, len(steps))
    # `tail_length` is in steps: the whole flight stays drawn behind the pulse.
    more = {"features": {"leg": np.concatenate(legs)}, "tail_length": longest, "tail_width": 3}
    return np.concatenate(rows), {**attributes, **more}, "tracks"


def _vertex_points(path: LightPath, step_ps: float, common: dict[str, object]) -> Layer:
    times = np.asarray(path.vertex_times_ps, dtype=float)
    vertices = np.asarray(path.vertices_mm, dtype=float)
    rows = np.column_stack(((times - times[0]) / step_ps, vertices[:, ::-1]))
    features: dict[str, object] = {"vertex": np.arange(len(times))}
    std = getattr(path, "vertex_std", None)
    if std is not None:
        names = ("x_std_mm", "y_std_mm", "z_std_mm", "event_time_std_ps")
        features |= {name: np.asarray(std)[:, k] for k, name in enumerate(names)}
    attributes = {
        **common,
        "name": "vertices",
        "features": features,
        "size": _marker_mm(vertices),
        "face_color": _EVENT,
        "out_of_slice_display": True,
    }
    return rows, attributes, "points"


def _pulse_points(
    path: LightPath, start_ps: float, step_ps: float, common: dict[str, object]
) -> Layer | None:
    """Measured pulses at their place on the path, with residuals as features."""
    places = places_from_path(path)
    known = np.isfinite(places.points_mm).all(axis=1) & np.isfinite(places.measured_event_time_ps)
    if not known.any():
        return None
    when = (places.measured_event_time_ps[known] - start_ps) / step_ps
    rows = np.column_stack((when, places.points_mm[known][:, ::-1]))
    names = ("row", "col", "leg", "arrival_ps", "residual_ps", "std_ps", "used")
    attributes = {
        **common,
        "name": "pulses",
        "features": {name: np.asarray(getattr(places, name))[known] for name in names},
        "size": 0.5 * _marker_mm(np.asarray(path.vertices_mm, dtype=float)),
        "face_color": _ARRIVAL,
        "visible": False,
    }
    return rows, attributes, "points"


def _marker_mm(vertices: Floats) -> float:
    size = float(np.nanmax(np.ptp(vertices, axis=0), initial=0.0))
    return 0.02 * size if size > 0 else 1.0


def layers_from_histograms(hist: Histograms) -> list[Layer]:
    """Counts as an image (code, row, col), read-only as the record; time along the first axis.

    The first axis is in ps where the time per code is known, and runs forwards; codes that run
    backwards are turned.

    Parameters
    ----------
    hist : Histograms
        The recording.
    """
    width = hist.bin_width_ps
    counts = np.moveaxis(hist.counts, 2, 0)
    if hist.no_photon_code is not None:
        counts = counts.copy()
        # Frames without a photon are counted there: they would outshine all light.
        counts[hist.no_photon_code] = 0
    if hist.reversed_codes:
        counts = counts[::-1]
    attributes = {
        "name": "counts",
        "scale": (1.0 if width is None else width, 1.0, 1.0),
        "units": ("pixel" if width is None else "ps", "pixel", "pixel"),
        "axis_labels": ("code" if width is None else "delay", "row", "col"),
        "colormap": "inferno",
        "metadata": {"laser_period_ps": hist.laser_period_ps},
    }
    return [(counts, attributes, "image")]


def napari_get_reader(
    path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
) -> Callable[[object], list[Layer]] | None:
    """Reader of napari's plug-in protocol: a function for files that are ours, None for others."""
    files = [path] if isinstance(path, str | os.PathLike) else list(path)
    if not files or any(_kind(file) is None for file in files):
        return None
    return _read_layers


def _kind(file: str | os.PathLike[str]) -> str | None:
    """What of ours a file holds that can be drawn; None for anything else."""
    from lightflight.files.store import kind_of_record

    try:
        # A foreign or damaged file is for another reader to judge: napari asks them all.
        kind = kind_of_record(file)
    except (ValueError, OSError):
        return None
    return kind if kind in ("path", "histograms", "recording") else None


def _read_layers(path: Any) -> list[Layer]:
    from lightflight.formats.registry import read
    from lightflight.path.light_path import LightPath
    from lightflight.recording.counting import histogram

    layers = []
    for file in [path] if isinstance(path, str | os.PathLike) else list(path):
        if _kind(file) == "path":
            found = layers_from_path(LightPath.load(file))
        else:
            found = layers_from_histograms(histogram(read(file)))
        prefix = f"{Path(file).stem}: " if len(found) else ""
        for _, attributes, _ in found:
            attributes["name"] = prefix + attributes["name"]
        layers += found
    return layers
