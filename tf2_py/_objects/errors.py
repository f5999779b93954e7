# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The exceptions of lookups, and the texts of errors and waits."""

from tf2_py._objects.frame_names import MOST_SUGGESTED, is_invalid_name
from tf2_py.printable import printable

NS_PER_S = 1_000_000_000
DAY_NS = 86400 * NS_PER_S
YEAR_NS = 365 * DAY_NS
SHORTEST_WAIT_NS = 1_000_000  # texts do not mention a shorter wait
TOO_NEW = "too new"
IN_1970 = (
    "The requested time is in 1970: is it in the wrong unit (an int is in nanoseconds), or simulated time?"
)
STAMP_NOT_SET = "Its stamp is 0: was it never set?"
DATA_IN_1970 = "The sample is from 1970: is it in simulated time, and the requested time is not?"


class TransformException(Exception):
    """
    Base of every error that a transform lookup raises.

    >>> from rclpy.time import Time
    >>> from tf2_py import BufferCore, TransformException
    >>> try:
    ...     BufferCore().lookup_transform_core("map", "odom", Time())
    ... except TransformException as error:
    ...     print(f"{type(error).__name__}: {error}")
    LookupException: "map" passed to lookupTransform argument target_frame does not exist. The buffer is empty
    """


class LookupException(TransformException):
    """A frame is unknown, or the tree contains a loop."""


class ConnectivityException(TransformException):
    """Both frames are known, but no path connects them."""


class ExtrapolationException(TransformException):
    """A frame on the path has no data for the requested time."""


class InvalidArgumentException(TransformException):
    """A frame name is empty or begins with a '/'."""


class TimeoutException(TransformException):
    """An answer was not available in time."""


class MalformedObjectError(AttributeError, TypeError):
    """An object lacks a required field: an AttributeError, as in tf2, and also a TypeError."""


for _exception in (TransformException, *TransformException.__subclasses__()):
    _exception.__module__ = "tf2_py"


def class_name(kind: type) -> str:
    """Get the name of a class with its package, as in ``tf2_ros.Buffer``."""
    return f"{kind.__module__.partition('.')[0]}.{kind.__qualname__}"


def seconds(ns: int) -> str:
    """Nanoseconds as decimal seconds, with all digits."""
    # The fastest way, because programs that retry format such times again and again.
    return "%d.%09d" % divmod(ns, NS_PER_S) if ns >= 0 else f"-{seconds(-ns)}"  # noqa: UP031


def span(ns: int) -> str:
    """How long, for people: in seconds, with all digits; from a day on in days, from a year on in years."""
    return f"{seconds(ns)} s" if -DAY_NS < ns < DAY_NS else in_days(ns)


def in_days(ns: int) -> str:
    """How long, with three digits: a day or more in days, a year or more in years; less: ``""``."""
    if -DAY_NS < ns < DAY_NS:
        return ""
    for unit, unit_ns in (("year", 365.25 * DAY_NS), ("day", DAY_NS)):
        if abs(ns) >= unit_ns:
            number = f"{ns / unit_ns:.3g}"
            return f"{number} {unit}" if number == "1" else f"{number} {unit}s"
    return ""


# Programs parse these texts with regular expressions that were written for tf2; see
# tests/core/test_lookup_error_texts.py. So additions come last, in words that no program searches for.


def bad_name(name: str, argument: str, call: str = "lookupTransform") -> TransformException:
    """The error for a frame name that is unknown or invalid; ``call`` is the function that received it."""
    is_question = call == "canTransform"
    given = f'"{printable(name)}" passed to {call} argument {argument}'
    if not is_invalid_name(name):
        return LookupException(
            f"Invalid frame ID {given} - frame does not exist" if is_question else f"{given} does not exist"
        )
    wrong = "cannot start with a '/'" if name else "cannot be empty"
    subject = "frame ID" if is_question else "argument"
    advice = "" if name or argument != "source_frame" else "; was header.frame_id of a message never set?"
    return InvalidArgumentException(f"Invalid {subject} {given} - in tf2 frame_ids {wrong}{advice}")


