"""Owns the sentences about waits: what each waits for, what it lacks, and how it ended without an answer."""

from tf2_py._objects.errors import NS_PER_S, seconds
from tf2_py._objects.printable import printable

TOLD_FROM_NS = 1_000_000  # of a shorter wait nothing is said


def _duration(waited_ns: int) -> str:
    return f"{max(waited_ns, 0) / NS_PER_S:.3f}".rstrip("0").rstrip(".")


def waited(reason: str, waited_ns: int) -> str:
    """What a lookup says that was waited for in vain. Programs parse the reason, so this stands behind it."""
    if waited_ns < TOLD_FROM_NS:
        return reason
    return f"{reason}{'' if reason.endswith(('.', '?')) else '.'} Waited {_duration(waited_ns)} s"


def timed_out(reason: object, waited_ns: int) -> str:
    """What a future says whose timeout is over."""
    return f"Waited {_duration(waited_ns)} s for the transform: {reason}"


def shut_down(waited_ns: int) -> str:
    """What ended a wait, also one that began later: no frame is to blame."""
    return f"The context was shut down, which ended the wait for the transform after {_duration(waited_ns)} s"


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
