"""Owns Dask's workers on this machine, and the process that they belong to."""

import json
import logging
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from distributed import Security

__all__ = ["LocalCluster", "local_workers", "main"]

# Multiprocessing runs the main module of a process again in its children. Ours is nobody's program, so a
# user's program needs no `if __name__ == "__main__"`. The path comes as arguments: the folder in which a
# program was started is not on it always. By path, this module needs none of its packages, which take long.
PROGRAM = "import sys; sys.path[:] = sys.argv[4:]; import runpy; runpy.run_path(sys.argv[3])['main']()"
# Of a cluster that ends at once; nothing is lost.
QUIET = "-Wignore::UserWarning:multiprocessing.resource_tracker"


class LocalCluster(NamedTuple):
    """How to reach a cluster, and what proves that one may."""

    address: str
    security: "Security"


@contextmanager
def local_workers(count: int) -> Iterator[LocalCluster]:
    """
    A cluster of so many worker processes in a ``with`` statement.

    It listens on the loopback interface alone, has no dashboard, and replaces workers that are lost. It ends
    with the ``with`` statement, or with this process, in whatever way that ends. It runs what it is sent, and
    other users reach the loopback interface, too: so whoever connects needs a key, which only this process
    and its children have.
    """
    with tempfile.TemporaryDirectory(prefix="tf2-ros-workers-", ignore_cleanup_errors=True) as folder:
        command = [sys.executable, QUIET, "-c", PROGRAM, str(count), folder, __file__, *sys.path]
        # In a session of its own: a Ctrl-C is for this process, which ends the others.
        cluster = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
        )
        with cluster:
            try:
                from distributed import Security  # which takes a while: here, meanwhile

                assert cluster.stdout is not None
                answer = cluster.stdout.readline()
                if not answer:
                    raise RuntimeError(f"the workers did not start, exit status {cluster.wait()}")
                address, keys = json.loads(answer)
                yield LocalCluster(address, Security(require_encryption=True, **keys))
            finally:
                cluster.kill()  # each worker ends when it does


def main() -> None:
    """Run the cluster until the standard input ends; writes its address and keys to the standard output."""
    import dask
    from distributed import LocalCluster, Security

    count, folder = int(sys.argv[1]), sys.argv[2]
    # Where nobody waits for the answer any more, the input has ended, too.
    with suppress(BrokenPipeError), os.fdopen(os.dup(1), "w") as answer:
        os.dup2(2, 1)  # whatever the workers print must not fill the pipe
        security = Security.temporary()
        with dask.config.set(_settings(dask.config)):
            cluster = LocalCluster(
                security=security,
                n_workers=count,
                threads_per_worker=1,
                host="127.0.0.1",
                dashboard_address=None,  # pyright: ignore[reportArgumentType]
                # Any port for its health checks: otherwise 8787, and a warning where that is taken.
                scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
                silence_logs=logging.CRITICAL,
                local_directory=folder,
            )
        parts = ("tls_ca_file", "tls_client_key", "tls_client_cert")
        keys = {part: getattr(security, part) for part in parts}
        print(json.dumps([cluster.scheduler_address, keys]), file=answer)
    sys.stdin.read()
    shutil.rmtree(folder, ignore_errors=True)  # the process that made it may have been killed
    os._exit(0)  # the workers watch this process


def _settings(config: Any) -> dict[str, Any]:
    environment = dict(config.get("distributed.nanny.pre-spawn-environ"))
    # With it, memory goes back to the system all the time; large buffers need three times the page faults.
    environment.pop("MALLOC_TRIM_THRESHOLD_", None)
    return {
        "distributed.nanny.pre-spawn-environ": environment,
        # Where a recording kills its worker, those that wait for the same worker are not suspected.
        "distributed.scheduler.worker-saturation": 1.0,
        # It interrupts the work a hundred times a second, and there is no dashboard to show it.
        "distributed.worker.profile.enabled": False,
    }