def loop(target: str, source: str) -> LookupException:
    """The error for a walk that never reached a root."""
    target, source = printable(target), printable(source)
    return LookupException(
        f"The tf tree is invalid because it contains a loop, or more than 1000 hops in a row, "
        f"between frame [{source}] and frame [{target}]"
    )


def unconnected(target: str, source: str, target_root: str, source_root: str) -> ConnectivityException:
    """The error for two frames in different trees."""
    target, source, target_root, source_root = map(printable, (target, source, target_root, source_root))
    return ConnectivityException(
        f"Could not find a connection between '{target}' and '{source}' because they are "
        f"not part of the same tree. Tf has two or more unconnected trees. "
        f"The root of {target} is {target_root}; the root of {source} is {source_root}."
    )


# tf2's sentence: the requested time, and the nearest stamp.
QUOTED = {
    "future": "into the future.  Requested time %s but the latest data is at time %s",
    "past": "into the past.  Requested time %s but the earliest data is at time %s",
    "single": "at time %s, but only time %s is in the buffer",
    "empty": "at time %s",
}
WHICH = {"future": "newest", "past": "oldest", "single": "only"}


def extrapolation(
    requested_ns: int,
    quoted_gap: str,
    quoted_ns: int,
    target: str,
    source: str,
    gap: str,
    edge_ns: int,
    child: str,
    parent: str,
    limiting: str | None,
    tolerance_ns: int,
    now_ns: int,
) -> ExtrapolationException:
    """
    The error for a time for which frames lack data: tf2's sentence, and the frame that lacks the most.

    :param quoted_gap: of the frame that tf2's sentence is about: 'empty', 'single', 'future' or 'past'.
    :param quoted_ns: the stamp of its data nearest to the time.
    :param gap: of ``child``, whose data is furthest from the time; ``edge_ns`` is its nearest stamp.
    :param limiting: the frame because of which the latest common time, which was asked for, is no later.
    :param tolerance_ns: how far beyond its newest sample ``child`` has an answer.
    :param now_ns: what the clock of the buffer shows; 0: it has none, or simulated time has not begun.
    """
    names = child, parent, target, source
    if not "".join(names).isprintable():
        child, parent, target, source = map(printable, names)
    requested = seconds(requested_ns)
    quoted = seconds(quoted_ns)
    fact = QUOTED[quoted_gap] % ((requested, quoted) if quoted_gap != "empty" else requested)
    if gap == "empty":
        lack = f"the buffer has no sample of {child}"
    else:
        how = TOO_NEW if edge_ns > requested_ns else "too old"
        apart = span(abs(requested_ns - edge_ns))
        edge = quoted if edge_ns == quoted_ns else seconds(edge_ns)
        lack = f"the {WHICH[gap]} sample of {child} (parent {parent}) at {edge} is {apart} {how}"
        if edge_ns < requested_ns and 0 < now_ns < requested_ns:
            ahead = span(requested_ns - now_ns)
            lack += f"; the requested time is {ahead} ahead of the clock of the buffer"
    if tolerance_ns > 0 and edge_ns < requested_ns:
        lack += f"; tolerance allows {seconds(tolerance_ns)} s"
    if 0 < requested_ns < YEAR_NS and max(quoted_ns, edge_ns) > 30 * YEAR_NS:
        lack += f". {IN_1970}"
    elif gap != "empty" and 0 <= edge_ns < YEAR_NS and requested_ns > 30 * YEAR_NS:
        lack += f". {DATA_IN_1970 if edge_ns else STAMP_NOT_SET}"
    if limiting is not None:
        lack += f". The latest common time is {requested} because {printable(limiting)} has no newer data"
    return ExtrapolationException(
        f"Lookup would require extrapolation {fact}, when looking up transform from frame [{source}] to "
        f"frame [{target}]; {lack}"
    )


