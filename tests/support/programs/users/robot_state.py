"""Like robot_state_publisher: lists of fixed and of moving frames, for listeners that come early and late."""

import itertools
import time
from collections import namedtuple

import rclpy
import yaml
from geometry_msgs.msg import TransformStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.time import Time

from tf2_ros import Buffer, StaticTransformBroadcaster, TransformBroadcaster, TransformListener

Joint = namedtuple("Joint", "parent child x y z moves")

JOINTS = [
    Joint("base_link", "shoulder", 0.0, 0.0, 1.0, False),
    Joint("base_link", "mast", -0.3, 0.0, 0.5, False),
    Joint("shoulder", "elbow", 0.6, 0.0, 0.0, True),
    Joint("elbow", "wrist", 0.5, 0.1, 0.0, True),
    Joint("wrist", "hand", 0.1, 0.0, 0.0, False),
]


def as_message(joint, sec=0, bend=0.0):
    message = TransformStamped()
    message.header.frame_id = joint.parent
    message.header.stamp.sec = sec
    message.child_frame_id = joint.child
    vector = message.transform.translation
    vector.x, vector.y, vector.z = joint.x, joint.y + bend, joint.z
    message.transform.rotation.w = 1.0
    return message


class Loop:
    def __init__(self):
        self.executor = SingleThreadedExecutor()

    def spin_until(self, condition):
        deadline = time.monotonic() + 60.0
        while not condition():
            if time.monotonic() > deadline:
                raise SystemExit("gave up")
            self.executor.spin_once(timeout_sec=0.05)


def new_listener(loop, name):
    node = rclpy.create_node(name)
    loop.executor.add_node(node)
    buffer = Buffer()
    return buffer, TransformListener(buffer, node), node


def show(title, buffer, pairs, sec=0):
    for target, source in pairs:
        t = buffer.lookup_transform(target, source, Time(seconds=sec)).transform.translation
        print(f"{title}: {source} in {target}: {t.x:.2f} {t.y:.2f} {t.z:.2f}")


def main():
    rclpy.init()
    loop = Loop()
    state = rclpy.create_node("robot_state")
    fixed, moving = StaticTransformBroadcaster(state), TransformBroadcaster(state)
    early, early_listener, early_node = new_listener(loop, "early")
    loop.spin_until(lambda: moving.pub_tf.get_subscription_count() == 1)

    # A list, and later one more.
    fixed.sendTransform([as_message(joint) for joint in JOINTS if not joint.moves][:2])
    loop.spin_until(lambda: early.can_transform("base_link", "mast", Time()))
    print("hand known:", bool(early.can_transform("wrist", "hand", Time())))
    fixed.sendTransform(as_message(JOINTS[-1]))
    loop.spin_until(lambda: early.can_transform("wrist", "hand", Time()))
    show("fixed", early, [("base_link", "shoulder"), ("mast", "shoulder"), ("wrist", "hand")])

    # A list, a tuple and a generator of what moves.
    arm = [joint for joint in JOINTS if joint.moves]
    moving.sendTransform([as_message(joint, 1) for joint in arm])
    moving.sendTransform(tuple(as_message(joint, 2, 0.2) for joint in arm))
    moving.sendTransform(as_message(joint, 3, 0.4) for joint in arm)
    moving.sendTransform([])
    loop.spin_until(lambda: early.can_transform("base_link", "hand", Time(seconds=3)))
    for sec in (1, 2, 3):
        show(f"{sec} s", early, [("base_link", "hand")], sec)

    print(*sorted(early.all_frames_as_string().splitlines()), sep="\n")
    for child, facts in sorted(yaml.safe_load(early.all_frames_as_yaml()).items()):
        length, newest = facts["buffer_length"], facts["most_recent_transform"]
        print(f"{child}: {length:.1f} s, newest {newest:.1f}")

    # Who comes late still gets all that is fixed, and nothing of what moved.
    late, late_listener, late_node = new_listener(loop, "late")
    loop.spin_until(lambda: late.can_transform("wrist", "hand", Time()))
    show("late", late, [("mast", "shoulder"), ("wrist", "hand")])
    print("late: elbow known:", bool(late.can_transform("shoulder", "elbow", Time())))

    for one, two in itertools.combinations(["base_link", "hand", "mast", "elbow"], 2):
        found = early.lookup_transform(one, two, Time(seconds=2)).transform.translation
        print(one, two, *(f"{value:+.2f}" for value in (found.x, found.y, found.z)))

    early_listener.unregister()
    late_listener.unregister()
    loop.executor.shutdown()
    for node in (early_node, late_node, state):
        node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
