"""
Receives messages while each allocation of the draining thread fails, alone and with all that follow.

Run with `interposed/allocations.c` loaded. A wait has that thread insert each message when it arrives. After
each failure the buffer is checked, what it has of the message is right, and the message, sent again,
completes the rest and what waits for it. Prints a line of JSON for each failure: which it was, and how many
transforms of the message were not in the buffer.
"""

import ctypes
import json
import sys
import threading
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import rclpy
from making import S
from processes import Peer, until
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter

from tf2_ros import Buffer, TransformListener

NOBODY, ENGINE = 0, 1
MOST = 200  # allocations for one message
TRANSFORMS = 6


def variable(name, kind=ctypes.c_long):
    return kind.in_dll(ctypes.CDLL(None), name)


def receiver_thread():
    for thread in threading.enumerate():
        if thread.name == "tf2_ros receiver":
            return thread.ident
    return None


class Reception:
    def __init__(self, peer):
        self.peer = peer
        self.node = rclpy.create_node(
            "receiving", parameter_overrides=[Parameter("use_sim_time", value=True)]
        )
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.buffer = Buffer(Duration(seconds=10_000), self.node)
        self.listener = TransformListener(self.buffer, self.node)
        self.round = 0
        # Repeated, as rclpy subscribes to the clock with best effort.
        until(lambda: peer.set_clock(5) or self.node.get_clock().now().nanoseconds == 5 * S, self.executor)
        self.receive()
        ctypes.CDLL(None).find_ours()
        variable("counted_thread", ctypes.c_ulong).value = until(receiver_thread)

    def receive(self):
        """Have a message received; nothing of it is new but the stamp."""
        self.round += 1

        def received():
            self.peer.send(("map", "base", self.round * S, self.round))
            return self.buffer.can_transform("map", "base", self.round * S)

        until(received, self.executor)

    def fail(self, first, last):
        """Let allocations fail during the next message; what came of it, None if there are not so many."""
        self.round += 1
        stamp = self.round * S
        names = [f"{self.round}_{index}" for index in range(TRANSFORMS)]
        message = [("map", name, stamp, index) for index, name in enumerate(names)]
        waiting = self.buffer.wait_for_transform_async("map", names[-1], stamp)
        variable("counted").value = variable("failed").value = 0
        variable("first_to_fail").value, variable("last_to_fail").value = first, last
        variable("counted_of").value = ENGINE
        self.peer.send(*message)
        # Without a read or a round of an executor, in which this thread would insert the message.
        until(lambda: variable("failed").value or waiting.done())
        if last > first:
            variable("counted_of").value = NOBODY
        self.receive()
        variable("counted_of").value = NOBODY
        if not variable("failed").value:
            return None
        self.buffer._self_check()
        missing = [name for name in names if not self.is_known(name)]
        for index, name in enumerate(names):
            if name not in missing:
                found = self.buffer.lookup_transform("map", name, 0)
                assert found.transform.translation.x == index, found
        if missing:
            # Sent again, it is complete.
            self.peer.send(*message)
            until(lambda: all(map(self.is_known, names)), self.executor)
        until(waiting.done, self.executor)
        waiting.result()
        return {"first": first, "last": last, "missing": len(missing)}

    def is_known(self, name):
        return self.buffer.can_transform("map", name, 0)


def main():
    rclpy.init()
    peer = Peer()
    try:
        reception = Reception(peer)
        for all_that_follow in (False, True):
            for n in range(1, MOST):
                found = reception.fail(n, 10**9 if all_that_follow else n)
                if found is None:
                    break
                print(json.dumps(found), flush=True)
    finally:
        peer.end()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
