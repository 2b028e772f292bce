"""Dask: workers of this machine, or of a lab's cluster (the only module that imports it)."""

from __future__ import annotations

import contextlib
import gc
import logging
import os
import signal
import stat
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from lightflight.errors import ConfigError, LightflightWarning, MissingExtraError
from lightflight.files.children import SAFE_ENVIRONMENT, environment, safe_children
from lightflight.files.litter import folder_of_process

if TYPE_CHECKING:
    from distributed import LocalCluster, Security, Worker, WorkerPlugin

_MOST_DEATHS = 2
"""Workers a task may take with it before it is given up."""

_SOCKETS_FIT = 85
"""Letters: a socket's path has 107 in Linux, of which its name takes 18."""

_CONNECT_S = 15
_ANSWER_S = 5
_ENVIRONMENT = {
    "NUMBA_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    **SAFE_ENVIRONMENT,
}
"""One thread per worker: the work is shared out by recordings."""

_MARK = "LIGHTFLIGHT_IMPORTED"
Certificates = tuple[str | os.PathLike[str], str | os.PathLike[str], str | os.PathLike[str]]
"""PEM files: of the authority, our own, and its key."""

_ROLES = ("client", "scheduler", "worker")
"""Who shows a certificate."""

_PRELOADED = (
    "distributed.nanny",
    "lightflight.batch.pieces",
    "lightflight.batch.tiles",
    "lightflight.formats.lightflight_hdf5",
    "lightflight.reconstruct.chain",
    "lightflight.reconstruct.from_arrivals",
    "lightflight.timing.pulses.arrivals",
)
"""What every worker needs: seconds to import, so it is done once for all of them."""


class Future(Protocol):
    """What is used of a `distributed.Future`."""

    status: str

    def result(self) -> object:
        """What the task gave; raises what it raised."""

    def exception(self) -> BaseException | None:
        """What the task raised."""

    def add_done_callback(self, function: Callable[[Future], None], /) -> None:
        """Have it called with this future when the task ends."""


class Client(Protocol):
    """What is used of a `distributed.Client`."""

    @property
    def scheduler(self) -> Scheduler:
        """Whom it asks."""

    def submit(
        self, function: Callable[..., object], *arguments: object, key: str, pure: bool
    ) -> Future:
        """Hand a call to a worker."""

    def sync(self, function: Callable[[], object], *, callback_timeout: float) -> object:
        """Call and wait so many seconds for the answer."""

    def register_plugin(self, plugin: WorkerPlugin, name: str) -> object:
        """Have every worker set it up."""


class Scheduler(Protocol):
    """What is used of the way to a scheduler."""

    def identity(self) -> object:
        """Who it says it is."""


def cores() -> int:
    """Cores this process may use.

    Returns
    -------
    int
        Fewer than the machine has where a queue or a container grants fewer.
    """
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextlib.contextmanager
def workers(
    *,
    scheduler: str | None = None,
    certificates: Certificates | None = None,
    n_workers: int | None = None,
    scratch: Path,
    loud: bool = False,
) -> Iterator[Client]:
    """Client of a cluster: a new one on this machine, or the one at `scheduler`.

    Parameters
    ----------
    scheduler : str, optional
        "tls://host:port"; its workers need lightflight and the same folders.
    certificates : (path, path, path), optional
        Of the scheduler's authority, our own, and its key (PEM); None: as Dask is configured.
    n_workers : int, optional
        Workers on this machine; None: one per core.
    scratch : Path
        Folder for Dask's own temporary files on this machine.
    loud : bool, optional
        Let Dask say what it does.

    Yields
    ------
    distributed.Client
        For `submit`.

    Raises
    ------
    ConfigError
        Where nobody answers at `scheduler`, certificates do not fit, or no worker can be started
        here.
    MissingExtraError
        Without dask, or without cryptography for workers of this machine.
    """
    _leave_if_imported_by_a_worker()
    # A worker that imports an unguarded script leaves word there, for `_why_not`.
    mark = {_MARK: os.fspath(scratch / "imported")}
    with safe_children(), environment(mark):
        try:
            import dask

            start_method = _start_method() if scheduler is None else "spawn"
            import distributed  # noqa: F401  (while the forkserver starts)
        except ImportError as error:
            raise MissingExtraError(
                'campaigns need dask, which is not installed: pip install "lightflight[batch]"'
            ) from error
        level = logging.INFO if loud else logging.CRITICAL + 1
        _set_log_level(level)
        security = _own_security(scratch) if scheduler is None else _told_security(certificates)
        with contextlib.ExitStack() as stack:
            options = _dask_options(level, start_method, scratch)
            stack.enter_context(dask.config.set(options))
            address = scheduler or stack.enter_context(
                _local_cluster(n_workers or cores(), scratch, security, log_level=level)
            )
            yield stack.enter_context(_client(address, security))


