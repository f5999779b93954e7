"""Dask workers on which something goes wrong; they import this module."""

import os
import signal

from distributed import WorkerPlugin

from tf2_ros_tools import fleet


class Lossy(WorkerPlugin):
    """
    Does something when a worker has written a file and not yet renamed it.

    :param what: "kill" kills the worker, "fail" raises an OSError.
    :param once: the path of a file; the first worker makes it, and the others go on when it is there.
    """

    def __init__(self, what, once):
        self.what, self.once = what, str(once)

    def setup(self, worker):
        write = os.replace  # of everybody: what writes tables uses it

        def replace(*arguments):
            try:
                os.close(os.open(self.once, os.O_CREAT | os.O_EXCL))
            except FileExistsError:
                return write(*arguments)
            if self.what == "kill":
                os.kill(os.getpid(), signal.SIGKILL)
            raise OSError("the disk is away")

        os.replace = replace


class Deadly(WorkerPlugin):
    """A recording with this word in its path kills each worker that reads it."""

    def __init__(self, word):
        self.word = word

    def setup(self, worker):
        hear = fleet.hear

        def heard(path, *arguments, **options):
            if self.word in path:
                os.kill(os.getpid(), signal.SIGKILL)
            return hear(path, *arguments, **options)

        fleet.hear = heard
