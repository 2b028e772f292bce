"""Workers and schedulers: nobody without a certificate hands them anything."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
import warnings
from pathlib import Path

import pytest

import lightflight as lf
from lightflight.batch import cluster
from lightflight.batch.campaign import campaign_from_toml
from lightflight.batch.runner import run_campaign
from lightflight.batch.table import write_table_csv
from lightflight.errors import ConfigError, LightflightWarning, MissingExtraError
from tests.batch.conftest import CAMPAIGN, LAB, recording_at

distributed = pytest.importorskip("distributed")
pytest.importorskip("cryptography")


def certificates(folder: Path) -> tuple[Path, Path, Path]:
    """As the how-to makes them: one key, its own authority."""
    security = distributed.Security.temporary()
    names = ("ca.pem", "cert.pem", "key.pem")
    values = (security.tls_ca_file, security.tls_client_cert, security.tls_client_key)
    for name, text in zip(names, values, strict=True):
        (folder / name).write_text(text)
        (folder / name).chmod(0o600)
    return folder / names[0], folder / names[1], folder / names[2]


@pytest.mark.slow
def test_a_local_cluster_answers_only_who_has_its_certificate(tmp_path):
    with cluster.workers(n_workers=1, scratch=tmp_path) as client:
        assert isinstance(client, distributed.Client)
        address = client.scheduler.address
        assert address.startswith("tls://127.0.0.1:")
        for port in client.scheduler_info()["services"].values():
            assert port != 8787  # Dask's own: a colleague's cluster may hold it
            for page in ("", "info/main/workers.html", "metrics", "json/identity.json"):
                with pytest.raises(urllib.error.HTTPError, match="404"):
                    urllib.request.urlopen(f"http://127.0.0.1:{port}/{page}", timeout=5)
        for stranger in (address, address.replace("tls", "tcp")):
            with pytest.raises((OSError, TypeError, RuntimeError, ValueError)):
                distributed.Client(stranger, timeout=2, set_as_default=False)
        assert cluster.submit(client, os.getpid, name="x").result() != os.getpid()


def test_without_cryptography_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cryptography", None)
    with (
        pytest.raises(MissingExtraError, match=r"needs cryptography: pip install .*\[batch\]"),
        cluster.workers(n_workers=1, scratch=tmp_path),
    ):
        pytest.fail("must not get here")


@pytest.mark.skipif(os.name == "nt", reason="POSIX")
def test_a_key_that_everybody_can_read_is_told(tmp_path):
    files = certificates(tmp_path)
    files[2].chmod(0o644)
    with pytest.warns(LightflightWarning, match=r"every user of this machine can read this key"):
        cluster._told_security(files)
    files[2].chmod(0o640)  # a group's own cluster
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cluster._told_security(files)


@contextlib.contextmanager
def _started(*words: str, folder: Path):
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", *words], cwd=folder, start_new_session=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="POSIX")
def test_the_recipe_for_a_cluster_with_certificates_of_ones_own(tmp_path):
    """docs/how-to/campaigns.md: refused without its certificate, with it the same table."""
    (tmp_path / "lab.toml").write_text(LAB)
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    for angle in (-4, 4):
        (tmp_path / f"angle_{angle}").mkdir()
        lf.write(recording_at(angle, seed=16), tmp_path / f"angle_{angle}" / "run1.h5")
    ca, cert, key = certificates(tmp_path)
    tls = ["--tls-ca-file", str(ca), "--tls-cert", str(cert), "--tls-key", str(key)]
    address = f"tls://127.0.0.1:{_free_port()}"
    tables = []
    with (
        _started("distributed.cli.dask_scheduler", *tls, "--host", address, "--no-dashboard",
                 folder=tmp_path),
        _started("distributed.cli.dask_worker", address, *tls, "--nthreads", "1", "--no-dashboard",
                 folder=tmp_path),
    ):  # fmt: skip
        end = time.monotonic() + 60
        campaign = campaign_from_toml(tmp_path / "campaign.toml")
        while True:
            try:
                table = run_campaign(campaign, scheduler=address, certificates=(ca, cert, key))
                break
            except ConfigError:
                assert time.monotonic() < end, "the scheduler never answered"
        write_table_csv(table, tmp_path / "a.csv")
        tables.append((tmp_path / "a.csv").read_bytes())
        shutil.rmtree(tmp_path / "results")
        (tmp_path / "strangers").mkdir()
        strangers = certificates(tmp_path / "strangers")
        for told in (None, strangers, (ca, *strangers[1:])):
            with pytest.raises(ConfigError, match="wants another certificate"):
                run_campaign(campaign, scheduler=address, certificates=told)
    write_table_csv(run_campaign(campaign, n_workers=1), tmp_path / "b.csv")
    assert tables[0] == (tmp_path / "b.csv").read_bytes()
