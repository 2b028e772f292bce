"""Dask wrote key and certificate of a run to a folder of its own; a kill then left them there."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

import pytest

from lightflight.batch import cluster

distributed = pytest.importorskip("distributed")
pytest.importorskip("cryptography")


def test_certificates_lie_in_the_folder_that_the_next_run_sweeps(tmp_path, monkeypatch):
    security = cluster._own_security(tmp_path)

    def refused(*_, **__):
        pytest.fail("a folder that nobody sweeps")

    monkeypatch.setattr(tempfile, "TemporaryDirectory", refused)
    for role in ("client", "scheduler", "worker"):
        told = security.get_tls_config_for_role(role)
        for name in ("ca_file", "cert", "key"):
            file = Path(told[name])
            assert file.parent == tmp_path
            assert os.name == "nt" or stat.S_IMODE(file.stat().st_mode) == 0o600
        assert security.get_connection_args(role)["ssl_context"]
        assert security.require_encryption
