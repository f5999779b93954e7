"""What is logged of refused transforms, and that a flood of them is no flood of lines."""

import math
import tracemalloc

import pytest
from encoding import encode
from making import transform

pytestmark = pytest.mark.ours

NAN = math.nan
PER_SECOND = 20  # lines


@pytest.fixture
def buffer(tf2_py):
    return tf2_py.BufferCore()


@pytest.fixture
def lines(capfd):
    """Takes the lines that were logged since it was last called."""
    return lambda: [line for line in capfd.readouterr().err.splitlines() if "tf2_py" in line]


def refused(count, name="link"):
    """A serialised message of transforms that are all refused."""
    return encode([transform("map", f"{name}_{i:06d}", 1, (NAN, 0, 0)) for i in range(count)])


def test_of_a_message_full_of_refused_transforms_the_first_are_logged_and_all_counted(buffer, lines):
    assert buffer.set_transforms_cdr(refused(1000), "someone") == 0
    logged = lines()
    assert len(logged) == PER_SECOND + 1
    for i, line in enumerate(logged[:-1]):
        assert f"child_frame_id 'link_{i:06d}'" in line
        assert "TF_NAN_INPUT" in line
    assert "980 more transforms were refused and not logged" in logged[-1]
    assert buffer.statistics()["refused"]["nan_input"] == 1000


def test_many_messages_share_the_lines_of_a_second(buffer, lines):
    for i in range(200):
        buffer.set_transforms_cdr(refused(1, f"link_{i}"), "someone")
    logged = lines()
    summaries = [line for line in logged if "more transforms" in line]
    # A slow run may see a second or two pass.
    assert len(logged) - len(summaries) in (PER_SECOND, 2 * PER_SECOND, 3 * PER_SECOND)
    assert "1 more transforms" in summaries[0]
    assert len(summaries) <= 4  # one a second
    assert buffer.statistics()["refused"]["nan_input"] == 200


def test_nothing_is_made_of_what_is_not_logged(buffer, lines):
    few, many = refused(PER_SECOND + 1), refused(20_000)
    buffer.set_transforms_cdr(few, "x")  # whatever is made once
    peaks = []
    tracemalloc.start()
    try:
        for data in (few, many):
            tracemalloc.reset_peak()
            before = tracemalloc.get_traced_memory()[0]
            buffer.set_transforms_cdr(data, "x")
            peaks.append(tracemalloc.get_traced_memory()[1] - before)
    finally:
        tracemalloc.stop()
    assert peaks[1] < peaks[0] + 20_000
    assert buffer.statistics()["refused"]["nan_input"] == 20_000 + 2 * (PER_SECOND + 1)


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("\x1b[31mred\n\u202e", r"\x1b[31mred\n\u202e"),
        ("fäßchen 机器人 a\\b", "fäßchen 机器人 a\\b"),
    ],
)
def test_what_does_not_print_is_escaped_and_all_else_is_as_it_was(buffer, lines, name, shown):
    buffer.set_transform(transform(name, name + "2", 1, (NAN, 0, 0)), name)
    (line,) = lines()
    for part in (f"frame_id '{shown}'", f"child_frame_id '{shown}2'", f"authority '{shown}'"):
        assert part in line


@pytest.mark.parametrize("letter", ["x", "ä", "机"])
def test_of_a_long_name_only_the_beginning_is_logged(buffer, lines, letter):
    name = "a" + letter * 100_000
    buffer.set_transform(transform("map", name, 1, (NAN, 0, 0)), "x")
    (line,) = lines()
    assert len(line) < 700
    assert name[:80] in line
    assert f"({len(name.encode())} bytes)" in line
    buffer.set_transform(transform("map", "y" * 256, 1, (NAN, 0, 0)), "x")
    assert f"'{'y' * 256}'" in lines()[0]
