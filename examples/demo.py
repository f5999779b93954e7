# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One process broadcasts a robot that drives a circle; another one receives its transforms and looks them up.

Run: python examples/demo.py
Ends by itself, and gives up after LIMIT_S seconds. The exit status is 0 only if everything succeeded.
Both processes use a ROS domain that is free on this machine, whatever ROS_DOMAIN_ID says.
"""

import math
import os
import socket
import subprocess
import sys
import time
from pathlib import Path

LIMIT_S = 30.0
RATE_HZ = 25.0
RADIUS_M = 2.0
TURN_RAD_S = 0.8
ODOM_X_M = 10.0  # where odometry starts, in the map
CAMERA = (0.3, 0.0, 0.5)  # where the camera is mounted on the robot, in meters; it looks ahead
LOOKUPS = 6


def broadcast():
    """The first process: map -> odom and base_link -> camera are static, odom -> base_link moves."""
    import rclpy
    from geometry_msgs.msg import TransformStamped
    from rclpy.executors import ExternalShutdownException

    from tf2_ros import StaticTransformBroadcaster, TransformBroadcaster

    def transform(parent, child, xyz, yaw):
        message = TransformStamped()
        message.header.stamp = node.get_clock().now().to_msg()
        message.header.frame_id = parent
        message.child_frame_id = child
        offset, turn = message.transform.translation, message.transform.rotation
        offset.x, offset.y, offset.z = xyz
        turn.z, turn.w = math.sin(yaw / 2), math.cos(yaw / 2)
        return message

    def drive():
        angle = TURN_RAD_S * (time.monotonic() - begin)
        if angle > TURN_RAD_S * LIMIT_S:
            raise SystemExit("the listener did not end the broadcaster")
        position = (RADIUS_M * math.cos(angle), RADIUS_M * math.sin(angle), 0.0)
        moving.sendTransform(transform("odom", "base_link", position, angle + math.pi / 2))

    rclpy.init()
    node = rclpy.create_node("robot")
    fixed = StaticTransformBroadcaster(node)
    fixed.sendTransform(transform("map", "odom", (ODOM_X_M, 0.0, 0.0), 0.0))
    fixed.sendTransform(transform("base_link", "camera", CAMERA, 0.0))
    moving = TransformBroadcaster(node)
    begin = time.monotonic()
    node.create_timer(1 / RATE_HZ, drive)
    try:
        rclpy.spin(node)
    except ExternalShutdownException:
        return
    except RuntimeError:
        if rclpy.ok():  # otherwise SIGTERM came within drive()
            raise


def listen():
    """The second process: prints what it looks up."""
    import rclpy
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

    from tf2_ros import Buffer, TransformListener

    rclpy.init()
    node = rclpy.create_node("listener")
    buffer = Buffer(node=node)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    with TransformListener(buffer, node):
        task = executor.create_task(show(node, buffer))
        try:
            executor.spin_until_future_complete(task, timeout_sec=LIMIT_S)
        except ExternalShutdownException:  # the demonstration was interrupted
            return
    expect(task.done(), "everything happened in time")
    task.result()
    rclpy.shutdown()


async def show(node, buffer):
    """The steps of the demonstration."""
    from rclpy.duration import Duration
    from rclpy.time import Time

    timeout = Duration(seconds=LIMIT_S)
    found = await buffer.lookup_transform_async("map", "camera", Time(), timeout=timeout)
    begin = Time.from_msg(found.header.stamp)

    print("\nWhere the camera is in the map, every quarter of a second:")
    places = []
    for i in range(LOOKUPS):
        stamp = begin + Duration(nanoseconds=i * 250_000_000)
        found = await buffer.lookup_transform_async("map", "camera", stamp, timeout=timeout)
        place = found.transform.translation
        places.append((place.x, place.y, place.z))
        print(f"  {i * 0.25:4.2f} s   x {place.x:6.3f}   y {place.y:6.3f}   z {place.z:6.3f} m")
    expect(len(set(places)) == LOOKUPS, "the lookups changed")
    for x, y, z in places:
        away = math.dist((x, y), (ODOM_X_M, 0.0))
        expect(abs(away - math.hypot(RADIUS_M, CAMERA[0])) < 0.1, f"the camera is on its circle ({away} m)")
        expect(abs(z - CAMERA[2]) < 1e-9, f"the camera is as high as it is mounted ({z} m)")

    show_point(node, buffer, begin)
    await show_future(node, buffer, timeout)
    show_failure(node, buffer)


def show_point(node, buffer, stamp):
    """A point transformed from one frame into another."""
    from geometry_msgs.msg import PointStamped

    seen = PointStamped()
    seen.header.frame_id = "camera"
    seen.header.stamp = stamp.to_msg()
    seen.point.x = 1.0
    transformed = buffer.transform(seen, "map")
    point, camera = transformed.point, buffer.lookup_transform("map", "camera", stamp).transform.translation
    print("\nA point that the camera sees 1 m ahead:")
    print(f"  in camera   x {seen.point.x:6.3f}   y {seen.point.y:6.3f}   z {seen.point.z:6.3f} m")
    print(f"  in map      x {point.x:6.3f}   y {point.y:6.3f}   z {point.z:6.3f} m")
    expect(transformed.header.frame_id == "map", "the point is in the map")
    distance = math.dist((point.x, point.y, point.z), (camera.x, camera.y, camera.z))
    expect(abs(distance - 1.0) < 1e-6, f"it is 1 m from the camera ({distance} m)")


async def show_future(node, buffer, timeout):
    """Wait for a transform one second in the future."""
    from rclpy.duration import Duration

    print("\nA transform one second in the future:")
    begin = time.monotonic()
    stamp = node.get_clock().now() + Duration(seconds=1)
    expect(not buffer.can_transform("map", "base_link", stamp), "it is not available yet")
    found = await buffer.lookup_transform_async("map", "base_link", stamp, timeout=timeout)
    waited = time.monotonic() - begin
    place = found.transform.translation
    print(f"  arrived after {waited:.3f} s   x {place.x:6.3f}   y {place.y:6.3f} m")
    expect(waited > 0.9, "it was awaited")


def show_failure(node, buffer):
    """A lookup that must fail."""
    from rclpy.duration import Duration

    from tf2_ros import ExtrapolationException

    print("\nA lookup one minute ahead of the data fails:")
    try:
        buffer.lookup_transform("map", "camera", node.get_clock().now() + Duration(seconds=60))
    except ExtrapolationException as error:
        print(f"  {type(error).__name__}: {error}")
        expect("extrapolation into the future" in str(error), "the error says why")
    else:
        expect(False, "the lookup failed")


def expect(happened, what):
    """End the demonstration if a check failed."""
    if not happened:
        raise SystemExit(f"Check failed: {what}.")


def claim_domain():
    """A ROS domain that nothing else on this machine uses, and the socket that claims it."""
    for domain in range(1, 102):
        first = 7400 + 250 * domain  # the port on which all nodes of a domain listen
        claim, probe = (socket.socket(type=socket.SOCK_DGRAM) for _ in range(2))
        try:
            claim.bind(("127.0.0.1", first + 249))  # too high for a node
            probe.bind(("", first))
        except OSError:
            claim.close()
        else:
            return domain, claim
        finally:
            probe.close()
    raise SystemExit("every ROS domain is in use")


def main():
    """Start both processes; return the exit status of the second."""
    begin = time.monotonic()
    domain, _claim = claim_domain()
    os.environ.update(
        ROS_DOMAIN_ID=str(domain), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST", PYTHONUNBUFFERED="1"
    )
    os.environ.pop("ROS_LOCALHOST_ONLY", None)  # it would override the line before
    command = [sys.executable, str(Path(__file__).resolve())]
    # In separate sessions, so that Ctrl-C reaches only this process, which then ends the other two.
    broadcaster = subprocess.Popen([*command, "broadcast"], start_new_session=True)
    listener = subprocess.Popen([*command, "listen"], start_new_session=True)
    print(
        f"Broadcaster (process {broadcaster.pid}) and listener ({listener.pid}) are on ROS domain {domain}.",
        flush=True,
    )
    try:
        status = listener.wait(timeout=LIMIT_S)
        expect(broadcaster.poll() is None, "the broadcaster ran to the end")
    except subprocess.TimeoutExpired:
        raise SystemExit(f"The listener did not end within {LIMIT_S} s.") from None
    finally:
        end(listener)
        end(broadcaster)
    print(f"\n{'Everything succeeded' if status == 0 else 'It failed'}, in {time.monotonic() - begin:.1f} s.")
    return status


def end(process):
    process.terminate()
    try:
        process.wait(timeout=1.0)
    except subprocess.TimeoutExpired:
        process.kill()


if __name__ == "__main__":
    roles = {"broadcast": broadcast, "listen": listen}
    try:
        sys.exit(roles[sys.argv[1]]() if len(sys.argv) > 1 else main())
    except KeyboardInterrupt:
        sys.exit(130)
