"""Owns the words in pictures: names that fit, and figures with their units."""

from tf2_py._internal import printable
from tf2_ros._traffic.streams import Stream

__all__ = ["delay", "label", "rate"]

LONGEST = 60  # characters of a name


def label(text: str, longest: int = LONGEST) -> str:
    """The text with what does not print escaped, and without its middle where it is too long."""
    # What is cut away is not escaped first: a name may be as long as a message.
    half = longest // 2
    if len(text) > longest:
        text = f"{text[:half]}…{text[-half:]}"
    shown = printable(text)
    return shown if len(shown) <= longest + 1 else f"{shown[:half]}…{shown[-half:]}"


def rate(stream: Stream) -> str:
    """How often its transforms are received."""
    if stream.static:
        return "static"
    if stream.rate is None:
        return "no rate"
    return f"{stream.rate:.1f} Hz"


def delay(stream: Stream) -> str:
    """How old its transforms are when they are received; empty for a static one."""
    if stream.delay is None or stream.delay_max is None:
        return ""
    return f"delay {1e3 * stream.delay:.1f} ms, max {1e3 * stream.delay_max:.1f} ms"
