"""Owns the figures of a stream as a line of text."""

from collections.abc import Iterator

from tf2_py._internal import printable
from tf2_ros._traffic.streams import Stream

__all__ = ["milliseconds", "rate", "stream_line"]


def stream_line(stream: Stream) -> str:
    """Frame, parent, publisher, rate and delays."""
    parts = [f"parent {stream.parent}", f"publisher {stream.publisher}", *_figures(stream)]
    return printable(f"{stream.frame}: {', '.join(parts)}")


def rate(stream: Stream) -> str:
    """How many transforms a second, in Hz; a question mark where that is unknown."""
    return "?" if stream.rate is None else f"{stream.rate:.1f}"


def milliseconds(seconds: float | None) -> str:
    """A duration in ms; empty where there is none."""
    return "" if seconds is None else f"{1e3 * seconds:.1f}"


def _figures(stream: Stream) -> Iterator[str]:
    if stream.static:
        yield "static"
        return
    yield f"{rate(stream)} Hz"
    if stream.delay is not None:
        mean, most, jitter = (
            milliseconds(value) for value in (stream.delay, stream.delay_max, stream.jitter)
        )
        yield f"delay {mean} ms"
        yield f"max {most} ms"
        yield f"jitter {jitter} ms"
