"""Looks up through a buffer client what its standard input orders, line by line, and prints each outcome."""

import json
import sys
import time

import rclpy
from rclpy.duration import Duration
from rclpy.time import Time

from tf2_ros import BufferClient, TransformException


def look_up(client, target, source, ns, timeout):
    began = time.monotonic()
    try:
        found = client.lookup_transform(target, source, Time(nanoseconds=ns), Duration(seconds=timeout))
    except TransformException as error:
        answer = {"error": type(error).__name__, "text": str(error)}
    else:
        answer = {"child": found.child_frame_id, "x": found.transform.translation.x}
    return {**answer, "took": time.monotonic() - began}


def main():
    rclpy.init(args=sys.argv)
    client = BufferClient(rclpy.create_node("lookup_client"), sys.argv[1])
    for line in sys.stdin:
        print(json.dumps(look_up(client, **json.loads(line))), flush=True)
    client.destroy()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
