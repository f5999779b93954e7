# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a BufferCore refuses to insert, and what it logs of that."""

import copy
import math
import random
from types import SimpleNamespace as N

import pytest
from cdr_encoder import encode
from times_and_transforms import S, at, rotation, transform

NAN = math.nan


@pytest.fixture
def buffer(tf2_py):
    return tf2_py.BufferCore()


def frames(buffer):
    return buffer._getFrameStrings()


REFUSED = {
    "TF_SELF_TRANSFORM": transform("a", "/a", 1),
    "TF_NO_FRAME_ID": transform("/", "b", 1),
    "TF_NO_CHILD_FRAME_ID": transform("a", "", 1),
    "TF_NAN_INPUT": transform("a", "b", 1, (0, NAN, 0)),
    "TF_DENORMALIZED_QUATERNION": transform("a", "b", 1, xyzw=(0, 0, 0, 0)),
}


@pytest.mark.tf2
@pytest.mark.parametrize("tag", REFUSED)
@pytest.mark.parametrize("method", ["set_transform", "set_transform_static"])
def test_a_refusal_is_logged_and_returns_none(buffer, capfd, tag, method):
    assert getattr(buffer, method)(REFUSED[tag], "someone") is None
    assert frames(buffer) == []
    assert tag in capfd.readouterr().err


PER_SECOND = 20  # lines


@pytest.fixture
def lines(capfd):
    """Takes the lines that were logged since it was last called."""
    return lambda: [line for line in capfd.readouterr().err.splitlines() if "tf2_py" in line]


def refused(count, name="link"):
    """A serialized message of transforms that are all refused."""
    return encode([transform("map", f"{name}_{i:06d}", 1, (NAN, 0, 0)) for i in range(count)])


class TestLogging:
    """Of refused transforms; a flood of them is no flood of lines."""

    def test_one_line_names_every_reason_the_frames_and_the_authority(self, buffer, lines):
        buffer.set_transform(transform("cup", "cup", 1, (NAN, 0, 0), (0, 0, 0, 0)), "grip per")
        (line,) = lines()
        for part in ("TF_SELF_TRANSFORM", "TF_NAN_INPUT", "TF_DENORMALIZED_QUATERNION", "cup", "grip per"):
            assert part in line
        assert "TF_NO_FRAME_ID" not in line

    def test_of_a_message_full_of_refusals_the_first_are_logged_and_all_counted(self, buffer, lines):
        assert buffer.set_transforms_cdr(refused(1000), "someone") == 0
        logged = lines()
        assert len(logged) == PER_SECOND + 1
        for i, line in enumerate(logged[:-1]):
            assert f"child_frame_id 'link_{i:06d}'" in line
            assert "TF_NAN_INPUT" in line
        assert "980 more refused transforms were not logged" in logged[-1]
        assert buffer.statistics()["refused"]["nan_input"] == 1000

    def test_many_messages_share_the_lines_of_a_second(self, buffer, lines):
        for i in range(200):
            buffer.set_transforms_cdr(refused(1, f"link_{i}"), "someone")
        logged = lines()
        summaries = [line for line in logged if "more refused" in line]
        # A slow run may see a second or two pass.
        assert len(logged) - len(summaries) in (PER_SECOND, 2 * PER_SECOND, 3 * PER_SECOND)
        assert "1 more refused" in summaries[0]
        assert len(summaries) <= 4  # one a second
        assert buffer.statistics()["refused"]["nan_input"] == 200

    def test_what_does_not_print_is_escaped_and_all_else_is_as_it_was(self, buffer, lines):
        for name, shown in (
            ("\x1b[31mred\n\u202e", r"\x1b[31mred\n\u202e"),
            ("fäßchen 机器人 a\\b", "fäßchen 机器人 a\\b"),
            ("y" * 255, "y" * 255),
        ):
            buffer.set_transform(transform(name, name + "2", 1, (NAN, 0, 0)), name)
            (line,) = lines()
            for part in (f"frame_id '{shown}'", f"child_frame_id '{shown}2'", f"authority '{shown}'"):
                assert part in line

    @pytest.mark.parametrize("letter", ["x", "ä", "机"])
    def test_of_a_long_name_only_the_beginning_is_logged(self, buffer, lines, letter):
        name = "a" + letter * 100_000
        buffer.set_transform(transform("map", name, 1, (NAN, 0, 0)), "x")
        (line,) = lines()
        assert len(line) < 700
        assert name[:80] in line
        assert f"({len(name.encode())} bytes)" in line


