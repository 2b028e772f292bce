import hashlib
import json
import re

import numpy as np
import pytest

from lightflight import __version__
from lightflight.provenance import input_record, provenance_record, sha256_of_file, version_of


def test_the_record_says_what_made_a_result(tmp_path):
    source = tmp_path / "run.h5"
    source.write_bytes(b"photons")
    record = provenance_record(
        command="reconstruct", inputs=[source], settings={"source": {"x": 1.0}}, seed=7
    )
    assert record["lightflight"] == __version__
    assert record["packages"]["numpy"] == np.__version__
    assert record["seed"] == 7
    assert record["settings"] == {"source": {"x": 1.0}}
    assert record["inputs"] == [
        {"name": "run.h5", "bytes": 7, "sha256": hashlib.sha256(b"photons").hexdigest()}
    ]
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", record["made_utc"])


def test_the_record_is_plain_json_and_holds_no_folder(tmp_path):
    source = tmp_path / "run.h5"
    source.write_bytes(b"")
    text = json.dumps(provenance_record(inputs=[source]))
    assert str(tmp_path) not in text


def test_hash_of_a_file_larger_than_one_read(tmp_path):
    content = np.arange(400_000, dtype=np.uint32).tobytes()
    path = tmp_path / "big.bin"
    path.write_bytes(content)
    assert sha256_of_file(path) == hashlib.sha256(content).hexdigest()


def test_missing_package_and_missing_file(tmp_path):
    assert version_of("no-such-package-on-any-index") is None
    with pytest.raises(FileNotFoundError, match="gone"):
        input_record(tmp_path / "gone.h5")


def test_a_folder_is_known_by_all_its_files(tmp_path):
    folder = tmp_path / "x.zarr"
    (folder / "c").mkdir(parents=True)
    (folder / "zarr.json").write_text("{}")
    (folder / "c" / "0").write_bytes(b"123")
    before = input_record(folder)
    assert (before["name"], before["bytes"]) == ("x.zarr", 5)
    assert input_record(folder) == before
    (folder / "c" / "0").rename(folder / "c" / "1")
    assert input_record(folder)["sha256"] != before["sha256"]
