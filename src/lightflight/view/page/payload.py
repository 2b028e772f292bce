"""What the page knows: records as JSON with packed arrays, safe inside a script element.

Takes a LightPath and what it was made from, gives a dictionary (`payload_from_records`) and its
text (`json_for_html`). NumPy only. Times in it are "since vertex 0" on their own clock, so that
single precision is plenty for tables; vertices keep all their digits.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight import flags as fl
from lightflight.errors import GeometryError
from lightflight.files.json_values import json_value
from lightflight.flight import Medium
from lightflight.path.apparent_speed import apparent_speed_along
from lightflight.path.error import path_error
from lightflight.path.tables import Goodness, Polyline
from lightflight.path.trace import (
    Trace,
    across_axes,
    has_errors,
    places_from_path,
    trace_from_path,
)
from lightflight.path.tree import starts_of, ways
from lightflight.path.verdict import NOT_EXAMINED
from lightflight.view.page.histograms import histogram_blob
from lightflight.view.page.packing import camera_part, packed
from lightflight.view.page.second import second_view
from lightflight.view.types import Json

if TYPE_CHECKING:
    from lightflight import Arrivals, Camera, Histograms, LightPath, Pulses, TimingCalibration


SCHEMA = 1
"""Version of the page's data; page.js reads this one."""

TRACE_POINTS = 2000
"""Points along a path, all legs together, beyond the ends of the legs."""