class TestUnnormalizedRotations:
    """Buffers normalize them, as tf2 of Jazzy does; tf2 of Kilted and later refuses them, which is logged."""

    @pytest.mark.parametrize("method", ["set_transform", "set_transform_static"])
    @pytest.mark.parametrize(
        ("xyzw", "is_logged"),
        [
            ((0, 0, 0, 2), True),
            ((0, 0, 0, 0.5), True),
            ((0, 0, 0.11, 1), True),  # its squared length is 1.0121
            ((0, 0, 0.0999, 1), False),
            ((0.5, 0.5, 0.5, 0.491), False),  # 0.991
            ((0.5, 0.5, 0.5, -0.489), True),  # 0.989
            ((0, 0, 0, -1), False),
            ((0, 0, 0.7071, 0.7071), False),
        ],
    )
    def test_a_rotation_is_logged_if_newer_releases_refuse_it(self, buffer, lines, method, xyzw, is_logged):
        getattr(buffer, method)(transform("map", "arm", 1, xyzw=xyzw), "driver")
        logged = lines()
        assert len(logged) == is_logged
        if is_logged:
            for part in ("'map'", "'arm'", "'driver'", f"length {math.hypot(*xyzw):.6g}", "Kilted and later"):
                assert part in logged[0]
        x, y, z, w = rotation(buffer.lookup_transform_core("map", "arm", at(1)))
        assert math.hypot(x, y, z, w) == pytest.approx(1, abs=1e-15)

    def test_the_limit_is_that_of_tf2_to_the_last_bit(self, tf2_py, lines):
        # Found with tf2 0.41.7 and 0.46.0, which sum the squares from w on.
        generator = random.Random(5)
        for _ in range(500):
            xyzw = [generator.gauss(0, 1) for _ in range(4)]
            scale = math.sqrt(generator.choice((0.99, 1.01))) / math.hypot(*xyzw)
            x, y, z, w = (scale * one for one in xyzw)
            # One buffer would not log all of them.
            tf2_py.BufferCore().set_transform(transform("map", "arm", 1, xyzw=(x, y, z, w)), "x")
            assert len(lines()) == (abs(w * w + x * x + y * y + z * z - 1.0) >= 0.01)

    def test_only_the_first_one_of_each_frame_is_logged(self, buffer, lines):
        for second in range(1, 4):
            buffer.set_transform(transform("map", "arm", second, xyzw=(0, 0, 0, 2)), "x")
            buffer.set_transform(transform("arm", "/hand", second, xyzw=(0, 0, 0, 3)), "x")
        assert ["'arm'" in line.split("child_frame_id")[1] for line in lines()] == [True, False]
        buffer.clear()
        buffer.set_transform(transform("map", "arm", 5, xyzw=(0, 0, 0, 2)), "x")
        buffer.set_transform_static(transform("map", "arm", 5, xyzw=(0, 0, 0, 2)), "x")
        assert lines() == []

    def test_of_a_serialized_message_exactly_those_are_logged(self, buffer, lines):
        turns = {
            "a": (0, 0, 0, 1),
            "b": (0, 0, 0, 2),
            "c": (0, 0, 0, 0),
            "d": (0, 0, 1, 1),
            "e": (0, 1, 0, 0),
        }
        message = encode([transform("map", name, 1, xyzw=xyzw) for name, xyzw in turns.items()])
        assert buffer.set_transforms_cdr(message, "x") == 4
        refused, *logged = lines()
        assert "TF_DENORMALIZED_QUATERNION" in refused and "child_frame_id 'c'" in refused
        assert [line.split("child_frame_id ")[1][:3] for line in logged] == ["'b'", "'d'"]

    def test_a_flood_of_them_is_no_flood_of_lines(self, buffer, lines):
        message = encode([transform("map", f"link_{i}", 1, xyzw=(0, 0, 0, 2)) for i in range(1000)])
        assert buffer.set_transforms_cdr(message, "x") == 1000
        assert len(lines()) == PER_SECOND

    def test_a_copy_of_a_buffer_logs_nothing(self, buffer, lines):
        buffer.set_transform(transform("map", "arm", 1, xyzw=(0, 0, 0, 2)), "x")
        lines()
        assert copy.deepcopy(buffer).lookup_transform_core("map", "arm", at(1))
        assert lines() == []


