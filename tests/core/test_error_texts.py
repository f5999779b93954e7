"""What programs find in error texts with regular expressions, greedy ones included."""

import re

import pytest
from making import at, transform

ENDS = {"future": ("base", "map"), "past": ("base", "map"), "single": ("once", "map")}
# Expressions of public programs, and what each finds in the error of a lookup, by its cause.
PATTERNS = {
    r"extrapolation into the future\.  Requested time ([\d.]+) but the latest data is at": {"future": (9,)},
    r"extrapolation into the past\.  Requested time ([\d.]+) but the earliest data is at": {"past": (0.5,)},
    r"Requested time ([\d.]+) but the latest data is at time ([\d.]+)": {"future": (9, 3.5)},
    r"Requested time ([\d.]+) but the earliest data is at time ([\d.]+)": {"past": (0.5, 1.5)},
    r"Requested time (.*) but the (.*) data is at time (.*), when looking up": {
        "future": (9, "latest", 3.5),
        "past": (0.5, "earliest", 1.5),
    },
    r"data is at time (.*),": {"future": (3.5,), "past": (1.5,)},
    r"extrapolation at time ([\d.]+), but only time ([\d.]+) is in the buffer": {"single": (6, 5)},
    r"when looking up transform from frame \[(.*)\] to frame \[(.*)\]": ENDS,
    r"frame \[(.*)\] to frame \[(.*)\]": ENDS,
    r".*\[(.*)\]": dict.fromkeys(ENDS, ("map",)),
    r"Could not find a connection between '(.*)' and '(.*)' .* (not part of the same tree)": {
        "connection": ("map", "crater", "not part of the same tree")
    },
    r"'(.*)' and '(.*)'": {"connection": ("map", "crater")},
    r'"(.*)"': {},
    r"(does not exist|cannot be empty|cannot start with|contains a loop)": {},
}
SILENCE = "nothing has been received on /tf_static and nothing on /tf for 12 s"


def number(text):
    try:
        return float(text)
    except ValueError:
        return text


def found(text):
    """What the patterns find in a text, numbers as numbers."""
    matches = {pattern: re.search(pattern, text, re.DOTALL) for pattern in PATTERNS}
    return {pattern: tuple(map(number, match.groups())) for pattern, match in matches.items() if match}


@pytest.fixture
def buffer(tf2_py):
    buffer = tf2_py.BufferCore()
    for seconds in (1, 2, 3):
        buffer.set_transform(transform("map", "odom", seconds), "x")
        buffer.set_transform(transform("odom", "base", seconds + 0.5), "x")
    buffer.set_transform(transform("map", "once", 5), "x")
    buffer.set_transform(transform("moon", "crater", 1), "x")
    return buffer


@pytest.mark.parametrize(
    ("cause", "source", "seconds"),
    [("future", "base", 9), ("past", "base", 0.5), ("single", "once", 6), ("connection", "crater", 1)],
)
def test_what_is_found_in_the_error_of_a_lookup_and_the_reason_of_a_can_transform(
    tf2_py, buffer, cause, source, seconds
):
    def error():
        with pytest.raises(tf2_py.TransformException) as caught:
            buffer.lookup_transform_core("map", source, at(seconds))
        return str(caught.value)

    wanted = {pattern: groups[cause] for pattern, groups in PATTERNS.items() if cause in groups}
    possible, reason = buffer.can_transform_core("map", source, at(seconds))
    assert (possible, found(reason), found(error())) == (0, wanted, wanted)
    if hasattr(buffer, "_ask_for_silence"):
        # Silent topics are said at the end.
        buffer._ask_for_silence(lambda _: (SILENCE, SILENCE))
        assert found(error()) == wanted
        assert (SILENCE[1:] in error()) == (cause != "past")


# What is found of a wrong name in the error, and in the reason of a can_transform.
UNKNOWN = (
    r'"(.*)" passed to lookupTransform argument ([a-z_]+) does not exist',
    r'frame ID "(.*)" passed to canTransform argument (\w+) - (frame does not exist)',
)
EMPTY = (r"argument (\w+) - .*(cannot be empty)",) * 2
SLASH = (r"argument (\w+) - .*(cannot start with a '/')",) * 2


@pytest.mark.parametrize("argument", ["target_frame", "source_frame", "fixed_frame"])
@pytest.mark.parametrize(
    ("name", "patterns"),
    [("nowhere", UNKNOWN), ("bases", UNKNOWN), ("", EMPTY), ("/map", SLASH)],  # ours suggests base for bases
)
def test_a_bad_name_is_quoted_with_the_call_and_the_argument(tf2_py, buffer, argument, name, patterns):
    names = {"target_frame": "map", "source_frame": "base", "fixed_frame": "odom"} | {argument: name}
    arguments = (names["target_frame"], at(2), names["source_frame"], at(2), names["fixed_frame"])
    with pytest.raises(tf2_py.TransformException) as caught:
        buffer.lookup_transform_full_core(*arguments)
    texts = str(caught.value), buffer.can_transform_full_core(*arguments)[1]
    for text, call, pattern in zip(texts, ("lookupTransform", "canTransform"), patterns, strict=True):
        assert re.search(r'"(.*)"', text, re.DOTALL).groups() == (name,)
        place = re.search(r'"(.*)" passed to (lookupTransform|canTransform) argument (\w+)', text, re.DOTALL)
        assert place.groups() == (name, call, argument)
        assert argument in re.search(pattern, text, re.DOTALL).groups()
