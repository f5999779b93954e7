"""The main program waits for futures of the buffer with spin_until_future_complete."""

import contextlib
from functools import partial

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.time import Time

from tf2_ros import Buffer, StaticTransformBroadcaster, TransformBroadcaster, TransformListener


@contextlib.contextmanager
def ros_node(name):
    rclpy.init()
    node = rclpy.create_node(name)
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.shutdown()


def stamped(parent: str, child: str, sec: int, x: float) -> TransformStamped:
    message = TransformStamped()
    message.header.stamp.sec = sec
    message.header.frame_id = parent
    message.child_frame_id = child
    message.transform.translation.x = x
    message.transform.rotation.w = 1.0
    return message


def send_when_heard(node, broadcaster, *messages):
    """From a timer of the node, once somebody listens."""

    def tick():
        if broadcaster.pub_tf.get_subscription_count():
            timer.cancel()
            for message in messages:
                broadcaster.sendTransform(message)

    timer = node.create_timer(0.01, tick)


def describe(future):
    found = future.result()
    return f"{found.header.frame_id} <- {found.child_frame_id}: {found.transform.translation.x:.2f}"


def main():
    with ros_node("futures") as node:
        buffer = Buffer()
        listener = TransformListener(buffer, node)
        moving, fixed = TransformBroadcaster(node), StaticTransformBroadcaster(node)
        wait = partial(rclpy.spin_until_future_complete, node, timeout_sec=60.0)

        future = buffer.wait_for_transform_async("map", "drone", Time())
        print("at once:", future.done())
        rclpy.spin_until_future_complete(node, future, timeout_sec=0.1)
        print("after a moment:", future.done())
        send_when_heard(node, moving, stamped("map", "drone", 3, 12.5))
        wait(future)
        print("latest:", describe(future))

        again = buffer.wait_for_transform_async("map", "drone", Time(seconds=3))
        print("what is there is done at once:", again.done(), describe(again))

        # Three at once, of different times, and the last one first.
        futures = [buffer.wait_for_transform_async("map", "drone", Time(seconds=s)) for s in (4, 5, 6)]
        futures[0].add_done_callback(lambda done: print("callback:", describe(done)))
        send_when_heard(node, moving, stamped("map", "drone", 6, 15.5))
        for one in reversed(futures):
            wait(one)
        print("three:", [describe(one) for one in futures])

        over_time = buffer.wait_for_transform_full_async(
            "camera", Time(seconds=6), "drone", Time(seconds=3), "map"
        )
        send_when_heard(node, fixed, stamped("drone", "camera", 0, 0.25))
        wait(over_time)
        print("full:", describe(over_time))

        given_up = buffer.wait_for_transform_async("map", "submarine", Time())
        given_up.cancel()
        print("cancelled:", given_up.cancelled())
        del listener


if __name__ == "__main__":
    main()
