# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A web server and a ROS node in one asyncio loop: poses as JSON, and 503 while a pose is missing or too old.

Run: pip install aiohttp
     ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ROS_DOMAIN_ID=42 python examples/web_server.py
Without the variables (on Humble, ROS_LOCALHOST_ONLY=1 and a domain), it would publish to your whole network.
A simulated robot drives, and loses its localization after a while; the program asks its own server meanwhile.
Ends by itself. The exit status is 0 only if each answer has the expected status.
With a port, as in python examples/web_server.py 8080, it serves the transforms of a real robot until Ctrl-C.
"""

import asyncio
import contextlib
import json
import sys

import rclpy
from aiohttp import ClientSession, web
from geometry_msgs.msg import TransformStamped
from rclpy.signals import SignalHandlerOptions
from rclpy.time import Time

from tf2_ros import Buffer, TransformBroadcaster, TransformException, TransformListener

TARGET, SOURCE = "map", "base_link"
# How old the newest transform of each moving frame may be, in seconds: a localizer sends odom in map twice a
# second, the wheels send base_link in odom 50 times a second.
LIMITS_S = {"odom": 1.0, "base_link": 0.2}
AWAIT_S = 1.0  # for the pose at a time
LIMIT_S = 60.0  # of the demonstration

BUFFER = web.AppKey("buffer", Buffer)


def as_json(transform):
    t, q, stamp = transform.transform.translation, transform.transform.rotation, transform.header.stamp
    return {
        "stamp_ns": Time.from_msg(stamp).nanoseconds,
        "xyz": [t.x, t.y, t.z],
        "xyzw": [q.x, q.y, q.z, q.w],
    }


@web.middleware
async def unavailable(request, handler):
    """Answer 503, with the reason, where a transform is missing or too old."""
    try:
        return await handler(request)
    except TransformException as error:
        return web.json_response({"error": str(error)}, status=503)


async def pose(request):
    """The latest pose, if none of its frames is too old. This lookup does not block the loop."""
    found = request.app[BUFFER].lookup_transform(TARGET, SOURCE, Time(), max_age=LIMITS_S)
    return web.json_response(as_json(found))


async def pose_at(request):
    """The pose at a time, which may still arrive."""
    time_ns = int(request.match_info["time_ns"])
    found = await request.app[BUFFER].lookup_transform_async(TARGET, SOURCE, time_ns, timeout=AWAIT_S)
    return web.json_response(as_json(found))


async def follow(request):
    """Each new pose, as server-sent events, until the browser or the server ends."""
    response = web.StreamResponse(headers={"Content-Type": "text/event-stream"})
    await response.prepare(request)
    with contextlib.suppress(ConnectionResetError):  # the browser has gone
        async for found in request.app[BUFFER].changes(TARGET, SOURCE):
            await response.write(f"data: {json.dumps(as_json(found))}\n\n".encode())
    return response


async def health(request):
    """How old the newest data of each moving frame is."""
    ages = request.app[BUFFER].ages(TARGET, SOURCE)
    is_stale = any(ages.get(name, 0.0) > limit for name, limit in LIMITS_S.items())
    return web.json_response({"ages_s": ages}, status=503 if is_stale else 200)


async def beside_ros(app):
    """From the start of the server to its end. Nothing has to spin the node: a listener receives without."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # the server handles signals
    node = rclpy.create_node("web_server")
    app[BUFFER] = Buffer(node=node)
    with TransformListener(app[BUFFER], node):
        yield
    node.destroy_node()


async def end_ros(app):
    """Before the server waits for its requests, because this ends awaits and streams of changes."""
    rclpy.shutdown()


def make_app():
    app = web.Application(middlewares=[unavailable])
    app.add_routes(
        [
            web.get("/pose", pose),
            web.get("/pose/{time_ns}", pose_at),
            web.get("/follow", follow),
            web.get("/health", health),
        ]
    )
    app.cleanup_ctx.append(beside_ros)
    app.on_shutdown.append(end_ros)
    return app


# The demonstration: a robot, and a client.


class Robot:
    """Drives at 1 m/s. Its localizer can be switched off."""

    def __init__(self, node):
        self.clock, self.broadcaster, self.is_localised = node.get_clock(), TransformBroadcaster(node), True

    async def drive(self):
        for tick in range(int(LIMIT_S * 50)):
            if self.is_localised and tick % 25 == 0:
                self.send("map", "odom", 0.0)
            self.send("odom", "base_link", tick / 50)
            await asyncio.sleep(0.02)

    def send(self, parent, child, x):
        message = TransformStamped(child_frame_id=child)
        message.header.frame_id, message.header.stamp = parent, self.clock.now().to_msg()
        message.transform.translation.x = x
        self.broadcaster.sendTransform(message)


async def ask(client, path, expected, until=True):
    """The answer; with `until`, ask again until it has the status that is expected."""
    while True:
        async with client.get(path) as response:
            answer = await response.json()
            if response.status == expected or not until:
                print(f"{path:8} {response.status} {json.dumps(answer)[:90]}", flush=True)
                if response.status != expected:
                    raise SystemExit(f"{path}: expected {expected}")
                return answer
        await asyncio.sleep(0.05)


async def demonstrate(client, robot):
    await ask(client, "/pose", 503, until=False)
    driving = asyncio.create_task(robot.drive())
    try:
        await ask(client, "/pose", 200)
        await ask(client, "/health", 200)
        now_ns = robot.clock.now().nanoseconds
        await ask(client, f"/pose/{now_ns}", 200)
        async with client.get("/follow") as stream:
            for _ in range(3):
                print("/follow ", (await stream.content.readline()).decode().strip()[:90])
                await stream.content.readline()
        robot.is_localised = False
        await ask(client, "/health", 503)
        await ask(client, "/pose", 503)
    finally:
        driving.cancel()


async def main():
    runner = web.AppRunner(make_app())
    await runner.setup()
    site = web.TCPSite(runner, "127.0.0.1", 0)
    await site.start()
    try:
        robot = Robot(rclpy.create_node("robot"))
        async with ClientSession(f"http://127.0.0.1:{runner.addresses[0][1]}") as client:
            await asyncio.wait_for(demonstrate(client, robot), LIMIT_S)
    finally:
        await runner.cleanup()


if __name__ == "__main__":
    if len(sys.argv) > 1:
        web.run_app(make_app(), port=int(sys.argv[1]))
    else:
        try:
            asyncio.run(main())
        except KeyboardInterrupt:
            raise SystemExit(130) from None
