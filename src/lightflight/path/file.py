"""A LightPath as a file: our versioned HDF5. (As a table for other programs: view.export.)"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.blocks import Block
from lightflight.camera.model import Camera
from lightflight.errors import FileFormatError, LimitError
from lightflight.files.filecheck import damage_as_format_error
from lightflight.files.store import SCHEMA_VERSION, load_record, save_record
from lightflight.flight import Medium, Source
from lightflight.materials import Material
from lightflight.path.alternative import MOST_ALTERNATIVES, Alternative
from lightflight.path.bends import arrays_of_bends, bends_from_arrays
from lightflight.path.second_pulse import SecondPulse
from lightflight.path.tables import RESIDUAL_DTYPE, Explained, Goodness
from lightflight.path.tree import Forks, checked_forks, forks_of, leg_starts
from lightflight.path.verdict import NOT_EXAMINED, Verdict
from lightflight.provenance import provenance_record

if TYPE_CHECKING:
    from lightflight.path.light_path import LightPath

PATH_KIND = "path"
"""Kind of record in our HDF5 files."""
_SCHEMA_OF_UNSEEN, _SCHEMA_OF_FORKS_AND_BENDS, _SCHEMA_OF_OTHERS_AND_BLOCKS = 2, 3, 4
"""Of a path with legs that nobody saw, of one that forks, or whose truth does, or that bends, and
of one that is not the only answer or runs through blocks of glass: versions that know no such
schema refuse them."""
_INDICES = ("path_group_index", "return_group_index")
_KINDS: dict[str, tuple[type, ...]] = {
    "dof": (int,), "n_pulses": (int,), "n_rejected": (int,), "converged": (bool,),
}  # fmt: skip
_MOST = 2**62
_LONGEST_TEXT, _MOST_SENTENCES = 10_000, 1_000
_MOST_BLOCKS = 100
"""Each is asked for at every leg."""
_MOST_TRUE_VERTICES, _FARTHEST = 10_000, 1e16
"""Of what a simulation knows: of bent light, too; mm and ps."""
_MOST_PULSES, _MOST_PIXELS = 2_000_000, 1 << 24
"""Many times what the largest cameras have: each is drawn, and takes a kilobyte on the way."""


def save_path(path: LightPath, file: str | os.PathLike[str]) -> None:
    """Write a path with everything that belongs to it, whole or not at all.

    Parameters
    ----------
    path : LightPath
        What to keep; of its truth, vertices and times.
    file : path
        HDF5 file; an existing one is replaced only at the end.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    arrays, attributes = _record_from_path(path)
    attributes["provenance"] = attributes["provenance"] or provenance_record()
    for number, other in enumerate(path.alternatives):
        own_arrays, own_attributes = _record_from_path(other.path)
        arrays |= {f"{_prefix(number)}{name}": array for name, array in own_arrays.items()}
        told = {"says": other.says, "log_evidence": other.log_evidence, "path": own_attributes}
        attributes.setdefault("alternatives", []).append(told)
    schema = _schema_of_path(path)
    save_record(file, kind=PATH_KIND, arrays=arrays, attributes=attributes, schema=schema)


def _prefix(number: int) -> str:
    """What the arrays of an alternative begin with."""
    return f"alternative_{number}_"


def _schema_of_path(path: LightPath) -> int:
    """The least schema whose readers show all of a path."""
    # A version that knows no unseen legs would draw them as light that was seen; one that knows no
    # forks, an arm from the wrong vertex; one that knows no bent legs, straight ones; one without
    # alternatives would not say that there is another answer; and one without glass would take a
    # medium that has none for what was told.
    if path.alternatives or path.medium.blocks:
        return _SCHEMA_OF_OTHERS_AND_BLOCKS
    forks = path.forks or (() if path.truth is None else forks_of(path.truth))
    if forks or path.bends:
        return _SCHEMA_OF_FORKS_AND_BENDS
    return _SCHEMA_OF_UNSEEN if path.unseen_legs else SCHEMA_VERSION


