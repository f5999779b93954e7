"""Lose packets: relay between tap devices on two hosts, and drop some."""

import ctypes
import fcntl
import json
import os
import random
import selectors
import struct
import sys

TUNSETIFF = 0x400454CA
IFF_TAP, IFF_NO_PI = 0x0002, 0x1000
CLONE_NEWNET = 0x40000000
LARGEST_FRAME = 65536


def tap(pid: str, name: str) -> int:
    """Make a tap device in the network namespace of a process; this one stays there."""
    libc = ctypes.CDLL(None, use_errno=True)
    with open(f"/proc/{pid}/ns/net") as namespace:
        if libc.setns(namespace.fileno(), CLONE_NEWNET):
            raise OSError(ctypes.get_errno(), "setns")
    device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(device, TUNSETIFF, struct.pack("16sH22x", name.encode(), IFF_TAP | IFF_NO_PI))
    return device


def relay(loss: float, seed: str, name: str, pids: list[str]) -> None:
    """Relay until standard input ends; each line of it asks how many packets were lost, and how many sent."""
    one, other = (tap(pid, name) for pid in pids)
    chance = random.Random(seed)
    lost = sent = 0
    selector = selectors.DefaultSelector()
    selector.register(one, selectors.EVENT_READ, other)
    selector.register(other, selectors.EVENT_READ, one)
    selector.register(sys.stdin, selectors.EVENT_READ)
    print(json.dumps({"answer": "ready"}), flush=True)
    while True:
        for key, _ in selector.select():
            if key.data is None:
                if not sys.stdin.readline():
                    return
                print(json.dumps({"answer": [lost, sent]}), flush=True)
                continue
            frame = os.read(key.fd, LARGEST_FRAME)
            sent += 1
            try:
                if chance.random() >= loss:
                    os.write(key.data, frame)
                    continue
            except OSError:
                # The other end is not up yet, or its queue is full: lost, as on a wire.
                lost += 1
                continue
            lost += 1


if __name__ == "__main__":
    relay(float(sys.argv[1]), sys.argv[2], sys.argv[3], sys.argv[4:])
