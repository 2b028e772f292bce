"""A stored HDF5 chunk shorter than its checksum crashed the library, and the process with it."""

import numpy as np
import pytest

from lightflight.errors import FileFormatError
from lightflight.files.store import load_record, save_record
from tests.files.unsealed import unsealed


@pytest.mark.parametrize("n_left", [1, 3])
def test_a_chunk_shorter_than_its_checksum_is_refused(tmp_path, n_left):
    """HDF5 1.14 takes such a chunk for one of 4 GB, and the process ends."""
    path = tmp_path / "x.h5"
    save_record(path, kind="path", arrays={"values": np.zeros(5000)}, attributes={})
    with unsealed(path) as file:
        file["values"].id.write_direct_chunk((0,), bytes(n_left))
    with pytest.raises(FileFormatError, match=r"a chunk of array '/values' .* is cut short"):
        load_record(path, kind="path")