def _record_from_path(path: LightPath) -> tuple[dict[str, NDArray[np.generic]], dict[str, Any]]:
    """Arrays and attributes of one path as its file holds them, without its alternatives."""
    arrays: dict[str, NDArray[np.generic]] = {
        "vertices_mm": path.vertices_mm,
        "vertex_times_ps": path.vertex_times_ps,
        "covariance": path.covariance,
    }
    arrays |= {f"covariance_{name}": part for name, part in path.covariance_parts.items()}
    arrays |= {f"camera_{name}": array for name, array in path.camera.to_arrays().items()}
    arrays |= {f"residuals_{name}": path.residuals[name] for name in RESIDUAL_DTYPE.names or ()}
    if path.truth is not None:
        arrays["truth_vertices_mm"] = np.asarray(path.truth.vertices_mm, dtype=float)
        arrays["truth_vertex_times_ps"] = np.asarray(path.truth.vertex_times_ps, dtype=float)
    true_forks = () if path.truth is None else forks_of(path.truth)
    attributes: dict[str, Any] = {
        "method": path.method,
        "prior": path.prior,
        "statements": list(path.statements),
        "goodness": asdict(path.goodness),
        "source": asdict(path.source),
        "medium": {name: getattr(path.medium, name) for name in _INDICES},
        "provenance": dict(path.provenance),
        "verdict": path.verdict.to_json(),
    }
    # Apart, and only where they say something: versions that do not know them pass them over.
    attributes["goodness"].pop("chi2_with_floor")
    if path.goodness.chi2_with_floor is not None:
        attributes["goodness_with_floor"] = {"chi2_with_floor": path.goodness.chi2_with_floor}
    if path.explained is not None:
        attributes["explained"] = asdict(path.explained)
    uniform = replace(path.medium, blocks=())
    if uniform != Medium(uniform.path_group_index, uniform.return_group_index):
        own = (*_INDICES, "blocks")
        attributes["medium_errors"] = {k: v for k, v in asdict(uniform).items() if k not in own}
    if path.medium.blocks:
        attributes["blocks"] = [asdict(block) for block in path.medium.blocks]
    if path.group_index_std:
        attributes["group_index_std"] = path.group_index_std
    if path.prices:
        attributes["prices"] = list(path.prices)
    if path.second_pulse is not None:
        # The statements say it as well, to versions that pass this over.
        attributes["second_pulse"] = asdict(path.second_pulse)
    if path.unseen_legs:
        attributes["unseen_legs"] = list(path.unseen_legs)
    for name, forks in (("forks", path.forks), ("truth_forks", true_forks)):
        if forks:
            attributes[name] = [list(fork) for fork in forks]
    if path.bends:
        arrays |= arrays_of_bends(path.bends)
        arrays["bends_covariance"] = np.asarray(path.bend_covariance)
    return arrays, attributes


class TruePath:
    """Truth as a path file carries it: where the pulse really was.

    Attributes
    ----------
    vertices_mm : array of float, shape (m, 3)
        World, mm.
    vertex_times_ps : array of float, shape (m,)
        Event times, ps.
    forks : tuple of (int, int)
        Legs that begin at another vertex than the end of the leg before, each (leg, vertex).
    """

    def __init__(
        self, vertices_mm: ArrayLike, vertex_times_ps: ArrayLike, forks: Forks = ()
    ) -> None:
        self.vertices_mm = np.asarray(vertices_mm, dtype=float)
        self.vertex_times_ps = np.asarray(vertex_times_ps, dtype=float)
        self.forks = forks

    def check(self) -> None:
        """Raise ValueError where no pulse was: it would be drawn."""
        times, vertices = self.vertex_times_ps, self.vertices_mm
        m = len(times) if times.ndim == 1 else 0
        if m > _MOST_TRUE_VERTICES:
            raise LimitError(f"its truth has {m} vertices, more than {_MOST_TRUE_VERTICES}")
        far = np.isfinite(vertices) & (np.abs(vertices) > _FARTHEST)
        if far.any() or (np.isfinite(times) & (np.abs(times) > _FARTHEST)).any():
            raise LimitError(f"its truth reaches beyond {_FARTHEST:g}")
        fits = 2 <= m <= _MOST_TRUE_VERTICES and vertices.shape == (m, 3)
        # NaN is no bound of anything.
        self.forks = checked_forks(self.forks, max(m - 1, 0))
        starts = leg_starts(max(m - 1, 0), self.forks)
        fits = fits and bool((np.abs(vertices) <= _FARTHEST).all())
        fits = fits and bool((times[1:] >= times[starts]).all())
        if not (fits and (np.abs(times) <= _FARTHEST).all()):
            raise ValueError(f"its truth {vertices.shape} is no path")


