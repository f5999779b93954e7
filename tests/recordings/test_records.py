"""Many serialised messages in one call, and the records of what was in them."""

import pytest
from making import transform
from rclpy.serialization import serialize_message

from tf2_msgs.msg import TFMessage
from tf2_py import BufferCore
from tf2_ros.records import MessageSource, Recording, insert_messages

pytestmark = pytest.mark.ours


def raw(*transforms):
    return serialize_message(TFMessage(transforms=transforms))


MESSAGES = [
    ("/tf", 10, raw(transform("map", "odom", 1), transform("odom", "base", 2))),
    ("/tf_static", 11, raw(transform("base", "camera"))),
    ("/tf", 12, raw(transform("map", "odom", 3))),
]
SOURCES = [MessageSource("/tf"), MessageSource("/tf_static", True)]


def test_what_a_small_recording_has_no_place_for_comes_in_arrays():
    recording, arrays = Recording(2), []
    insert_messages(BufferCore(), MESSAGES, SOURCES, recording=recording, records=arrays)
    assert [len(one) for one in (*arrays, recording.take())] == [2, 2]
    assert recording.lost == 0


def test_a_malformed_message_is_an_error_or_left_out():
    messages = [*MESSAGES[:1], ("/tf", 11, b"nonsense"), *MESSAGES[2:]]
    buffer, found = BufferCore(), []
    with pytest.raises(ValueError, match="malformed TFMessage"):
        insert_messages(buffer, messages, SOURCES)
    assert buffer.frames()["odom"].count == 1
    buffer = BufferCore()
    assert insert_messages(buffer, messages, SOURCES, on_malformed=lambda *what: found.append(what)) == 3
    assert buffer.frames()["odom"].count == 2
    assert [what[:2] for what in found] == [("/tf", 11)]


def broken():
    yield from MESSAGES[:2]
    raise RuntimeError("the file ends here")


def test_an_error_of_the_iteration_is_raised_or_explained():
    buffer = BufferCore()
    with pytest.raises(RuntimeError, match="ends here"):
        insert_messages(buffer, broken(), SOURCES)
    assert "camera" in buffer, "what came before is kept"
    with pytest.raises(KeyError, match="after 11"):
        insert_messages(
            BufferCore(), broken(), SOURCES, on_broken=lambda error, last_ns: KeyError(f"after {last_ns}")
        )
