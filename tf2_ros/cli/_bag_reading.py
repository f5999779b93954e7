"""Owns reading the recording that a command line of tf2_bag names."""

import sys
from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from tf2_py._internal import printable
from tf2_ros._recordings.hearing import Heard, hear
from tf2_ros._recordings.loading import TOPICS, Topics
from tf2_ros._recordings.reading import Recorded, open_recording
from tf2_ros_cython.cli._program import RunError, UsageError

__all__ = ["heard_of", "recorded_of", "telling_files", "topics_of"]

NS_BITS = 63


def topics_of(options: Namespace) -> Topics:
    """What is read, by ``--topic``."""
    return TOPICS if options.topics is None else dict(options.topics)


@contextmanager
def recorded_of(options: Namespace) -> Iterator[Recorded]:
    """
    Open the recording, for a ``with`` statement.

    :raises RunError: it cannot be read.
    :raises BagError: it is broken.
    """
    with telling_files(options.file), open_recording(options.file, partial=options.partial) as recorded:
        yield recorded


def heard_of(options: Namespace) -> Heard:
    """
    Read the transforms of the recording; what ``--partial`` loses is told on standard error.

    :raises UsageError: ``--start`` and ``--end`` are no span.
    :raises RunError: it cannot be read.
    :raises BagError: it is broken.
    """
    for name, time_ns in (("--start", options.start), ("--end", options.end)):
        if time_ns is not None and abs(time_ns) >> NS_BITS:
            raise UsageError(f"{name} must be seconds since the epoch, in 64 bits of nanoseconds")
    if None not in (options.start, options.end) and options.end < options.start:
        raise UsageError("--end must not be before --start")
    with telling_files(options.file):
        heard = hear(
            options.file,
            topics=topics_of(options),
            partial=options.partial,
            start=options.start,
            end=options.end,
        )
    if heard.problem is not None:
        print(f"{options.parser.prog}: {printable(heard.problem)}", file=sys.stderr)
    if heard.end_ns is not None and options.end is not None:
        # What comes later is not missing.
        heard = replace(heard, end_ns=min(heard.end_ns, options.end))
    return heard


@contextmanager
def telling_files(path: str) -> Iterator[None]:
    """
    Tell what cannot be read or written as a RunError.

    :param path: for errors that do not say of which file they are.
    """
    try:
        yield
    except OSError as failure:
        # Ours have a text, and no number.
        text = f"{failure.filename or path}: {failure.strerror}" if failure.strerror else str(failure)
        raise RunError(printable(text)) from None
