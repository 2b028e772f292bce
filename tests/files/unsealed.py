"""Files of ours without their digest, as earlier versions wrote them: what stands behind it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import h5py

from lightflight.files.digest import DIGEST, SEALED


@contextmanager
def unsealed(path: str | os.PathLike[str]) -> Iterator[h5py.File]:
    """A file of ours, open to be changed, without its digest."""
    with h5py.File(path, "r+") as file:
        for mark in (DIGEST, SEALED):
            if mark in file.attrs:
                del file.attrs[mark]
        yield file