HEADER, WRONG_PARTS = (
    N(stamp=N(nanoseconds=S), frame_id="map"),
    N(translation=(1, 2, 3), rotation=(0, 0, 0, 1)),
)


def duck(**changes):
    """An object with the fields of a transform, changed."""
    parts = N(translation=N(x=1, y=2.0, z=3), rotation=N(x=0, y=0, z=0, w=1))
    return N(**({"header": HEADER, "child_frame_id": "odom", "transform": parts} | changes))


@pytest.mark.parametrize(
    ("wrong", "error"),
    [
        (duck(child_frame_id=b"odom"), TypeError),
        (duck(child_frame_id=None), TypeError),
        (duck(child_frame_id="\ud800"), UnicodeEncodeError),
        (duck(header=None), TypeError),
        (duck(transform=WRONG_PARTS), TypeError),
        (duck(header=N(stamp=1.0, frame_id="map")), TypeError),
        (duck(header=N(stamp=N(sec=1.5, nanosec=0), frame_id="m")), TypeError),
        (duck(header=N(stamp=N(sec=2**63 // S + 1, nanosec=0), frame_id="map")), OverflowError),
        (duck(header=N(stamp=N(nanoseconds=2**63), frame_id="map")), OverflowError),
        (None, AttributeError),
        (5, AttributeError),
        (N(child_frame_id="odom", transform=WRONG_PARTS), AttributeError),
        (N(header=HEADER, transform=WRONG_PARTS), AttributeError),
        (N(header=HEADER, child_frame_id="odom"), AttributeError),
    ],
)
def test_other_objects_are_refused(buffer, wrong, error):
    for call in (buffer.set_transform, buffer.set_transform_static):
        with pytest.raises(error):
            call(wrong, "x")
    assert frames(buffer) == []


class TestManyAtOnce:
    def test_a_wrong_element_leaves_the_buffer_as_it_was(self, buffer):
        with pytest.raises(TypeError):
            buffer.set_transforms([transform("map", "odom", 1), "odom"], "x")
        assert frames(buffer) == []

    def test_names_stay_alive_while_later_elements_run_code(self, buffer):
        # A property of a later element drops the only reference to an earlier element's name.
        first = duck(child_frame_id="o" + "d" * 40)

        class Evil:
            header = first.header
            transform = first.transform

            @property
            def child_frame_id(self):
                first.child_frame_id = None
                return "evil"

        assert buffer.set_transforms([first, Evil()], "x") == 2
        assert frames(buffer) == ["o" + "d" * 40, "map", "evil"]


def test_names_of_forgotten_frames_count_and_the_log_says_so(tf2_py, capfd):
    buffer = tf2_py.BufferCore(max_frames=10)
    for i in range(20):
        buffer.set_transform(transform("map", f"track_{i}", 1), "tracker")
        buffer.forget(f"track_{i}")
    assert buffer.statistics()["frames"] == 0
    line = capfd.readouterr().err.splitlines()[0]
    assert "already knows max_frames names, those of forgotten frames included: raise max_frames, or" in line
    buffer.set_transform(transform("map", "track_3", 1), "tracker")
    assert "track_3" in buffer


@pytest.mark.parametrize("several", [list, tuple, iter, lambda given: N(transforms=given)])
def test_several_at_once_are_those_of_another_method(buffer, several):
    for call in (buffer.set_transform, buffer.set_transform_static):
        with pytest.raises(TypeError, match="; set_transforms takes a list of transforms$"):
            call(several([transform("map", "base", 1)]), "test")
