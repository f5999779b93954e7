"""Owns where recordings are worked on: in this process, on the cores of this machine, or on a cluster."""

import importlib.util
import uuid
from collections.abc import Generator, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

from tf2_py._internal import printable
from tf2_ros._recordings.local_workers import LocalCluster, local_workers
from tf2_ros._recordings.mapping import Outcome, Request, failed, work
from tf2_ros._recordings.problems import needs

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["outcomes"]

# How often Dask repeats what raised an error that may pass: of a folder on a network, say.
RETRIES = 2


def outcomes(
    request: Request, tables: Mapping[str, str], workers: int | None, scheduler: "str | Client | None"
) -> Generator[Outcome, None, None]:
    """
    Work on recordings, and give the outcome of each when it is there.

    :param tables: the paths of the tables, by the recordings.
    :raises ModuleNotFoundError: a library is not installed, here or where the work is done.
    """
    with ExitStack() as stack:
        cluster: str | Client | LocalCluster | None = scheduler
        if cluster is None:
            count = 1 if len(tables) < 2 else min(workers or _cores(), len(tables))
            if count == 1:
                yield from _here(request, tables)
                return
            for library in ("distributed", "cryptography"):
                _check_installed(library)
            cluster = stack.enter_context(local_workers(count))
        yield from _on_cluster(request, tables, stack.enter_context(_connected(cluster)))


def _cores() -> int:
    _check_installed("dask")
    from dask.system import CPU_COUNT  # knows the limits of a container

    return int(CPU_COUNT)


def _check_installed(library: str) -> None:
    if importlib.util.find_spec(library) is None:
        raise needs(library, "fleet")


@contextmanager
def _connected(scheduler: "str | Client | LocalCluster") -> "Iterator[Client]":
    _check_installed("distributed")
    from distributed import Client

    if isinstance(scheduler, Client):
        yield scheduler
        return
    address, security = scheduler if isinstance(scheduler, LocalCluster) else (scheduler, None)
    with Client(address, security=security, set_as_default=False) as client:
        yield client


def _here(request: Request, tables: Mapping[str, str]) -> Iterator[Outcome]:
    for recording, table in tables.items():
        try:
            yield work(request, recording, table)
        except Exception as error:
            interrupt = _interrupt_behind(error)
            if interrupt is not None:
                raise interrupt from None
            yield _outcome_of(recording, error)


def _interrupt_behind(error: BaseException | None) -> KeyboardInterrupt | None:
    # NumPy, for one, makes a TypeError of a Ctrl-C that comes while it compares arrays.
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error


def _on_cluster(request: Request, tables: Mapping[str, str], client: "Client") -> Iterator[Outcome]:
    from distributed import KilledWorker, as_completed

    run, count = uuid.uuid4().hex, len(tables)  # keys of other runs are others
    futures = client.map(
        work,
        [request] * count,
        tables.keys(),
        tables.values(),
        key=[f"tf2_ros-{run}-{i}" for i in range(count)],
        retries=RETRIES,
    )
    recordings = dict(zip((one.key for one in futures), tables, strict=True))
    try:
        for future in as_completed(futures, loop=client.loop):
            if future.cancelled():
                raise ConnectionError("Dask has given up the work: the scheduler has ended")
            try:
                yield future.result()
            except KilledWorker:
                yield failed(recordings[future.key], "each process that read it was killed: out of memory?")
            except Exception as error:
                yield _outcome_of(recordings[future.key], error)
    finally:
        client.cancel(futures)  # those that have not begun, if this is not the end


def _outcome_of(recording: str, error: Exception) -> Outcome:
    # Whatever is wrong with one recording, the others go on. But what is not installed, none of them has.
    if isinstance(error, ModuleNotFoundError):
        raise error
    return failed(recording, f"{type(error).__name__}: {printable(str(error))}")
