"""
Shares a buffer, whose name is the first argument, and says so; then obeys its standard input:

`insert NS FIRST_NS`: the links of `shared_buffers.py` of this time. `run S`: insert for so long, as fast
as it can, in a thread. `fork`: have a child that ends with the standard input.

With `children` for a name, each line is the name of a buffer, for which it forks an owner, which inserts as
fast as it can; the next line has it killed.
"""

import os
import signal
import sys
import threading
import time

from making_objects import S
from rclpy.duration import Duration
from shared_buffers import links

from tf2_ros import Buffer

FIRST_NS = 1000 * S


def run(buffer, seconds):
    ns, count, end = FIRST_NS, 0, time.monotonic() + seconds
    while time.monotonic() < end:
        ns += S // 1000
        count += 1
        buffer.set_transforms(links(ns, FIRST_NS), "shares")
        if count % 97 == 0:
            # Late, in the middle of the history.
            buffer.set_transforms(links(ns - S // 4 + 1, FIRST_NS), "shares")


def children():
    for line in sys.stdin:
        ready, is_ready = os.pipe()
        child = os.fork()
        if child == 0:
            buffer = Buffer(Duration(seconds=0.5), share=line.strip())
            buffer.set_transforms(links(FIRST_NS, FIRST_NS), "shares")
            os.write(is_ready, b"x")
            run(buffer, 20.0)
            os._exit(0)
        os.read(ready, 1)
        os.close(ready)
        os.close(is_ready)
        print(child, flush=True)
        sys.stdin.readline()
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


def main():
    if sys.argv[1] == "children":
        print("ready", flush=True)
        children()
        return
    buffer = Buffer(Duration(seconds=0.5), share=sys.argv[1])
    print("shared", os.getpid(), flush=True)
    for line in sys.stdin:
        match line.split():
            case ["insert", ns, first_ns]:
                buffer.set_transforms(links(int(ns), int(first_ns)), "shares")
            case ["run", seconds]:
                threading.Thread(target=run, args=(buffer, float(seconds)), daemon=True).start()
            case ["fork"]:
                if os.fork() == 0:
                    sys.stdin.read()
                    os._exit(0)
        print("done", time.monotonic_ns(), flush=True)


main()