@contextlib.contextmanager
def _client(address: str | LocalCluster, security: Security | None) -> Iterator[Client]:
    """A client of one scheduler; raises ConfigError where none answers."""
    with _connected(address, security) as client:
        client.register_plugin(_deaf_to_interrupts(), name="lightflight-interrupts")
        yield client


def _connected(
    address: str | LocalCluster, security: Security | None
) -> contextlib.AbstractContextManager[Client]:
    import distributed

    connect: Callable[..., contextlib.AbstractContextManager[Client]] = distributed.Client
    told = {} if security is None else {"security": security}
    try:
        # The caller's program may have a client of its own: that stays its default.
        return connect(address, timeout=_CONNECT_S, set_as_default=False, **told)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        why = str(error)
    # A client that failed stops its loop when it is collected. Were that left to chance, it could
    # come while the next one starts, whose lock it would wait for: for ever.
    gc.collect()
    raise ConfigError(
        f"--scheduler {address}: no Dask scheduler answers there, or it wants another "
        f"certificate: see --tls ({why})"
    )


def _own_security(scratch: Path) -> Security:
    """Certificates of this run alone: else any user of this machine could hand pickles to it.

    They lie in its folder, which the next run sweeps. Kept in memory, Dask would write them and
    their key to a folder of its own each time it connects, where a kill leaves them.
    """
    import distributed

    temporary: Callable[[], Security] = distributed.Security.temporary
    try:
        made = temporary()
    except ImportError as error:
        raise MissingExtraError(
            "workers of this machine are reached by TLS, which needs cryptography: "
            'pip install "lightflight[batch]"'
        ) from error
    # One pair serves all roles.
    told_by: Callable[[str], dict[str, str]] = made.get_tls_config_for_role
    told = told_by("client")
    certificate = _kept(told["cert"], scratch / "certificate.pem")
    key = _kept(told["key"], scratch / "key.pem")
    pair = {f"tls_{role}_cert": certificate for role in _ROLES}
    pair |= {f"tls_{role}_key": key for role in _ROLES}
    security: Callable[..., Security] = distributed.Security
    return security(tls_ca_file=certificate, **pair, require_encryption=True)


def _kept(text: str, file: Path) -> str:
    """The name of a file that only its owner may read."""
    file.touch(mode=0o600)
    file.write_text(text, encoding="ascii")
    return os.fspath(file)


def _told_security(certificates: Certificates | None) -> Security | None:
    """Certificates for a scheduler of the lab's; None where Dask's own settings tell."""
    if certificates is None:
        return None
    import distributed

    for file in certificates:
        if not Path(file).is_file():
            raise ConfigError(f"--tls: {file}: there is no such file")
    authority, certificate, key = certificates
    if os.name != "nt" and Path(key).stat().st_mode & stat.S_IROTH:
        warnings.warn(
            f"--tls: {key}: every user of this machine can read this key, and run code on the "
            f"workers with it: chmod 600 {key}",
            LightflightWarning,
            stacklevel=2,
        )
    security: Callable[..., Security] = distributed.Security
    return security(
        tls_ca_file=os.fspath(authority),
        tls_client_cert=os.fspath(certificate),
        tls_client_key=os.fspath(key),
        require_encryption=True,
    )


def _set_log_level(level: int) -> None:
    """Set the level of every logger of Dask's, those that exist already too."""
    for name in [*logging.root.manager.loggerDict, "distributed"]:
        if name.partition(".")[0] == "distributed":
            logging.getLogger(name).setLevel(level)


def _dask_options(log_level: int, start_method: str, scratch: Path) -> dict[str, object]:
    """Options of Dask, by name."""
    return {
        # The scheduler would leave a folder of its own in that of the machine.
        "temporary-directory": str(scratch),
        # Dask's own watching of itself would take a few per cent of every worker's time.
        "distributed.worker.profile.enabled": False,
        "distributed.admin.tick.interval": "1s",
        "distributed.admin.system-monitor.interval": "5s",
        "distributed.admin.system-monitor.gil.enabled": False,
        "distributed.scheduler.allowed-failures": _MOST_DEATHS,
        # Their ports are opened all the same: without routes they answer nobody.
        "distributed.scheduler.http.routes": [],
        "distributed.worker.http.routes": [],
        "distributed.worker.daemon": True,
        "distributed.worker.multiprocessing-method": start_method,
        "distributed.comm.timeouts.connect": f"{_CONNECT_S}s",
        "distributed.nanny.pre-spawn-environ": _ENVIRONMENT,
        "distributed.logging.distributed": logging.getLevelName(min(log_level, logging.CRITICAL)),
    }