def long_gap(
    child: str, requested_ns: int, older_ns: int, newer_ns: int, max_gap_ns: int, target: str, source: str
) -> ExtrapolationException:
    """The error for a time between two samples that are further apart than ``max_gap`` allows."""
    child, target, source = map(printable, (child, target, source))
    gap = span(newer_ns - older_ns)
    return ExtrapolationException(
        f"Lookup at time {seconds(requested_ns)} would require interpolation across {gap}, when looking up "
        f"transform from frame [{source}] to frame [{target}]; the samples of {child} at "
        f"{seconds(older_ns)} and {seconds(newer_ns)} are further apart than max_gap, {seconds(max_gap_ns)} s"
    )


def stale(
    child: str | None,
    parent: str,
    newest_ns: int,
    now_ns: int,
    max_age_ns: int,
    target: str,
    source: str,
) -> ExtrapolationException:
    """
    The error for a latest transform whose data is older than ``max_age`` allows.

    :param child: None: only the answer of a buffer server is known, whose stamp is ``newest_ns``.
    """
    if child is None:
        what, clock = "the answer of the server", "clock of the client"
    else:
        what, clock = f"the newest sample of {printable(child)} in {printable(parent)}", "clock of the buffer"
    if now_ns <= 0:
        fact = (
            f"has no known age: the {clock} is at 0, because simulated time has not begun, "
            "or nothing spins the node"
        )
    else:
        fact = f"is {span(now_ns - newest_ns)} old by the {clock}, at {seconds(now_ns)}"
    text = (
        f"The latest transform from frame [{printable(source)}] to frame [{printable(target)}] is too old; "
        f"{what}, at {seconds(newest_ns)}, {fact}; max_age allows {seconds(max_age_ns)} s"
    )
    if newest_ns < YEAR_NS and now_ns - newest_ns > 30 * YEAR_NS:
        if newest_ns == 0:
            text += f". {STAMP_NOT_SET}"
        else:
            text += ". The sample is from 1970: is it in simulated time, which this clock does not follow?"
    return ExtrapolationException(text)


def limit_of_unknown(name: str, argument: str, call: str) -> str:
    """The error text for a limit of a frame that is unknown or has an invalid name."""
    if is_invalid_name(name):
        return str(bad_name(name, argument, call))
    return f"{argument} has a limit for [{printable(name)}], which does not exist"


def limit_without_effect(name: str, argument: str, is_static: bool, instead: list[str]) -> str:
    """
    The error text for a limit of a frame that is static or not a child, so that the limit could never apply.

    :param instead: the frames that may be limited.
    """
    some = " or ".join(f"[{printable(one)}]" for one in instead[:MOST_SUGGESTED])
    text = f"{argument} has a limit for [{printable(name)}], which "
    if is_static:
        text += "is static, and therefore has no age"
        return f"{text}: limit {some} instead" if some else f"{text}; no frame of this lookup moves"
    return (
        f"{text}has no parent. A limit applies to the transform of a frame from its parent: limit "
        f"{some or 'a child'} instead"
    )


# How a wait ended without an answer.


def _duration(waited_ns: int) -> str:
    return f"{max(waited_ns, 0) / NS_PER_S:.3f}".rstrip("0").rstrip(".")


def after_wait(reason: str, waited_ns: int) -> str:
    """The error text of a lookup after a wait. Programs parse the reason, so the duration follows it."""
    if waited_ns < SHORTEST_WAIT_NS:
        return reason
    end = "" if reason.endswith((".", "?")) else "."
    return f"{reason}{end} Waited {_duration(waited_ns)} s{_why_no_use(reason)}"


def timed_out(reason: object, waited_ns: int) -> str:
    """The error text of a future after its timeout."""
    return f"Waited {_duration(waited_ns)} s for the transform: {reason}{_why_no_use(str(reason))}"


def _why_no_use(reason: str) -> str:
    # A listener that has just begun receives nothing from before; programs ask for the time of their start.
    return "; a wait brings newer transforms, not older ones" if TOO_NEW in reason else ""


def in_vain(why: str, waited_ns: int) -> str:
    """The error text of a wait after the end of what fills the buffer, even if the wait began afterwards."""
    return f"{why}, which ended the wait for the transform after {_duration(waited_ns)} s"
