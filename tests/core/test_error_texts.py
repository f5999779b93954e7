"""What programs find in error texts with regular expressions, greedy ones included."""

import re

import pytest
from making import at, transform

# Expressions of public programs: which of them an error matches, and what each of them finds.
PATTERNS = {
    "future": r"extrapolation into the future\.  Requested time ([\d.]+) but the latest data is at",
    "past": r"extrapolation into the past\.  Requested time ([\d.]+) but the earliest data is at",
    "latest": r"Requested time ([\d.]+) but the latest data is at time ([\d.]+)",
    "earliest": r"Requested time ([\d.]+) but the earliest data is at time ([\d.]+)",
    "any edge": r"Requested time (.*) but the (.*) data is at time (.*), when looking up",
    "first comma": r"data is at time (.*),",
    "only": r"extrapolation at time ([\d.]+), but only time ([\d.]+) is in the buffer",
    "frames": r"when looking up transform from frame \[(.*)\] to frame \[(.*)\]",
    "frames, greedy": r"frame \[(.*)\] to frame \[(.*)\]",
    "last bracket": r".*\[(.*)\]",
    "quoted": r'"(.*)"',
    "argument": r'"(.*)" passed to (lookupTransform|canTransform) argument (\w+)',
    "unknown": r'"(.*)" passed to lookupTransform argument ([a-z_]+) does not exist',
    "unknown to can": r'frame ID "(.*)" passed to canTransform argument (\w+) - (frame does not exist)',
    "empty": r"argument (\w+) - .*(cannot be empty)",
    "slash": r"argument (\w+) - .*(cannot start with a '/')",
    "unconnected": r"Could not find a connection between '(.*)' and '(.*)' .* (not part of the same tree)",
    "unconnected, greedy": r"'(.*)' and '(.*)'",
    "loop": r"(tf tree is invalid because it contains a loop)",
}


def number(text):
    try:
        return float(text)
    except ValueError:
        return text


def found(text):
    """What the patterns find in a text, numbers as numbers."""
    matches = {name: re.search(pattern, text, re.DOTALL) for name, pattern in PATTERNS.items()}
    return {name: tuple(map(number, match.groups())) for name, match in matches.items() if match}


@pytest.fixture
def buffer(tf2_py):
    buffer = tf2_py.BufferCore()
    for seconds in (1, 2, 3):
        buffer.set_transform(transform("map", "odom", seconds), "x")
        buffer.set_transform(transform("odom", "base", seconds + 0.5), "x")
    buffer.set_transform(transform("map", "once", 5), "x")
    buffer.set_transform(transform("moon", "crater", 1), "x")
    return buffer


def ends(source, target):
    return {"frames": (source, target), "frames, greedy": (source, target), "last bracket": (target,)}


BASE = ends("base", "map")
FUTURE = {"future": (9,), "latest": (9, 3.5), "any edge": (9, "latest", 3.5), "first comma": (3.5,), **BASE}
PAST = {
    "past": (0.5,),
    "earliest": (0.5, 1.5),
    "any edge": (0.5, "earliest", 1.5),
    "first comma": (1.5,),
    **BASE,
}
UNCONNECTED = {
    "unconnected": ("map", "crater", "not part of the same tree"),
    "unconnected, greedy": ("map", "crater"),
}
SILENCE = "nothing has been received on /tf_static and nothing on /tf for 12 s"


@pytest.mark.parametrize(
    ("source", "seconds", "wanted"),
    [
        ("base", 9, FUTURE),
        ("base", 0.5, PAST),
        ("once", 6, {"only": (6, 5), **ends("once", "map")}),
        ("crater", 1, UNCONNECTED),
    ],
)
def test_what_is_found_in_the_error_of_a_lookup_and_the_reason_of_a_can_transform(
    tf2_py, buffer, source, seconds, wanted
):
    def error():
        with pytest.raises(tf2_py.TransformException) as caught:
            buffer.lookup_transform_core("map", source, at(seconds))
        return str(caught.value)

    possible, reason = buffer.can_transform_core("map", source, at(seconds))
    assert (possible, found(reason), found(error())) == (0, wanted, wanted)
    if hasattr(buffer, "_ask_for_silence"):
        # Silent topics are said at the end.
        buffer._ask_for_silence(lambda _: (SILENCE, SILENCE))
        assert found(error()) == wanted
        assert (SILENCE[1:] in error()) == (seconds != 0.5), "not for a time in the past"


@pytest.mark.parametrize("argument", ["target_frame", "source_frame", "fixed_frame"])
@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("nowhere", "unknown"),
        ("bases", "unknown"),
        ("", "empty"),
        ("/map", "slash"),
    ],  # ours: meant was [base]
)
def test_a_bad_name_is_quoted_with_the_call_and_the_argument(tf2_py, buffer, argument, name, kind):
    names = {"target_frame": "map", "source_frame": "base", "fixed_frame": "odom"} | {argument: name}
    arguments = (names["target_frame"], at(2), names["source_frame"], at(2), names["fixed_frame"])
    with pytest.raises(tf2_py.TransformException) as caught:
        buffer.lookup_transform_full_core(*arguments)
    reason = buffer.can_transform_full_core(*arguments)[1]
    of_can = "unknown to can" if kind == "unknown" else kind
    for text, call, pattern in (
        (str(caught.value), "lookupTransform", kind),
        (reason, "canTransform", of_can),
    ):
        in_text = found(text)
        assert in_text["argument"] == (name, call, argument)
        assert in_text["quoted"] == (name,)
        assert argument in in_text[pattern]