def load_path(
    file: str | os.PathLike[str], *, make: Callable[..., LightPath], try_newer: bool = False
) -> LightPath:
    """Read a path written by `save_path`.

    Parameters
    ----------
    file : path
        HDF5 file.
    make : callable
        Makes the path of its fields, by keyword (the class; it stands above this module).
    try_newer : bool
        Of a file by a newer version, read what this one knows; a statement says so.

    Returns
    -------
    LightPath
        Its truth is a `TruePath`.

    Raises
    ------
    FileFormatError
        For any other file.
    """
    try:
        arrays, attributes = load_record(file, kind=PATH_KIND)
    except FileFormatError as refused:
        if not try_newer:
            raise
        arrays, attributes = load_record(file, kind=PATH_KIND, try_newer=True)
        statements = attributes.get("statements", [])
        reason = str(refused).removeprefix(f"{os.fspath(file)}: ")
        attributes["statements"] = [f"This file {reason}; what is new in it is not shown."]
        attributes["statements"] += statements if isinstance(statements, list) else []
    with damage_as_format_error(file):
        try:
            return make(
                **_fields_from_record(arrays, attributes),
                alternatives=_alternatives_from_record(arrays, attributes, make),
            )
        except KeyError as missing:
            raise FileFormatError(f"lacks {missing}: the file is damaged", path=file) from missing


def _fields_from_record(
    arrays: Mapping[str, NDArray[np.generic]], attributes: Mapping[str, Any]
) -> dict[str, Any]:
    """Fields of a `LightPath` from the arrays and attributes of its file."""
    table = _residuals_from_record(arrays)
    camera = {k.removeprefix("camera_"): v for k, v in arrays.items() if k.startswith("camera_")}
    sides = np.asarray(camera["shape"], dtype=float)
    if (sides > _MOST_PIXELS).any() or np.prod(sides) > _MOST_PIXELS:
        raise LimitError(f"its camera cannot have {camera['shape']!r:.60} pixels")
    parts = {
        k.removeprefix("covariance_"): v for k, v in arrays.items() if k.startswith("covariance_")
    }
    truth = None
    if "truth_vertices_mm" in arrays:
        truth = TruePath(
            arrays["truth_vertices_mm"],
            arrays["truth_vertex_times_ps"],
            _forks_from_record(attributes, "truth_forks"),
        )
        truth.check()
    source = dict(attributes["source"])
    # JSON knows no tuples.
    if isinstance(source.get("position_std_mm"), list):
        source["position_std_mm"] = tuple(source["position_std_mm"])
    _check_plain(attributes)
    return {
        "vertices_mm": arrays["vertices_mm"],
        "vertex_times_ps": arrays["vertex_times_ps"],
        "covariance": arrays["covariance"],
        "camera": Camera.from_arrays(camera),
        "source": Source(**source),
        "medium": Medium(
            **attributes["medium"],
            **attributes.get("medium_errors", {}),
            blocks=_blocks_from_record(attributes),
        ),
        "method": attributes["method"],
        "goodness": Goodness(**attributes["goodness"], **attributes.get("goodness_with_floor", {})),
        "covariance_parts": parts,
        "residuals": table,
        "prior": attributes["prior"],
        "statements": tuple(attributes["statements"]),
        "prices": tuple(attributes.get("prices", ())),
        "truth": truth,
        "provenance": attributes["provenance"],
        "verdict": _verdict_from_record(attributes),
        "explained": _explained_from_record(attributes),
        "unseen_legs": tuple(attributes.get("unseen_legs", ())),
        "forks": _forks_from_record(attributes, "forks"),
        "group_index_std": attributes.get("group_index_std", 0.0),
        "bends": bends_from_arrays(arrays),
        "bend_covariance": arrays.get("bends_covariance"),
        "second_pulse": SecondPulse.from_json(attributes.get("second_pulse")),
    }


def _alternatives_from_record(
    arrays: Mapping[str, NDArray[np.generic]],
    attributes: Mapping[str, Any],
    make: Callable[..., LightPath],
) -> tuple[Alternative, ...]:
    """Other paths that a file holds beside its own, each made as that one is."""
    told = attributes.get("alternatives", [])
    if not isinstance(told, list) or not all(isinstance(one, dict) for one in told):
        raise ValueError(f"alternatives cannot be {told!r:.60}")
    if len(told) > MOST_ALTERNATIVES:
        raise LimitError(f"it holds {len(told)} alternatives, more than {MOST_ALTERNATIVES}")
    found = []
    for number, one in enumerate(told):
        prefix = _prefix(number)
        own = {k.removeprefix(prefix): v for k, v in arrays.items() if k.startswith(prefix)}
        says, log_evidence = one["says"], one["log_evidence"]
        if not isinstance(says, str) or type(log_evidence) not in (int, float):
            raise ValueError(f"an alternative cannot say {says!r:.60} with {log_evidence!r:.60}")
        other = make(**_fields_from_record(own, one["path"]))
        found.append(Alternative(other, float(log_evidence), says))
    return tuple(found)


