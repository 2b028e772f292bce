"""Numbers of headers set to what hurts, of MATLAB's and vendors' files; at length a third of all.

All of them: `python -m tests.attacks.fields`.
"""

from __future__ import annotations

import os

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import FileFormatError
from tests.attacks import fields
from tests.attacks.length import at_length
from tests.formats.made_by_hand import ptu_bytes, sdt_bytes, spc_bytes
from tests.fuzz_seeds import seeds


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.skipif(os.name == "nt", reason="killable readers are made for POSIX")
def test_no_number_of_a_header_does_harm(tmp_path):
    tally, findings = fields.run(tmp_path, each=at_length(1001, 3), keep=tmp_path / "found")
    assert findings == []
    told = {name[name.rindex(".") :] for name in tally}
    assert {".mat", ".spc"} <= told


def test_places_are_where_the_numbers_stand(tmp_path):
    """A changed field changes what is read, by the reader's own word."""
    (plain,) = (one for one in seeds(tmp_path) if one.name == "plain.mat")
    element = fields.mat_elements(plain.content)[0]
    places = fields.mat_places(element)
    now = {k: int.from_bytes(element[p.at : p.at + p.width], "little") for k, p in places.items()}
    assert [now[f"dim {k}"] for k in range(3)] == [4, 4, 32]
    assert (now["class"], now["data type"], now["data bytes"]) == (11, 4, 4 * 4 * 32 * 2)
    assert now["bytes"] == len(element) - 8
    tags = fields.ptu_tags(ptu := ptu_bytes(np.arange(9)))
    at = tags["TTResult_NumberOfRecords"] + 40
    assert int.from_bytes(ptu[at : at + 8], "little") == 9
    pytest.importorskip("sdtfile")
    sdt = sdt_bytes(np.ones((2, 64), int))
    found = fields.sdt_places(sdt)
    for name, value in (("adc_re", 64), ("blocks", 1), ("block length", 256), ("block kind", 1)):
        place = found[name]
        # The header and each block say how long a block is.
        assert int.from_bytes(sdt[place.at : place.at + place.width], "little") == value, name


@pytest.mark.parametrize("width", ["1e999", "-1e-11", "0", "e", "9" * 5000])
def test_a_set_file_of_nonsense_is_to_blame_itself(tmp_path, width):
    """The sound .spc was called damaged; a width that was told was noted as the file's."""
    path = tmp_path / "x.spc"
    path.write_bytes(spc_bytes(np.arange(9), np.zeros(9, int)))
    (tmp_path / "x.set").write_text(f"#SP [SP_TAC_TC,F,{width}]")
    with pytest.raises(FileFormatError, match=r"x\.spc: x\.set beside it gives") as caught:
        lf.read(path)
    assert len(str(caught.value)) < 300 + len(str(tmp_path))
    told = lf.read(path, bin_width_ps=12.0)
    assert (told.bin_width_ps, told.settings["notes"]) == (12.0, [])
