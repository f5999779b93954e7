# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""tf2_relay: its rules applied to buffers, and as a process of its own between two others."""

from itertools import count, permutations

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from random_runs import seeds
from rclpy.qos import DurabilityPolicy, QoSProfile
from scipy.spatial.transform import Rotation
from starting_programs import running
from times_and_transforms import S, about_z, stamp_ns, transform, translation
from waiting import DEADLINE_S, until

from tf2_msgs.msg import TFMessage
from tf2_py import BufferCore
from tf2_ros.numpy import to_matrix
from tf2_ros_tools.common.program import UsageError
from tf2_ros_tools.nodes.relay import Relay, Rule, Threshold, read_rules

TF = ("/tf", "/tf_static")
TO = ("/relay/tf", "/relay/tf_static")
TO_TEXT = "to: [/relay/tf, /relay/tf_static]"


def rule(**keys):
    return Rule("rule 1", **{"source": TF, "to": TO, **keys})


def names(transforms):
    return sorted((one.header.frame_id, one.child_frame_id) for one in transforms)


def robot(stamp_s=10.0):
    buffer = BufferCore()
    moving = [("map", "odom"), ("odom", "base"), ("base", "arm"), ("arm", "hand")]
    buffer.set_transforms([transform(*one, stamp_s, (1, 0, 0)) for one in moving], "test")
    mounted = [("base", "camera"), ("camera", "optical"), ("hand", "finger")]
    buffer.set_transforms([transform(*one, 0, (0, 1, 0)) for one in mounted], "test", static=True)
    return buffer


def sent(buffer, **keys):
    relay = Relay(rule(**keys), buffer, {})
    return names(relay.dynamic_transforms(0.0, 0)), names(relay.static_transforms())


CAMERA = [("base", "camera"), ("camera", "optical")]


@pytest.mark.parametrize(
    ("keys", "dynamic", "static"),
    [
        (
            {},
            [("arm", "hand"), ("base", "arm"), ("map", "odom"), ("odom", "base")],
            [*CAMERA, ("hand", "finger")],
        ),
        # With what connects them; two branches meet in their common ancestor.
        ({"frames": ("odom", "optical")}, [("odom", "base")], CAMERA),
        ({"frames": ("hand", "optical")}, [("arm", "hand"), ("base", "arm")], CAMERA),
        ({"subtree": ("base",), "exclude": ("arm",)}, [], CAMERA),
        ({"subtree": ("camera",), "frames": ("map",)}, [("map", "odom"), ("odom", "base")], CAMERA),
        # A chain is dynamic if a part of it is.
        (
            {"frames": ("map", "base", "optical"), "collapse": True},
            [("map", "base")],
            [("base", "optical")],
        ),
        ({"frames": ("map", "odom"), "rename": {"map": "odom", "odom": "map"}}, [("odom", "map")], []),
        ({"frames": ("map", "odom"), "prefix": "/r/"}, [("r/map", "r/odom")], []),
    ],
)
def test_a_rule_sends_the_frames_that_it_chooses_under_their_new_names(keys, dynamic, static):
    assert sent(robot(), **keys) == (dynamic, static)


@pytest.mark.parametrize("seed", seeds(100))
def test_receivers_look_up_what_the_robot_would(seed):
    random, collapse = np.random.default_rng(seed), seed % 2 == 1
    buffer, receiver = BufferCore(), BufferCore()
    count = random.integers(2, 13)
    for child in range(1, count):
        turn = Rotation.random(random_state=random).as_quat()
        made = transform(f"f{random.integers(child)}", f"f{child}", 7.0, random.uniform(-5, 5, 3), turn)
        buffer.set_transforms([made], "test", static=random.random() < 0.5)
    chosen = random.choice(count, random.integers(2, count + 1), replace=False)
    frames = tuple(f"f{one}" for one in chosen)
    relay = Relay(rule(frames=frames, collapse=collapse, prefix="r/"), buffer, {})
    receiver.set_transforms(relay.dynamic_transforms(0.0, 0), "relay")
    receiver.set_transforms(relay.static_transforms(), "relay", static=True)
    for target, source in permutations(frames, 2):
        expected = buffer.lookup_transform_core(target, source, 0)
        found = receiver.lookup_transform_core(f"r/{target}", f"r/{source}", 0)
        stamps = stamp_ns(found), stamp_ns(expected)
        # A static path may lead over a frame that was left out, below which both ends move.
        assert stamps[0] == stamps[1] or (collapse and stamps == (7 * S, 0))
        assert np.allclose(to_matrix(found), to_matrix(expected), atol=1e-9)
    if collapse:
        assert len(receiver.frames()) <= len(frames) + 1


