"""Traffic of a soak's publisher, and a check of answers about it."""

import sys
import threading
import time

S = 1_000_000_000  # ns
CHAINS, HOPS = 100, 10
LINKS = [
    ("map" if hop == 0 else f"robot{chain}/{hop - 1}", f"robot{chain}/{hop}")
    for chain in range(CHAINS)
    for hop in range(HOPS)
]
FIRST_FRAME, LAST_FRAME = LINKS[0][1], LINKS[-1][1]
STATIC_LINKS = [(f"robot{chain}/{HOPS - 1}", f"robot{chain}/camera") for chain in range(CHAINS)]
STATIC_X = 0.25
RATE = 100
PERIOD_NS = S // RATE
POINTS_EVERY = 20  # messages
POINTS = "soak_points"
NOWHERE_EVERY = 10  # points
DEPTH = 1000  # a process that gets no processor for seconds loses nothing


def expected_x(stamp_ns, origin_ns, hops):
    """Each link moves by 1 m/s."""
    return hops * (stamp_ns - origin_ns) / S


def main(origin_ns):
    """Publish until standard input says otherwise; then say how much it was."""
    import rclpy
    from geometry_msgs.msg import PointStamped, TransformStamped
    from rclpy.qos import QoSProfile

    from bench.contestants.serialised import Template
    from tf2_msgs.msg import TFMessage
    from tf2_ros import StaticTransformBroadcaster

    rclpy.init()
    node = rclpy.create_node("soak_publisher")
    publisher = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=DEPTH))
    points = node.create_publisher(PointStamped, POINTS, QoSProfile(depth=DEPTH))
    static = []
    for parent, child in STATIC_LINKS:
        static.append(TransformStamped(child_frame_id=child))
        static[-1].header.frame_id = parent
        static[-1].transform.translation.x = STATIC_X
    broadcaster = StaticTransformBroadcaster(node)
    broadcaster.sendTransform(static)
    template = Template(len(LINKS), LINKS)
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.readline(), ended.set()), daemon=True).start()
    while publisher.get_subscription_count() == 0 or points.get_subscription_count() == 0:
        if ended.wait(0.01):
            return
    first_ns = time.monotonic_ns()
    count = sent_points = 0
    while True:
        stamp_ns = first_ns + count * PERIOD_NS
        if ended.wait(max(0, stamp_ns - time.monotonic_ns()) / S):
            break
        publisher.publish(template.message(stamp_ns, expected_x(stamp_ns, origin_ns, 1)))
        if count % POINTS_EVERY == 0:
            point = PointStamped()
            point.header.stamp.sec, point.header.stamp.nanosec = divmod(stamp_ns, S)
            nowhere = sent_points % NOWHERE_EVERY == NOWHERE_EVERY - 1
            point.header.frame_id = "nowhere" if nowhere else LAST_FRAME
            points.publish(point)
            sent_points += 1
        count += 1
    publisher.wait_for_all_acked()
    points.wait_for_all_acked()
    print(count, first_ns + (count - 1) * PERIOD_NS, sent_points, flush=True)
    sys.stdin.readline()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main(int(sys.argv[1]))
