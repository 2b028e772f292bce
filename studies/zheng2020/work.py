"""Long experiments in pieces: each finished piece is kept in a file and never done twice.

A `Unit` is one function call with plain settings. Its result (numbers, lists, paths) is written
whole or not at all under the output folder; a run that was stopped goes on where it was.
"""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from threading import Event
from typing import Any

from lightflight._version import __version__
from lightflight.files.children import safe_children
from lightflight.files.whole_file import atomic_path
from lightflight.path.light_path import LightPath

Progress = Callable[[str, int, int], None]
"""Called with (name of the unit that is done, units done, units in all)."""

_CHECKOUT = Path(__file__).resolve().parents[2]
"""Where `studies` is imported from: it is not installed."""

_PATHS = "paths"
"""Key of a result that holds LightPaths by name; they are kept as files of their own."""


@dataclass(frozen=True)
class Unit:
    """One piece of an experiment."""

    name: str
    """What it is called on disk: letters, digits, dots, signs."""
    maker: Callable[..., Mapping[str, Any]]
    """What does it, a function of a module (so that other processes find it): takes `settings`
    and `seed`, gives plain values and, under "paths", LightPaths by name."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Plain values."""


def results_of_units(
    units: Sequence[Unit],
    folder: str | os.PathLike[str],
    *,
    seed: int,
    workers: int = 1,
    fresh: bool = False,
    progress: Progress | None = None,
) -> dict[str, dict[str, Any]]:
    """Results by unit name; what the folder holds already is not done again.

    Parameters
    ----------
    folder : where finished units are kept; made if needed.
    seed : of all units. Results of another seed, version or settings are not used.
    workers : processes; 1 works in this one.
    fresh : do everything again.
    progress : called after each unit, also after those that were there already.
    """
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    found: dict[str, dict[str, Any]] = {}
    missing = []
    for unit in units:
        kept = None if fresh else _kept(unit, place, seed)
        if kept is None:
            missing.append(unit)
        else:
            found[unit.name] = kept
            if progress is not None:
                progress(unit.name, len(found), len(units))
    for unit in _done(missing, place, seed, workers):
        result = _kept(unit, place, seed)
        assert result is not None
        found[unit.name] = result
        if progress is not None:
            progress(unit.name, len(found), len(units))
    return found


def _done(units: list[Unit], place: Path, seed: int, workers: int) -> Iterator[Unit]:
    """Each unit when it is finished and kept."""
    if workers <= 1 or len(units) <= 1:
        for unit in units:
            _do(unit, place, seed)
            yield unit
        return
    # The pool starts a process that watches over it; workers are started while units are handed in.
    with safe_children(_CHECKOUT):
        # spawn: a fork of a process that has used Numba's threads may hang
        pool = ProcessPoolExecutor(
            min(workers, len(units)), mp_context=get_context("spawn"), initializer=_one_thread
        )
        running = {pool.submit(_do_unless_stopped, unit, place, seed): unit for unit in units}
    try:
        for done in as_completed(running):
            done.result()
            yield running[done]
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _one_thread() -> None:
    """One thread per process: there are as many processes as there is room for."""
    import lightflight._kernels  # noqa: F401  (takes care of where Numba looks for settings)

    import numba  # isort: skip

    numba.set_num_threads(1)


_stopped = Event()
"""Set in a worker process that heard Ctrl-C: the pool catches that and hands out the next unit."""


def _do_unless_stopped(unit: Unit, place: Path, seed: int) -> None:
    """`_do` in a worker process, whose first Ctrl-C is its last unit."""
    if _stopped.is_set():
        raise KeyboardInterrupt
    try:
        _do(unit, place, seed)
    except KeyboardInterrupt:
        _stopped.set()
        raise


def _do(unit: Unit, place: Path, seed: int) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # half of these experiments leave things out on purpose
        result = dict(unit.maker(**unit.settings, seed=seed))
    paths: Mapping[str, LightPath] = result.pop(_PATHS, {})
    for name, path in paths.items():
        path.save(place / f"{unit.name}-{name}.h5")
    record = {**_label(unit, seed), "result": result, _PATHS: sorted(paths)}
    with atomic_path(place / f"{unit.name}.json") as fresh:
        fresh.write_text(json.dumps(record), encoding="utf-8")


def _label(unit: Unit, seed: int) -> dict[str, Any]:
    """What a kept result must agree with to be used again."""
    return {
        "unit": unit.name,
        "maker": f"{unit.maker.__module__.rpartition('.')[2]}:{unit.maker.__qualname__}",
        "settings": dict(unit.settings),
        "seed": seed,
        "lightflight": __version__,
    }


def _kept(unit: Unit, place: Path, seed: int) -> dict[str, Any] | None:
    """Result of a unit from its file; None where there is none that fits."""
    try:
        record = json.loads((place / f"{unit.name}.json").read_text(encoding="utf-8"))
        wanted = json.loads(json.dumps(_label(unit, seed)))
        if any(record.get(key) != value for key, value in wanted.items()):
            return None
        paths = {name: LightPath.load(place / f"{unit.name}-{name}.h5") for name in record[_PATHS]}
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return {**record["result"], _PATHS: paths}