def json_for_html(payload: Json) -> str:
    r"""JSON text that cannot end its script element, whatever strings it holds.

    `<`, `>`, `&` and the two line separators of JavaScript are written as escapes, so neither
    `</script` nor `<!--` can appear.

    Examples
    --------
    >>> json_for_html({"title": "</script>"})
    '{"title":"\\u003c/script\\u003e"}'
    """
    # A NaN is no JSON: better an error here than a page that does not start.
    text = json.dumps(payload, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def payload_from_records(
    path: LightPath,
    *,
    hist: Histograms | None = None,
    timing: TimingCalibration | None = None,
    pulses: Pulses | None = None,
    arrivals: Arrivals | None = None,
    title: str = "",
    second_camera: Camera | None = None,
) -> Json:
    """Everything the page shows, from a path and, where they are at hand, its recording and clock.

    Parameters
    ----------
    path : LightPath
        The path.
    hist : Histograms, optional
        Recording it was made from, for the pixels' histograms.
    timing : TimingCalibration, optional
        Calibration used.
    pulses : Pulses, optional
        Pulses fitted to `hist`.
    arrivals : Arrivals, optional
        Their arrival times.
    title : str, optional
        Heading; empty: one is made.
    second_camera : Camera, optional
        Camera anywhere, whose view of the path is computed beside the first's.

    Raises
    ------
    GeometryError
        Where `second_camera` sees no part of the path.
    """
    truth = getattr(path, "truth", None)
    camera = getattr(path, "camera", None)
    n_legs = max(len(np.atleast_1d(path.vertex_times_ps)) - 1, 0)
    # A path of many legs gets fewer points on each: the page must stay light enough to turn.
    per_leg = max(5, min(65, TRACE_POINTS // max(n_legs, 1)))
    trace = trace_from_path(path, per_leg=per_leg)
    out: Json = {
        "schema": SCHEMA,
        "title": title,
        "path": _path_part(path, trace),
        "trace": _trace_part(path, trace),
        "truth": _truth_part(path, truth),
        "camera": camera_part(camera, path),
        "pulses": _pulses_part(path, arrivals, trace),
        "flags": [[flag.value, flag.name, flag.meaning] for flag in fl.REGISTRY],
        "words": _words_part(path),
        "verdict": _verdict_part(path),
        "clock": _clock_part(timing),
        "histograms": None,
        "second": None if second_camera is None else second_view(path, second_camera, trace),
        "missing": _missing(path, hist, arrivals, timing, truth),
    }
    if hist is not None:
        out["histograms"] = histogram_blob(hist, pulses=pulses, timing=timing)
    return out


def _path_part(path: LightPath, trace: Trace) -> Json:
    vertices = np.asarray(path.vertices_mm, dtype=float).reshape(-1, 3)
    times = np.asarray(path.vertex_times_ps, dtype=float).reshape(-1)
    medium = getattr(path, "medium", None) or Medium()
    source = getattr(path, "source", None)
    width = getattr(source, "pulse_fwhm_ps", None) or 68.0
    std = np.full((len(times), 4), np.nan)
    if has_errors(path):
        diagonal = np.diag(np.asarray(path.covariance, dtype=float))
        std = np.sqrt(np.maximum(diagonal, 0.0)).reshape(-1, 4)
    return {
        "vertices_mm": json_value(vertices),
        "vertex_times_ps": json_value(times),
        "vertex_std": json_value(std),
        "leg_starts": starts_of(path).tolist(),
        "ways": [list(way) for way in ways(starts_of(path))],
        "legs": [
            _fields(leg, "length_mm", "angle_deg", "angle_std_deg", "paper_angle_deg")
            | {"seen": leg.seen}
            | ({"bent": True} if leg.course is not None else {})
            for leg in getattr(path, "legs", ())
        ],
        "path_index": medium.path_group_index,
        "return_index": medium.return_group_index,
        "first_arrival_ps": json_value(float(trace.arrival_ps[0])) if len(trace.leg) else None,
        "pulse_fwhm_ps": float(width),
        "pulse_fwhm_known": getattr(source, "pulse_fwhm_ps", None) is not None,
        "source_known": source is not None and source.position_mm is not None,
    }


_GOODNESS = (
    "chi2", "dof", "n_pulses", "n_rejected", "residual_rms_ps", "error_floor_ps", "converged",
)  # fmt: skip


def _fields(record: object, *names: str) -> Json:
    """Fields of a record by name, as JSON can hold them."""
    return {name: json_value(getattr(record, name)) for name in names}


def _trace_part(path: LightPath, trace: Trace) -> Json:
    camera = getattr(path, "camera", None)
    variances, axes = across_axes(trace)
    half_axes = np.sqrt(np.maximum(variances, 0.0))[:, :, np.newaxis] * axes
    first = trace.arrival_ps[0] if len(trace.leg) else 0.0
    start = trace.event_time_ps[0] if len(trace.leg) else 0.0
    pixel = np.full((len(trace.leg), 2), np.nan)
    speed = np.full(len(trace.leg), np.nan)
    if camera is not None and len(trace.leg):
        row, col = camera.pixels_from_points(trace.points_mm)
        pixel = np.stack((np.asarray(row, float), np.asarray(col, float)), axis=1)
        speed = apparent_speed_along(trace, camera=camera, medium=getattr(path, "medium", None))
    std = np.sqrt(np.diagonal(trace.covariance, axis1=1, axis2=2))
    return {
        "points_mm": packed(trace.points_mm, "f4"),
        "event_ps": packed(trace.event_time_ps - start, "f4"),
        "arrival_ps": packed(trace.arrival_ps - first, "f4"),
        "length_mm": packed(trace.length_mm, "f4"),
        "leg": packed(trace.leg, "u2"),
        "in_view": packed(trace.in_view, "u1"),
        "std": packed(std, "f4"),
        "half_axes_mm": packed(half_axes, "f4") if has_errors(path) else None,
        "pixel": packed(pixel, "f4"),
        "apparent_speed": packed(speed, "f4"),
        "back_ps": _way_back(path, camera, trace),
    }


def _way_back(path: LightPath, camera: Camera | None, trace: Trace) -> Json | None:
    """Time of the light to the camera where windows or bends ask for it; else None."""
    told = bool(getattr(path, "bends", ())) or (camera is not None and bool(camera.interfaces))
    if camera is None or not told or not len(trace.leg):
        return None
    return packed(trace.arrival_ps - trace.event_time_ps, "f8")


def errors_of(path: LightPath, truth: Polyline) -> tuple[float, float]:
    """(position rms mm, time rms ps) in view; NaN where the camera sees nothing of the truth.

    Parameters
    ----------
    path : LightPath
        The estimate; its camera says what is in view.
    truth : Polyline or None
        What to compare with.
    """
    try:
        error = path_error(path, truth, path.camera)
    except GeometryError:
        return float("nan"), float("nan")
    return error.position_rms_mm, error.event_time_rms_ps


def _truth_part(path: LightPath, truth: Polyline | None) -> Json | None:
    if truth is None:
        return None
    part = {
        "vertices_mm": json_value(np.asarray(truth.vertices_mm, dtype=float)),
        "vertex_times_ps": json_value(np.asarray(truth.vertex_times_ps, dtype=float)),
        "leg_starts": starts_of(truth).tolist(),
        "position_rms_mm": None,
        "time_rms_ps": None,
    }
    if getattr(path, "camera", None) is not None:
        position, time = errors_of(path, truth)
        part["position_rms_mm"], part["time_rms_ps"] = json_value(position), json_value(time)
    return part


def _pulses_part(path: LightPath, arrivals: Arrivals | None, trace: Trace) -> Json | None:
    """One row per pulse that lies on the path or was found in the recording."""
    places = places_from_path(path)
    n = len(places.row)
    first = trace.arrival_ps[0] if len(trace.leg) else 0.0
    start = trace.event_time_ps[0] if len(trace.leg) else 0.0
    table = {
        "row": places.row,
        "col": places.col,
        "leg": places.leg,
        "arrival_ps": places.arrival_ps - first,
        "event_ps": places.measured_event_time_ps - start,
        "residual_ps": places.residual_ps,
        "std_ps": places.std_ps,
        "length_mm": places.length_mm,
        "used": places.used.astype(np.uint8),
        "flags": _column(path, "flags", n, 0),
        "photons": _column(path, "photons", n, np.nan),
        "width_ps": np.full(n, np.nan),
    }
    if arrivals is not None:
        table = _with_arrivals(table, arrivals, first)
    if len(table["row"]) == 0:
        return None
    kinds = {"row": "u2", "col": "u2", "leg": "i4", "used": "u1", "flags": "u4"}
    return {name: packed(values, kinds.get(name, "f4")) for name, values in table.items()}


def _column(path: LightPath, name: str, n: int, default: float) -> NDArray[Any]:
    table: NDArray[Any] | None = getattr(path, "residuals", None)
    if table is None or n == 0 or name not in (table.dtype.names or ()):
        return np.full(n, default)
    return np.asarray(table[name])


def _with_arrivals(table: Json, arrivals: Arrivals, first: float) -> Json:
    """Add to the pulses of the path what else was found, and the pulses' own widths."""
    period = getattr(arrivals, "laser_period_ps", None)
    when = np.asarray(arrivals.arrival_ps, dtype=float) - first
    own = _found_again(table, arrivals, when)
    if period is not None:
        # Unfolded to the period that starts a quarter before the first light, as the path counts.
        when = when - period * np.floor((when + 0.25 * period) / period)
    width = np.append(np.asarray(arrivals.std_ps, dtype=float), np.nan)
    table["width_ps"] = width[own]
    silent = np.uint32(fl.NO_PHOTONS | fl.NO_PULSE | fl.TOO_FEW)
    words = np.asarray(arrivals.flags, dtype=np.uint32)
    extra = (words & silent) == 0
    extra[own[own >= 0]] = False
    nan = np.full(int(extra.sum()), np.nan)
    more = {
        "row": np.asarray(arrivals.row)[extra],
        "col": np.asarray(arrivals.col)[extra],
        "leg": np.full(len(nan), -1),
        "arrival_ps": when[extra],
        "std_ps": nan,
        "photons": np.asarray(arrivals.photons, dtype=float)[extra],
        "flags": words[extra],
        "used": np.zeros(len(nan), dtype=np.uint8),
        "width_ps": np.asarray(arrivals.std_ps, dtype=float)[extra],
    }
    return {name: np.concatenate((values, more.get(name, nan))) for name, values in table.items()}


def _found_again(table: Json, arrivals: Arrivals, when: NDArray[np.float64]) -> NDArray[np.int64]:
    """(n,), which arrival each pulse of the path is: of its pixel, and at its time; -1 for none.

    A pixel may hold pulses of several legs, and the path those of several repeats.
    """
    n_cols = arrivals.shape[1]
    key = np.asarray(arrivals.row, dtype=np.int64) * n_cols + np.asarray(arrivals.col)
    pixel = table["row"].astype(np.int64) * n_cols + table["col"]
    period = getattr(arrivals, "laser_period_ps", None) or np.inf
    order = np.argsort(key, kind="stable")
    start, stop = (np.searchsorted(key[order], pixel, side) for side in ("left", "right"))
    best, gap = np.full(len(pixel), -1), np.full(len(pixel), np.inf)
    for k in range(int((stop - start).max(initial=0))):
        some = np.flatnonzero(start + k < stop)
        candidate = order[start[some] + k]
        apart = np.abs(when[candidate] - table["arrival_ps"][some])
        if np.isfinite(period):
            apart = np.minimum(apart % period, period - apart % period)
        # Closer than its own width it is the same light.
        near = (apart < gap[some]) & (apart < np.asarray(arrivals.std_ps)[candidate])
        best[some[near]], gap[some[near]] = candidate[near], apart[near]
    return best


def fit_in_words(goodness: Goodness) -> str:
    """Pulses, chi-square by the stated errors, and what that leaves to the error floor.

    Parameters
    ----------
    goodness : Goodness
        Of the path.
    """
    if not goodness.dof > 0 or not np.isfinite(goodness.chi2):
        return ""
    said = f"{goodness.n_pulses} pulses, \u03c7\u00b2/dof {goodness.reduced_chi2:.2f}"
    if not goodness.error_floor_ps > 0:
        return said
    return f"{said}, extra scatter {goodness.error_floor_ps:.2g} ps"


def _words_part(path: LightPath) -> Json:
    goodness = getattr(path, "goodness", None)
    return {
        "method": json_value(getattr(path, "method", "")),
        "prior": json_value(getattr(path, "prior", "")),
        "statements": json_value(getattr(path, "statements", ())),
        "provenance": json_value(dict(getattr(path, "provenance", None) or {})),
        "goodness": None if goodness is None else _fields(goodness, *_GOODNESS),
        "fit": "" if goodness is None else fit_in_words(goodness),
    }


def _verdict_part(path: LightPath) -> Json:
    """The verdict, and what belongs to it, in words."""
    verdict = getattr(path, "verdict", NOT_EXAMINED)
    explained = getattr(path, "explained", None)
    return {
        "level": str(verdict.level),
        "headline": verdict.headline,
        "findings": [
            {
                "name": str(finding.name),
                "sentence": finding.sentence,
                "sigma": json_value(finding.sigma),
                "remedy": finding.remedy,
            }
            for finding in verdict.findings
        ],
        "blind_to": [str(spot) for spot in verdict.blind_to],
        "exact": json_value(getattr(path, "prices", ())),
        "explained": "" if explained is None else str(explained),
    } | _other_answers(path)


def _other_answers(path: LightPath) -> Json:
    """Other paths that explain the recording, in words; nothing where there is none."""
    others = [str(other) for other in getattr(path, "alternatives", ())]
    return {"alternatives": others} if others else {}


def _clock_part(timing: TimingCalibration | None) -> Json | None:
    """Summary of the calibration: numbers, mean phases, notes."""
    if timing is None:
        return None
    response = np.asarray(timing.response_std_ps, dtype=float)
    good = np.asarray(fl.is_usable(timing.flags))

    def spread(values: ArrayLike) -> float | None:
        kept = np.asarray(values, dtype=float)[good]
        kept = kept[np.isfinite(kept)]
        return json_value(float(kept.std())) if kept.size else None

    phases = np.asarray(timing.phases, dtype=float)
    n_phases = phases.shape[2]
    return {
        "bin_width_ps": json_value(timing.bin_width_ps),
        "scale_std": json_value(timing.scale_std),
        "laser_period_ps": json_value(timing.laser_period_ps),
        "reversed_codes": bool(timing.reversed_codes),
        "gain_std": spread(timing.gain),
        "delay_std_ps": spread(timing.skew_ps),
        "response_std_ps": json_value(np.nanmedian(response[good]))
        if np.isfinite(response[good]).any()
        else None,
        "phases": json_value(np.nanmean(phases[good], axis=0)) if 1 < n_phases <= 64 else None,
        "usable": int(good.sum()),
        "pixels": int(good.size),
        "reasons": fl.count_flags(timing.flags),
        "notes": json_value(timing.notes),
    }


def _missing(
    path: LightPath,
    hist: Histograms | None,
    arrivals: Arrivals | None,
    timing: TimingCalibration | None,
    truth: Polyline | None,
) -> list[str]:
    """What is not there and what the page therefore cannot show, in sentences."""
    said = []
    if len(np.atleast_1d(path.vertex_times_ps)) < 2:
        said.append("The path has no legs: there is nothing to fly along.")
    if getattr(path, "camera", None) is None:
        said.append("No camera: arrival times cannot be told.")
    if not has_errors(path):
        said.append("The path carries no finite errors: no error tubes, no error bars.")
    if truth is None:
        said.append("The truth is not known (a real recording, or a path that lost it).")
    if getattr(path, "residuals", None) is None or len(path.residuals) == 0:
        said.append("The path carries no residuals.")
    if hist is None:
        said.append("No recording was given: pixels have no histograms.")
    elif arrivals is None:
        said.append("The recording holds no usable pulses.")
    if timing is None:
        said.append("No timing calibration was given.")
    return said
