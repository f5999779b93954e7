"""tf2_relay: its rules applied to buffers, and as a process of its own between two others."""

import random
import re
import signal
from contextlib import contextmanager

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from hypothesis import given
from hypothesis import strategies as st
from making import S, about_z, stamp_ns, transform, translation
from making_bags import Sent, Tf, raw
from nav_msgs.msg import Odometry
from processes import DEADLINE_S, running, until
from rclpy.qos import DurabilityPolicy, QoSProfile

from tf2_msgs.msg import TFMessage
from tf2_py import BufferCore
from tf2_ros import Buffer, TransformListener
from tf2_ros.records import MessageSource, Recording, insert_messages
from tf2_ros_tools.program import UsageError
from tf2_ros_tools.relay import ALL_RATE, Relay, Rule, Source, Threshold, pose_message, read_rules

pytestmark = pytest.mark.ours

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
    ],
)
def test_a_rule_sends_the_frames_that_it_chooses_under_their_new_names(keys, dynamic, static):
    assert sent(robot(), **keys) == (dynamic, static)


@st.composite
def trees(draw):
    """A tree with frames that move and frames that do not, and some of its frames."""
    count = draw(st.integers(2, 12))
    parents = [draw(st.integers(0, child - 1)) for child in range(1, count)]
    static = draw(st.lists(st.booleans(), min_size=count - 1, max_size=count - 1))
    chosen = draw(st.lists(st.integers(0, count - 1), min_size=2, max_size=count, unique=True))
    return parents, static, chosen, draw(st.booleans()), draw(st.integers(0, 2**32))


def pose(found):
    t, q = found.transform.translation, found.transform.rotation
    sign = 1.0 if q.w >= 0 else -1.0
    return np.array([t.x, t.y, t.z, *(sign * one for one in (q.x, q.y, q.z, q.w))])


@given(trees())
def test_receivers_look_up_what_the_robot_would(tree):
    parents, static, chosen, collapse, seed = tree
    numbers = random.Random(seed)
    buffer, receiver = BufferCore(), BufferCore()
    for child, (parent, is_static) in enumerate(zip(parents, static, strict=True), start=1):
        rotation = np.array([numbers.gauss(0, 1) for _ in range(4)])
        made = transform(
            f"f{parent}",
            f"f{child}",
            7.0,
            [numbers.uniform(-5, 5) for _ in range(3)],
            rotation / np.linalg.norm(rotation),
        )
        buffer.set_transforms([made], "test", static=is_static)
    frames = tuple(f"f{one}" for one in chosen)
    relay = Relay(rule(frames=frames, collapse=collapse, prefix="r/"), buffer, {})
    receiver.set_transforms(relay.dynamic_transforms(0.0, 0), "relay")
    receiver.set_transforms(relay.static_transforms(), "relay", static=True)
    for target in frames:
        for source in frames:
            if target == source:
                continue
            expected = buffer.lookup_transform_core(target, source, 0)
            found = receiver.lookup_transform_core(f"r/{target}", f"r/{source}", 0)
            stamps = {stamp_ns(expected)}
            if collapse and stamp_ns(expected) == 0:
                # A static path may lead over a frame that was left out, below which both ends move.
                stamps.add(7 * 10**9)
            assert stamp_ns(found) in stamps
            both = np.stack([pose(found), pose(expected)])
            # A quaternion and its negative are one rotation, also where w is about 0.
            if np.abs(both[0, 3:] + both[1, 3:]).max() < 1e-6:
                both[1, 3:] *= -1
            assert np.allclose(both[0], both[1], atol=1e-9)
    if collapse:
        assert len(receiver.frames()) <= len(frames) + 1