def _local_cluster(
    n_workers: int, scratch: Path, security: Security | None, *, log_level: int
) -> contextlib.AbstractContextManager[LocalCluster]:
    """Workers on this machine; raises ConfigError where none can be started."""
    import distributed

    dask_utils: Any = distributed.utils
    dask_utils._forkserver_preload_set = True  # else Dask imports all it knows, pandas too
    start: Callable[..., LocalCluster] = distributed.LocalCluster
    # Nobody but this machine is listened to, and of it nobody without our certificate.
    try:
        return start(
            n_workers=n_workers,
            threads_per_worker=1,
            host="127.0.0.1",
            protocol="tls://",
            security=security,
            dashboard_address=None,
            # Without a dashboard a port is opened all the same: any, not the one that a colleague's
            # cluster on this machine holds.
            scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
            local_directory=str(scratch),
            silence_logs=log_level if log_level > logging.CRITICAL else False,
        )
    except RuntimeError as error:
        raise ConfigError(f"no worker could be started: {_why_not(error, scratch)}") from None


def _start_method() -> str:
    """How workers of this machine are started.

    On Linux they branch off a process that has imported what they all need. It starts here, with
    their environment, while this process is still loading Dask.
    """
    if sys.platform != "linux":
        return "spawn"
    import multiprocessing
    import multiprocessing.forkserver

    multiprocessing.get_context("forkserver").set_forkserver_preload(list(_PRELOADED))
    if len(os.fspath(folder := folder_of_process())) < _SOCKETS_FIT:
        # Where its socket lies; a folder of multiprocessing's own would stay after kill -9.
        configuration: Any = multiprocessing.process.current_process()
        configuration._config.setdefault("tempdir", os.fspath(folder))
    with environment(_ENVIRONMENT):
        multiprocessing.forkserver.ensure_running()
    return "forkserver"


def _leave_if_imported_by_a_worker() -> None:
    """End a worker that runs a campaign of its own, by importing a script without a guard.

    Without a word: the process that started it says what is wrong.
    """
    import multiprocessing

    if getattr(multiprocessing.current_process(), "_inheriting", False):
        with contextlib.suppress(OSError, KeyError):
            Path(os.environ[_MARK]).touch()
        raise SystemExit(1)


def _why_not(error: Exception, scratch: Path) -> str:
    """Why Dask could not start a worker, as far as can be told."""
    main = sys.modules["__main__"]
    script = getattr(main, "__file__", None)
    if (scratch / "imported").exists():
        return (
            f'workers import {script}, so what it does must stand under if __name__ == "__main__":'
        )
    is_script = script is not None and getattr(main, "__spec__", None) is None
    where = f", or what {script} does on being imported fails" if is_script else ""
    return (
        "it was ended while it started: for want of memory, by somebody, or by a limit of this "
        f"machine{where} (Dask says: {error})"
    )


def _deaf_to_interrupts() -> WorkerPlugin:
    """Plug-in that lets the main process alone answer Ctrl-C, which a terminal sends to all."""
    from distributed import WorkerPlugin

    class Deaf(WorkerPlugin):
        def setup(self, worker: Worker) -> None:
            with contextlib.suppress(ValueError):  # not in the main thread: nothing arrives there
                signal.signal(signal.SIGINT, signal.SIG_IGN)

    return Deaf()


def submit(
    client: Client, function: Callable[..., object], *arguments: object, name: str
) -> Future:
    """Hand a call to a worker.

    Parameters
    ----------
    client : distributed.Client
        From `workers`.
    function : callable
        What to call; it must be importable by name.
    *arguments
        Its arguments; they may be futures, alone or in lists.
    name : str
        Name of the task; a scheduler answers a name it knows from memory.

    Returns
    -------
    distributed.Future
        The answer to come.
    """
    return client.submit(function, *arguments, key=name, pure=False)


def is_lost(future: Future) -> bool:
    """Whether the connection to the scheduler went, and the answer with it.

    Parameters
    ----------
    future : distributed.Future
        From `submit`.

    Returns
    -------
    bool
        False for a task that raised: that is an answer.
    """
    return future.status in ("cancelled", "lost")


def answers(client: Client) -> bool:
    """Whether the scheduler is there.

    Parameters
    ----------
    client : distributed.Client
        From `workers`.

    Returns
    -------
    bool
        False after some seconds of silence.
    """
    try:
        client.sync(client.scheduler.identity, callback_timeout=_ANSWER_S)
    except Exception:  # noqa: BLE001  (whatever Dask raises over a broken connection)
        return False
    return True


def reason_of(error: BaseException | None) -> str | None:
    """In words, why Dask gave up a task.

    Parameters
    ----------
    error : BaseException or None
        What its future holds.

    Returns
    -------
    str or None
        None where the task itself raised: its own words are better.
    """
    from distributed import KilledWorker

    if isinstance(error, KilledWorker):
        return (
            f"its worker died {_MOST_DEATHS + 1} times over it, perhaps for want of memory: use "
            "fewer --workers, smaller pieces and tiles, or fewer codes"
        )
    return None
