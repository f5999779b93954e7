"""Owns the sentences about waits that do not end: what each waits for, and what it lacks."""

from tf2_py._objects.errors import seconds
from tf2_py._objects.printable import printable


def _at(time_ns: int) -> str:
    return f"at {seconds(time_ns)} s" if time_ns else "at the latest common time"


def waits_for(
    target: str, target_ns: int, source: str, source_ns: int, fixed: str | None, lack: str | None
) -> str:
    """One line about a wait. ``target_ns`` counts with a fixed frame only; ``lack`` None: nothing."""
    target, source = printable(target), printable(source)
    if fixed is None:
        lookup = f"from frame [{source}] to frame [{target}] {_at(source_ns)}"
    else:
        lookup = (
            f"from frame [{source}] {_at(source_ns)} to frame [{target}] {_at(target_ns)}, "
            f"fixed in frame [{printable(fixed)}]"
        )
    return f"waits for the transform {lookup}: {lack or 'the answer is available and is being delivered'}"


def unknown(name: str) -> str:
    """A frame that no transform has named."""
    return f"needs a frame [{printable(name)}], which is unknown"


def unconnected(target: str, source: str) -> str:
    """Two frames in different trees."""
    return f"needs transforms that connect frame [{printable(source)}] and frame [{printable(target)}]"


def loop(target: str, source: str) -> str:
    """A walk that never reached a root."""
    return f"needs the loop between frame [{printable(source)}] and frame [{printable(target)}] to be opened"


def data(gap: str, child: str, requested_ns: int, edge_ns: int) -> str:
    """A history that does not reach the time asked for; ``gap`` is 'empty', 'single', 'future' or 'past'."""
    needs = f"needs data of frame [{printable(child)}]"
    if gap == "empty":
        return f"{needs} (it has none)"
    side = "or later" if requested_ns > edge_ns else "or earlier"
    edge = {"future": "newest", "past": "oldest"}.get(gap, "only")
    return f"{needs} at {seconds(requested_ns)} s {side} (its {edge} stamp is {seconds(edge_ns)} s)"