class TestRates:
    def send(self, relay, buffer, now_s, arrived):
        """Insert transforms, and get the child and stamp of each one that is sent."""
        for parent, child, ns in arrived:
            buffer.set_transform(transform(parent, child, ns=ns), "test")
        relay.note([(child, ns) for _, child, ns in arrived])
        return [(one.child_frame_id, stamp_ns(one)) for one in relay.dynamic_transforms(now_s, 0)]

    def test_a_source_of_the_same_rate_passes_whole_however_it_beats(self):
        buffer = BufferCore()
        relay = Relay(rule(rate=50.0), buffer, {})
        stamps = [100 * S + i * S // 50 for i in range(300)]
        left, numbers, found = [*stamps], random.Random(1), []
        for tick in range(1, 320):
            # Of those whose time has come, the last may be late.
            due = [one for one in left if one <= 100 * S + tick * S // 50 - numbers.choice([0, 1]) * S // 50]
            left = left[len(due) :]
            found += self.send(relay, buffer, tick / 50, [("map", "base", ns) for ns in due])
        assert found == [("base", ns) for ns in stamps]

    @pytest.mark.parametrize("source_hz", [51, 75, 100, 1000])
    def test_a_faster_source_does_not_exceed_the_rate(self, source_hz):
        buffer = BufferCore()
        relay = Relay(rule(rate=50.0), buffer, {})
        left, count = [100 * S + i * S // source_hz for i in range(10 * source_hz)], 0
        for tick in range(1, 501):
            due = [one for one in left if one <= 100 * S + tick * S // 50]
            left = left[len(due) :]
            found = self.send(relay, buffer, tick / 50, [("map", "base", ns) for ns in due])
            assert ("base", due[-1]) in found
            count += len(found)
        assert 500 <= count <= 505  # ten seconds, and what may be sent in addition

    def test_all_sends_late_transforms_and_what_arrived_before_its_frame_was_known(self):
        buffer = BufferCore()
        relay = Relay(rule(rate=ALL_RATE), buffer, {})
        for now_s, order in enumerate(([3, 1, 2], [9, 4, 5], [7], []), start=1):
            found = self.send(relay, buffer, now_s, [("map", "base", one * S) for one in order])
            assert found == [("base", one * S) for one in sorted(order)]

    def test_a_chain_is_sent_for_each_stamp_of_its_parts_at_which_all_of_it_is_known(self):
        buffer = BufferCore()
        relay = Relay(rule(rate=ALL_RATE, frames=("map", "base"), collapse=True), buffer, {})
        odom, base = ("map", "odom"), ("odom", "base")
        arrived = [(*odom, S), (*base, 2 * S), (*base, 3 * S), (*odom, 4 * S)]
        assert self.send(relay, buffer, 1, arrived) == [("base", ns * S) for ns in (2, 3)]
        arrived = [(*base, 5 * S), (*odom, 5 * S), (*base, 6 * S)]
        assert self.send(relay, buffer, 2, arrived) == [("base", ns * S) for ns in (4, 5)]


class TestReplays:
    @pytest.fixture
    def look(self):
        """Lets publishers, here topics, send frames with a stamp; whether time has gone back."""
        recording, buffer = Recording(), BufferCore()
        source, sources = Source(TF, buffer, recording), [MessageSource("a"), MessageSource("b")]
        now_s = 0.0

        def look(after_s, *sent):
            nonlocal now_s
            now_s += after_s
            messages = [
                (publisher, 1, raw(Sent(0, publisher, [Tf("map", one, s * S) for one in frames])))
                for publisher, frames, s in sent
            ]
            insert_messages(buffer, messages, sources, recording=recording)
            return source.look(now_s)[1]

        return look

    @pytest.mark.parametrize(
        "script",
        [
            # Of each step: whether time goes back, the seconds since the last one, and what is sent.
            ["no 0.1 a:xy:100", "yes 0.1 a:xy:101 a:xy:50", "no 0.1 a:xy:51", "yes 0.1 a:xy:20"],
            # All active publishers and frames must have gone back.
            [
                "no 0.1 a:xy:100 b:z:100",
                "no 0.1 a:xy:50",
                "no 0.1 b:z:101",
                "no 0.1 a:xy:51",
                "yes 0.1 b:z:51",
            ],
            # One that has ended is not waited for.
            ["no 0.1 a:x:100 b:x:100", "no 0.4 a:x:50", "yes 0.2 a:x:51"],
            # Two publishers of a frame with different clocks.
            ["no 0.1 a:x:100", "no 0.1 b:x:50", "no 0.1 a:x:101", "no 0.1 b:x:51"],
        ],
    )
    def test_time_goes_back_if_it_does_for_all_that_are_active(self, look, script):
        for step in script:
            expected, after_s, *sent = step.split()
            messages = [
                (one, frames, int(stamp)) for one, frames, stamp in (part.split(":") for part in sent)
            ]
            assert look(float(after_s), *messages) == (expected == "yes"), step


class TestThreshold:
    limits = Threshold(translation=0.1, rotation=0.1, repeat=2.0)

    def send(self, relay, buffer, seconds, x=0.0, angle=0.0):
        buffer.set_transform(transform("map", "base", seconds, (x, 0, 0), about_z(angle)), "test")
        return [stamp_ns(one) / S for one in relay.dynamic_transforms(seconds, 0)]

    def test_what_moved_is_sent_after_the_last_place_where_it_stood_still(self):
        buffer = BufferCore()
        relay = Relay(rule(threshold=self.limits), buffer, {})
        assert self.send(relay, buffer, 1.0) == [1.0]
        assert self.send(relay, buffer, 1.5, x=0.05) == []
        assert self.send(relay, buffer, 1.7, angle=0.05) == []
        assert self.send(relay, buffer, 2.0, x=0.5) == [1.7, 2.0]
        assert self.send(relay, buffer, 2.1, x=0.5, angle=0.2) == [2.1]

    def test_what_stands_still_is_repeated_with_new_stamps_only(self):
        buffer = BufferCore()
        relay = Relay(rule(threshold=self.limits), buffer, {})
        assert self.send(relay, buffer, 1.0) == [1.0]
        assert self.send(relay, buffer, 2.9) == []
        assert self.send(relay, buffer, 3.0) == [3.0]
        assert relay.dynamic_transforms(100.0, 0) == []


class TestStamps:
    def test_now_keeps_the_time_between_transforms(self):
        buffer = robot()
        relay = Relay(rule(shift_ns=None), buffer, {})
        assert {stamp_ns(one) for one in relay.dynamic_transforms(0.0, 1000 * S)} == {1000 * S}
        assert all(stamp_ns(one) == 0 for one in relay.static_transforms())
        buffer.set_transform(transform("map", "odom", 10.5), "test")
        [moved] = relay.dynamic_transforms(1.0, 2000 * S)
        assert stamp_ns(moved) == 1000.5 * S

    @pytest.mark.parametrize(
        ("shift_ns", "expected_s"), [(0, (100, 101)), (5 * S, (105, 106)), (None, (100, 101))]
    )
    def test_a_pose_that_does_not_move_is_of_the_present(self, shift_ns, expected_s):
        keys = {"to": ("/pose",), "pose": "PoseStamped", "frames": ("base", "camera"), "shift_ns": shift_ns}
        relay = Relay(rule(**keys), robot(), {})
        found = [relay.dynamic_transforms(now_s, now_s * S) for now_s in (100, 101)]
        assert [stamp_ns(one) / S for [one] in found] == [*expected_s]


def test_the_velocity_of_a_rare_odometry_is_of_the_last_seconds():
    buffer = BufferCore()
    for tenth in range(100):
        buffer.set_transform(transform("map", "base", 100 + tenth / 10, (0.3 * tenth, 0, 0)), "test")
    relay = Relay(rule(pose="Odometry", to=("/odom",), frames=("map", "base"), rate=0.0001), buffer, {})
    [found] = relay.dynamic_transforms(0.0, 0)
    assert pose_message(relay, found).twist.twist.linear.x == pytest.approx(3.0)


class TestConflicts:
    def test_a_frame_that_is_unknown_or_would_get_the_name_of_another_is_told(self):
        relay = Relay(rule(frames=("map", "base", "optica"), rename={"base": "map"}), robot(), {})
        assert ("odom", "map") not in names(relay.dynamic_transforms(0.0, 0))
        assert relay.problems() == [
            "rule 1: optica is not known; did you mean optical?",
            "rule 1: base is not sent: the name map is taken",
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
    "- {to: [/a, /b], frames: base}": "rule 1: 'frames': expected two or more; .* use subtree",
    "- {to: [/a, /b], collapse: true}": "rule 1: collapse needs frames or subtree",
    "- {to: [/a, /b], threshold: {translation: 1, rotation: 1, repaet: 1}}": "did you mean repeat",
    "- {to: [/a, /b], shift: later}": "rule 1: 'shift': expected a number of seconds, or now, got 'later'",
    "- {to: /a, as: Pose, frames: [a, b]}": "rule 1: 'as': expected one of PoseStamped, Odometry, got 'Pose'",
    "- {to: [/tf, /tf_static]}": "rule 1: 'to' has the topic /tf, from which a rule reads",
    "- {to: [/a, /b]}\n- {to: [/c, /a]}": "rule 2: 'to' has /a as /tf_static, but another rule has it as /tf",
}


@pytest.mark.parametrize(("text", "said"), WRONG.items())
def test_a_wrong_file_is_explained(tmp_path, text, said):
    path = tmp_path / "relay.yaml"
    path.write_text(text)
    with pytest.raises(UsageError, match=said):
        read_rules(path, str)


# As a process.


@pytest.fixture
def robots(peer):
    """Two other processes that publish."""
    return peer(), peer()


def keep_sending(robot, condition, executor=None, *, speed=0.0, first=1):
    """Let base move in the map until the condition holds; what is sent first has no receiver yet."""
    second = first - 1

    def send():
        nonlocal second
        second += 1
        robot.send(("map", "base", second * S, 2.0 + speed * second))
        return condition()

    until(send, executor)


@contextmanager
def relaying(folder, text, *options):
    """A tf2_relay for a `with` statement, and its file."""
    path = folder / "relay.yaml"
    path.write_text(text)
    with running("tf2_relay", str(path), *options) as process:
        yield process, path


def counts(process, how=signal.SIGINT):
    """End it; what it printed, as numbers of messages and transforms by topic."""
    process.send_signal(how)
    out, err = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0 and "Traceback" not in err, err
    found = re.findall(r"^(in|out), (.*): (\d+) messages?(?:, (\d+) transforms?)?$", out, re.MULTILINE)
    return {(way, where): (int(messages), int(count or 0)) for way, where, messages, count in found}


@contextmanager
def receiver(node, tf="/relay/tf"):
    buffer = Buffer()
    with TransformListener(buffer, node, tf_topic=tf, tf_static_topic=f"{tf}_static"):
        yield buffer


class Received(list):
    """The messages on a topic."""

    def __init__(self, node, topic, message=TFMessage, static=False):
        durability = DurabilityPolicy.TRANSIENT_LOCAL if static else DurabilityPolicy.VOLATILE
        node.create_subscription(message, topic, self.append, QoSProfile(depth=1000, durability=durability))


def test_a_late_receiver_gets_all_static_transforms_in_one_message(tmp_path, node, executor, robots):
    robot, other = robots
    with relaying(tmp_path, f"- {{{TO_TEXT}}}") as (process, _):
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
        counts(process, signal.SIGTERM)


def test_a_pair_is_sent_as_odometry_and_as_a_pose(tmp_path, node, executor, robots):
    robot, _ = robots
    text = (
        "- {to: /odometry, as: Odometry, frames: [map, base], rate: 100}\n"
        "- {to: /pose, as: PoseStamped, frames: [map, base], rate: 100, prefix: r1/}\n"
        "- {to: /mount, as: PoseStamped, frames: [base, camera], rate: 100}\n"
    )
    with relaying(tmp_path, text) as (process, _):
        odometry, poses = Received(node, "/odometry", Odometry), Received(node, "/pose", PoseStamped)
        mounts = Received(node, "/mount", PoseStamped)
        robot.send(("base", "camera", 0, 0.5), static=True)

        def has_arrived():
            return poses and mounts and odometry and odometry[-1].twist.twist.linear.x > 0.0

        keep_sending(robot, has_arrived, executor, speed=3.0)
        last = odometry[-1]
        assert (last.header.frame_id, last.child_frame_id) == ("map", "base")
        assert last.pose.pose.position.x == 2.0 + 3.0 * last.header.stamp.sec
        assert last.twist.twist.linear.x == pytest.approx(3.0)
        assert poses[-1].header.frame_id == "r1/map"
        assert mounts[-1].pose.position.x == 0.5
        assert mounts[-1].header.stamp.sec > 1_000_000_000  # the time at which it was sent
        counts(process)


def first_line(process, words):
    for line in process.stderr:
        if words in line:
            return line
    raise AssertionError(f"it never said {words!r}")


def test_a_changed_file_is_read_again_and_a_wrong_one_is_not_followed(tmp_path, node, executor, robots):
    robot, _ = robots
    with relaying(tmp_path, f"- {{{TO_TEXT}}}") as (process, path):
        with receiver(node) as buffer:
            robot.send(("base", "camera", 0, 1.0), static=True)
            until(lambda: "camera" in buffer)
            path.write_text("- {to: [/relay/tf, /relay/tf_static], rate: 0}")
            assert "'rate': expected a number of Hz" in first_line(process, "'rate': expected")
            # The middleware refuses a second type for a topic.
            path.write_text("- {to: /relay/tf, as: Odometry, frames: [map, base]}")
            assert "the old rules stay" in first_line(process, "rule 1: ")
            path.unlink()
            assert "the old rules stay" in first_line(process, "cannot read")
            keep_sending(robot, lambda: "map" in buffer)
        path.write_text("- {to: [/other/tf, /other/tf_static], prefix: new/}")
        first_line(process, "again")
        with receiver(node, "/other/tf") as buffer:
            until(lambda: "new/camera" in buffer)
        # Nobody who comes later gets what the rules no longer send.
        late = Received(node, "/relay/tf_static", static=True)
        until(lambda: late, executor)
        assert late[0].transforms == []
        found = counts(process)
    assert found["out", "/relay/tf_static"] == (2, 1)
    assert found["out", "/other/tf_static"] == (1, 1)


def test_a_replay_is_followed(tmp_path, node, executor, robots):
    with relaying(tmp_path, f"- {{{TO_TEXT}, rate: 100}}") as (process, _):
        received = Received(node, "/relay/tf")
        for first in (1_000_000, 900_000, 800_000):

            def has_come(first=first):
                stamps = [stamp_ns(one) // S for message in received for one in message.transforms]
                return any(first <= one < first + 50_000 for one in stamps)

            keep_sending(robots[0], has_come, executor, first=first)
        first_line(process, "went back")
        counts(process)


def test_a_dry_run_shows_trees_and_sends_nothing(tmp_path, node, robots):
    robots[0].send_without_subscriber(("base", "camera", 0, 1.0), static=True)
    text = f"- {{{TO_TEXT}, prefix: r1/, subtree: base}}\n- {{to: [/x, /y], frames: [base, camra]}}"
    # On a busy machine, what is published takes a while to be discovered.
    for seconds in ("4", "20", "100"):
        with relaying(tmp_path, text, "--dry-run", "-t", seconds) as (process, _):
            until(lambda: "tf2_relay" in node.get_node_names())
            assert node.count_publishers("/relay/tf_static") == 0
            out, err = process.communicate(timeout=DEADLINE_S + float(seconds))
        if "camera" in out:
            break
    assert (process.returncode, err) == (0, "rule 2: camra is not known; did you mean camera?\n")
    assert "in, /tf and /tf_static:\n  base\n    camera (static)\n" in out
    assert "out, /relay/tf and /relay/tf_static:\n  r1/base\n    r1/camera (static)\n" in out
    assert re.search(r"^out, /relay/tf_static: 1 message, 1 transform$", out, re.MULTILINE)
