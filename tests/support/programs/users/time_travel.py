"""A carrot that follows a turtle with a delay: times of the past, and the questions with a fixed frame."""

import math
import re

import rclpy
from geometry_msgs.msg import PointStamped, TransformStamped
from rclpy.duration import Duration
from rclpy.time import Time

import tf2_geometry_msgs  # noqa: F401  (registers its types)
import tf2_ros

NUMBER = r"[-+]?\d+\.\d+"


def sec(value):
    return Time(nanoseconds=int(value * 1e9))


def fill(buffer):
    """The turtle goes along x and turns; the carrot circles it; the world's flag stands still."""
    for step in range(21):
        t = step / 2
        turtle = TransformStamped()
        turtle.header.stamp = sec(100 + t).to_msg()
        turtle.header.frame_id, turtle.child_frame_id = "world", "turtle"
        turtle.transform.translation.x = t
        turtle.transform.rotation.z, turtle.transform.rotation.w = math.sin(t / 20), math.cos(t / 20)
        buffer.set_transform(turtle, "simulation")
        carrot = TransformStamped()
        carrot.header.stamp = turtle.header.stamp
        carrot.header.frame_id, carrot.child_frame_id = "turtle", "carrot"
        carrot.transform.translation.x = 2 * math.cos(t)
        carrot.transform.translation.y = 2 * math.sin(t)
        carrot.transform.rotation.w = 1.0
        buffer.set_transform(carrot, "simulation")
    flag = TransformStamped(child_frame_id="flag")
    flag.header.frame_id, flag.transform.translation.y, flag.transform.rotation.w = "world", 7.0, 1.0
    buffer.set_transform_static(flag, "simulation")


def line(found):
    p, q = found.transform.translation, found.transform.rotation
    stamp = found.header.stamp.sec + found.header.stamp.nanosec / 1e9
    numbers = " ".join(f"{value + 0.0:.4f}" for value in (p.x, p.y, p.z, q.z, q.w))
    return f"{found.header.frame_id} <- {found.child_frame_id} at {stamp:.2f}: {numbers}"


def delayed(buffer):
    for now in (105, 106.25, 110):
        past = sec(now - 5)
        print(line(buffer.lookup_transform_full("turtle", sec(now), "carrot", past, "world")))
        print(line(buffer.lookup_transform_full("turtle", sec(now), "turtle", past, fixed_frame="world")))
    print(line(buffer.lookup_transform_full("flag", Time(), "carrot", sec(103), "world", Duration())))
    print(line(buffer.lookup_transform_full("carrot", sec(101), "flag", Time(), "flag")))


def possible(buffer):
    questions = {
        "now and past": ("turtle", sec(109), "carrot", sec(104), "world"),
        "too early": ("turtle", sec(109), "carrot", sec(99), "world"),
        "too late": ("turtle", sec(111), "carrot", sec(104), "world"),
        "no such frame": ("turtle", sec(109), "rabbit", sec(104), "world"),
        "no such fixed frame": ("turtle", sec(109), "carrot", sec(104), "moon"),
    }
    for title, question in questions.items():
        answer = bool(buffer.can_transform_full(*question))
        quick = bool(buffer.can_transform_full(*question, timeout=Duration(seconds=0.05)))
        verdict, text = buffer.can_transform_full(*question, return_debug_tuple=True)
        print(f"{title}: {answer} {quick} {bool(verdict)} {'with' if text else 'without'} a reason")
        try:
            buffer.lookup_transform_full(*question)
        except tf2_ros.ExtrapolationException as error:
            where = re.search(rf"extrapolation into the (\w+).*Requested time ({NUMBER})", str(error))
            print("   into the", where[1], float(where[2]))
        except tf2_ros.LookupException as error:
            print("   unknown:", re.search(r'"(\w+)" passed to .* does not exist', str(error)).group(1))


def points(buffer):
    tip = PointStamped()
    tip.header.frame_id = "carrot"
    tip.header.stamp = sec(104.5).to_msg()
    tip.point.x = 0.25
    for target, when in (("turtle", 104.5), ("turtle", 109.75), ("flag", 100), ("carrot", 102)):
        moved = buffer.transform_full(tip, target, sec(when), "world")
        p, h = moved.point, moved.header
        print(f"{target} at {when}: {h.frame_id} {h.stamp.sec}: {p.x:.4f} {p.y:.4f} {p.z:.4f}")


def forgetting():
    short = tf2_ros.Buffer(cache_time=Duration(seconds=4))
    fill(short)
    newest = short.get_latest_common_time("world", "carrot")
    fixed = short.get_latest_common_time("world", "flag")
    print("newest:", newest.nanoseconds / 1e9, "of the flag:", fixed.nanoseconds)
    for when in (106, 106.25, 105.5, 110.5):
        print(f"{when} remembered:", bool(short.can_transform("world", "turtle", sec(when))))
    short.clear()
    print("cleared:", bool(short.can_transform("world", "turtle", Time())))


def main():
    buffer = tf2_ros.Buffer()
    fill(buffer)
    delayed(buffer)
    possible(buffer)
    points(buffer)
    forgetting()


if __name__ == "__main__":
    rclpy.init()
    try:
        main()
    finally:
        rclpy.shutdown()