def test_the_newest_transform_is_sent_once():
    buffer = BufferCore()
    relay = Relay(rule(), buffer, {})

    def sent_after(*seconds):
        buffer.set_transforms([transform("map", "base", one) for one in seconds], "test")
        return [stamp_ns(one) // S for one in relay.dynamic_transforms(0.0, 0)]

    assert [sent_after(1, 3, 2), sent_after(), sent_after(4)] == [[3], [], [4]]
    # Simulated time goes back, so the listener clears the buffer.
    buffer.clear()
    assert sent_after(1) == [1]


def test_what_moved_is_sent_and_what_stands_still_is_repeated():
    buffer = BufferCore()
    relay = Relay(rule(threshold=Threshold(translation=0.1, rotation=0.1, repeat=2.0)), buffer, {})
    for seconds, x, angle, stamps in (
        (1.0, 0.0, 0.0, [1.0]),
        (1.5, 0.05, 0.0, []),
        (1.7, 0.0, 0.05, []),
        (2.0, 0.5, 0.0, [1.7, 2.0]),  # after the last place where it stood still
        (2.1, 0.5, 0.2, [2.1]),
        (4.0, 0.5, 0.2, []),
        (4.2, 0.5, 0.2, [4.2]),
    ):
        buffer.set_transform(transform("map", "base", seconds, (x, 0, 0), about_z(angle)), "test")
        assert [stamp_ns(one) / S for one in relay.dynamic_transforms(seconds, 0)] == stamps
    # Only new stamps are sent.
    assert relay.dynamic_transforms(100.0, 0) == []


class TestConflicts:
    def test_a_frame_that_is_unknown_or_would_get_the_name_of_another_is_told(self):
        relay = Relay(rule(frames=("map", "base", "optica"), rename={"base": "map"}), robot(), {})
        assert ("odom", "map") not in names(relay.dynamic_transforms(0.0, 0))
        assert relay.problems() == [
            "rule 1: there is no frame optica; did you mean optical?",
            "rule 1: base is not sent: the name map is already used",
        ]

    def test_rules_that_share_one_topic_do_not_send_the_same_name(self):
        owners, buffer = {}, robot()
        pairs = [("/a/tf", "/a/tf_static"), ("/b/tf", "/b/tf_static"), ("/a/tf", "/b/tf_static")]
        first, second, both = (Relay(rule(to=to, subtree=("camera",)), buffer, owners) for to in pairs)
        assert [names(one.static_transforms()) for one in (second, first, both)] == [
            [("camera", "optical")],
            [("camera", "optical")],
            [],
        ]


WRONG = {
    "- 3": "rule 1: expected a mapping with to, got 3",
    "- {name: far, to: [/a, /b], treshold: 1}": r"\(far\): 'treshold' is not a key; did you mean threshold\?",
    "- {to: [/a, /b]}\n- {to: [/a, /b], rate: 0}": "rule 2: 'rate': expected a number of Hz from .* got 0",
    "- {to: [/a b, /c]}": r"rule 1: 'to': expected two topics, .* got \['/a b', '/c'\]",
    "- {to: [/a, /b], frames: base}": "rule 1: 'frames' needs at least two frames",
    "- {to: [/a, /b], collapse: true}": "rule 1: 'collapse' requires 'frames' or 'subtree'",
    "- {to: [/a, /b], threshold: {translation: 1, rotation: 1, repaet: 1}}": "did you mean repeat",
    "- {to: /a, as: Pose, frames: [a, b]}": "rule 1: 'as': expected PoseStamped, got 'Pose'",
    "- {to: [/tf, /tf_static]}": "rule 1: 'to': a rule reads from /tf",
}


@pytest.mark.parametrize(("text", "said"), WRONG.items())
def test_a_wrong_file_is_explained(tmp_path, text, said):
    path = tmp_path / "relay.yaml"
    path.write_text(text)
    with pytest.raises(UsageError, match=said):
        read_rules(path, str)


# As a process.


class Received(list):
    """The messages on a topic."""

    def __init__(self, node, topic, message=TFMessage, static=False):
        durability = DurabilityPolicy.TRANSIENT_LOCAL if static else DurabilityPolicy.VOLATILE
        node.create_subscription(message, topic, self.append, QoSProfile(depth=1000, durability=durability))


def test_a_late_receiver_gets_all_static_transforms_in_one_message(tmp_path, node, executor, peer):
    robot, other, path = peer(), peer(), tmp_path / "relay.yaml"
    path.write_text(f"- {{{TO_TEXT}}}")
    with running("tf2_relay", str(path)) as process:
        early = Received(node, "/relay/tf_static", static=True)
        robot.send(("base", "camera", 0, 1.0), static=True)
        other.send(("base", "lidar", 0, 2.0), static=True)
        both = [("base", "camera"), ("base", "lidar")]
        until(lambda: early and names(early[-1].transforms) == both, executor)
        late = Received(node, "/relay/tf_static", static=True)
        until(lambda: late, executor)
        assert names(late[0].transforms) == both
        # What changes is sent again, with everything else.
        other.send(("base", "lidar", 0, 3.0), static=True)
        until(lambda: {translation(one)[0] for one in late[-1].transforms} == {1.0, 3.0}, executor)
        process.terminate()
        out, err = process.communicate(timeout=DEADLINE_S)
    assert (process.returncode, out) == (0, "") and "Traceback" not in err, err


def test_what_moves_is_sent_as_transforms_and_as_a_pose(tmp_path, node, executor, peer):
    robot, path = peer(), tmp_path / "relay.yaml"
    path.write_text(
        "- {to: /pose, as: PoseStamped, frames: [map, base], rate: 100, prefix: r1/}\n"
        "- {to: /mount, as: PoseStamped, frames: [base, camera], rate: 100}\n"
        f"- {{{TO_TEXT}, frames: [map, base]}}\n"
        "- {to: [/x, /y], frames: [base, camra]}\n"
    )
    with running("tf2_relay", str(path)) as process:
        poses, mounts = (Received(node, topic, PoseStamped) for topic in ("/pose", "/mount"))
        moving = Received(node, "/relay/tf")
        robot.send(("base", "camera", 0, 0.5), static=True)
        seconds = count(1)

        def has_arrived():
            robot.send(("map", "base", next(seconds) * S, 2.0))
            return poses and mounts and moving

        until(has_arrived, executor)
        assert names(moving[-1].transforms) == [("map", "base")]
        assert poses[-1].pose.position.x == 2.0
        assert poses[-1].header.frame_id == "r1/map"
        assert mounts[-1].pose.position.x == 0.5
        assert mounts[-1].header.stamp.sec > 1_000_000_000  # the time at which it was sent
        until(lambda: "rule 4: there is no frame camra; did you mean camera?" in process.stderr.readline())