def _blocks_from_record(attributes: Mapping[str, Any]) -> tuple[Block, ...]:
    """Blocks of glass as a file holds them; () where it holds none."""
    told = attributes.get("blocks", [])
    if not isinstance(told, list) or not all(isinstance(one, dict) for one in told):
        raise ValueError(f"blocks cannot be {told!r:.60}")
    if len(told) > _MOST_BLOCKS:
        raise LimitError(f"it holds {len(told)} blocks, more than {_MOST_BLOCKS}")
    return tuple(
        Block(**{**one, **{name: Material(**one[name]) for name in ("glass", "around")}})
        for one in told
    )


def _forks_from_record(attributes: Mapping[str, Any], name: str) -> Forks:
    """Forks as a file holds them, lists of two numbers; the path itself checks which."""
    told = attributes.get(name, [])
    pairs = isinstance(told, list) and all(
        isinstance(pair, list) and len(pair) == 2 and all(type(k) is int for k in pair)
        for pair in told
    )
    if not pairs:
        raise ValueError(f"{name} cannot be {told!r:.60}")
    if len(told) > _MOST_TRUE_VERTICES:
        raise LimitError(f"it holds {len(told)} {name}, more than {_MOST_TRUE_VERTICES}")
    return tuple((leg, vertex) for leg, vertex in told)


def _residuals_from_record(arrays: Mapping[str, NDArray[np.generic]]) -> NDArray[np.void]:
    """Pulses and how far each lies off the path, from the columns of a file."""
    n = len(arrays["residuals_row"])
    if n > _MOST_PULSES:
        raise LimitError(f"it holds {n} pulses, more than {_MOST_PULSES}")
    table = np.zeros(n, RESIDUAL_DTYPE)
    for name in RESIDUAL_DTYPE.names or ():
        table[name] = arrays[f"residuals_{name}"]
        # NaN is what is not known; the rest is drawn.
        if table[name].dtype.kind == "f" and (np.abs(table[name]) > _FARTHEST).any():
            raise LimitError(f"residuals_{name} must be below {_FARTHEST:g}")
    return table


def _check_plain(attributes: Mapping[str, Any]) -> None:
    """Raise ValueError where a number, a text or a list is something else, or of any length."""
    goodness = {**attributes["goodness"], **attributes.get("goodness_with_floor", {})}
    for name, value in goodness.items():
        kinds = _KINDS.get(name, (int, float))
        is_none = value is None and name == "chi2_with_floor"
        fits = type(value) in kinds and not (type(value) is int and abs(value) > _MOST)
        if not (is_none or fits):
            raise ValueError(f"goodness.{name} cannot be {value!r:.60}")
    for name in ("method", "prior"):
        if not isinstance(attributes[name], str):
            raise ValueError(f"{name} cannot be {attributes[name]!r:.60}")
    for name in ("statements", "prices"):
        told = attributes.get(name, [])
        if not isinstance(told, list) or not all(isinstance(one, str) for one in told):
            raise ValueError(f"{name} cannot be {told!r:.60}")
        if len(told) > _MOST_SENTENCES:
            raise LimitError(f"it holds {len(told)} {name}, more than {_MOST_SENTENCES}")
    unseen = attributes.get("unseen_legs", [])
    if not isinstance(unseen, list) or not all(type(k) is int for k in unseen):
        raise ValueError(f"unseen_legs cannot be {unseen!r:.60}")
    if not isinstance(attributes["provenance"], Mapping):
        raise ValueError(f"provenance cannot be {attributes['provenance']!r:.60}")
    # Pictures and pages set each in type: minutes for megabytes.
    pending: list[Any] = [{k: v for k, v in attributes.items() if k != "provenance"}]
    while pending:
        one = pending.pop()
        if isinstance(one, str) and len(one) > _LONGEST_TEXT:
            raise LimitError(f"it holds a text of {len(one)} characters, more than {_LONGEST_TEXT}")
        if isinstance(one, dict | list):
            pending += one.values() if isinstance(one, dict) else one


def _verdict_from_record(attributes: Mapping[str, Any]) -> Verdict:
    """The verdict that a file carries; older ones carry none."""
    plain = attributes.get("verdict")
    return NOT_EXAMINED if plain is None else Verdict.from_json(plain)


def _explained_from_record(attributes: Mapping[str, Any]) -> Explained | None:
    """What a file says that its path explains; older ones do not."""
    plain = attributes.get("explained")
    if plain is None:
        return None
    return Explained(
        n_pulses=int(plain["n_pulses"]),
        n_found=int(plain["n_found"]),
        photons=float(plain["photons"]),
        photons_found=float(plain["photons_found"]),
    )
