"""What an HDF5 file holds, entry by entry, in bounded time.

HDF5's own walk (`visititems`) takes hours over a megabyte of groups within groups.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import h5py

from lightflight.errors import FileFormatError

_DEEPEST = 64
_MOST_ENTRIES = 100_000
"""Bounds of time, not of sense: some seconds. Ours have 2 levels and 30 entries."""


def entries_of(file: h5py.File) -> Iterator[tuple[str, int, h5py.HLObject | None]]:
    """Every entry below a file's root; no link is followed.

    Parameters
    ----------
    file : h5py.File
        Open.

    Yields
    ------
    name : str
        Path in the file, without a slash in front.
    link : int
        Kind of link (`h5py.h5l`): TYPE_HARD for what lies here.
    node : h5py.Group, h5py.Dataset, h5py.Datatype or None
        None for links, and for what has been told under another name.

    Raises
    ------
    FileFormatError
        Where there are more groups within groups, or more entries, than anybody means.
    """
    return _below(file, "", {_place_of(file.id, b".")}, itertools.count(1))


def _below(
    group: h5py.Group, prefix: str, seen: set[tuple[int, ...]], number: Iterator[int]
) -> Iterator[tuple[str, int, h5py.HLObject | None]]:
    if prefix.count("/") > _DEEPEST:
        raise _too_much(f"more than {_DEEPEST} groups within groups", group)
    for name in group:
        if next(number) > _MOST_ENTRIES:
            raise _too_much(f"more than {_MOST_ENTRIES:,} groups and arrays", group)
        word = name.encode("utf-8", "surrogateescape")
        link = group.id.links.get_info(word).type
        place = _place_of(group.id, word) if link == h5py.h5l.TYPE_HARD else None
        if place is None or place in seen:
            yield prefix + name, link, None
            continue
        seen.add(place)
        node = group[name]
        yield prefix + name, link, node
        if isinstance(node, h5py.Group):
            yield from _below(node, f"{prefix}{name}/", seen, number)


def _place_of(group: h5py.h5g.GroupID, name: bytes) -> tuple[int, ...]:
    """Where an object lies in the file: one object may have several names, and hold itself."""
    return tuple(h5py.h5g.get_objinfo(group, name, follow_link=False).objno)


def _too_much(what: str, group: h5py.Group) -> FileFormatError:
    return FileFormatError(
        f"holds {what}: copy the recording into a file of its own", path=group.file.filename
    )
