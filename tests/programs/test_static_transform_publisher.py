"""The program static_transform_publisher: what it publishes, and what it refuses."""

import math
import re
import signal

import pytest
from making import rotation, translation
from processes import DEADLINE_S, running, until
from rclpy.qos import DurabilityPolicy, QoSProfile
from scipy.spatial.transform import Rotation

from tf2_msgs.msg import TFMessage
from tf2_ros_tools.programs.static_transform_publisher import read_file

pytestmark = pytest.mark.ours

NAME = "static_transform_publisher"
FRAMES = ["--frame-id", "map", "--child-frame-id", "robot"]
EVEN_LATE = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture
def published(node, executor):
    """What the program publishes: (translation, rotation), by the child and its parent."""

    def receive(*arguments, parent="map", child="robot"):
        messages = []
        receive.log = ""
        subscription = node.create_subscription(TFMessage, "/tf_static", messages.append, EVEN_LATE)
        with running(NAME, *arguments) as process:
            until(lambda: messages, executor)
            process.send_signal(signal.SIGINT)
            out, receive.log = process.communicate(timeout=DEADLINE_S)
        node.destroy_subscription(subscription)
        assert (process.returncode, out) == (0, "")
        assert "Traceback" not in receive.log
        [message] = messages
        found = {(one.header.frame_id, one.child_frame_id): one for one in message.transforms}
        return translation(found[parent, child]), rotation(found[parent, child])

    return receive


class TestOptions:
    def test_a_quaternion(self, published):
        given = ["--x", "1", "--y", "-2.5e-1", "--z", "-0.25", "--qz", "-.6", "--qw", ".8"]
        assert published(*given, *FRAMES) == ((1.0, -0.25, -0.25), (0.0, 0.0, -0.6, 0.8))

    def test_euler_angles_are_turns_about_fixed_axes(self, published):
        _, turn = published("--roll", "0.3", "--pitch", "-0.4", "--yaw", "-1e-3", *FRAMES)
        assert turn == pytest.approx(tuple(Rotation.from_euler("xyz", [0.3, -0.4, -1e-3]).as_quat()))

    def test_a_quaternion_of_another_length_is_normalised_with_a_warning(self, published):
        _, turn = published("--qx", "1", *FRAMES)  # w is 1 where it is not given
        assert turn == pytest.approx((math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)))
        assert re.search(r"\[WARN\].*The quaternion of robot does not have length one", published.log)

    def test_what_it_logs_is_what_tf2s_own_program_logs(self, published):
        published("--x", "1.5", *FRAMES)
        assert published.log.endswith(
            ": Spinning until stopped - publishing transform\n"
            "translation: ('1.500000', '0.000000', '0.000000')\n"
            "rotation: ('0.000000', '0.000000', '0.000000', '1.000000')\n"
            "from 'map' to 'robot'\n"
        )
        assert re.match(rf"\[INFO\] \[[\d.]+\] \[{NAME}_\w{{16}}\]: ", published.log)


class TestOldForm:
    def test_eight_values_have_yaw_pitch_and_roll(self, published):
        moved, turn = published("1", "-1e-05", "3", "-0.1", "0.2", "0.3", "map", "robot")
        assert moved == (1.0, -1e-05, 3.0)
        assert turn == pytest.approx(tuple(Rotation.from_euler("xyz", [0.3, 0.2, -0.1]).as_quat()))
        assert "[WARN]" in published.log
        assert "Old-style arguments are deprecated; see --help for new-style arguments" in published.log

    def test_nine_values_have_a_quaternion(self, published):
        values = ["1", "2", "3", "-.6", "0", "0", ".8", "map", "robot"]
        assert published(*values) == ((1.0, 2.0, 3.0), (-0.6, 0.0, 0.0, 0.8))


def test_many_are_published_by_one_program_from_a_file(published, tmp_path):
    path = tmp_path / "transforms.yaml"
    path.write_text(
        "- {frame_id: map, child_frame_id: robot, x: 1, yaw: 1e-3}\n"
        "- frame_id: robot\n  child_frame_id: camera\n  z: -.5\n  qx: 1.0\n  qw: 0.0\n"
    )
    moved, turn = published("--file", str(path))
    assert moved == (1.0, 0.0, 0.0)
    assert turn == pytest.approx((0.0, 0.0, 0.0005, 1.0), abs=1e-6)
    found = published("--file", str(path), parent="robot", child="camera")
    assert found == ((0.0, 0.0, -0.5), (1.0, 0.0, 0.0, 0.0))
    assert "publishing 2 transforms of " in published.log


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "- {frame_id: 5, child_frame_id: b}",
            "transform 1: 'frame_id': expected a text (quote what looks like a number), got 5",
        ),
        ("- {frame_id: a}", "transform 1: 'child_frame_id': expected a text"),
        (
            "- {frame_id: a, child_frame_id: b, x: near}",
            "transform 1: 'x': expected a finite number, got 'near'",
        ),
        (
            "- {frame_id: a, child_frame_id: b}\n- {frame_id: a, child_frame_id: c, qw: 0}",
            "transform 2: a quaternion must have a finite length above 0",
        ),
        (
            "- {frame_id: a, child_frame_id: b}\n- {frame_id: c, child_frame_id: b}",
            "the frame 'b' has two transforms",
        ),
        (
            "- {frame_id: a, child_frame_id: b}\n- {frame_id: b, child_frame_id: a}",
            "is its own ancestor",
        ),
    ],
)
def test_what_is_wrong_in_a_file_is_told_with_its_place(tmp_path, text, said):
    path = tmp_path / "transforms.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=re.escape(said)):
        read_file(path)
