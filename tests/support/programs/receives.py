"""Receives until it is interrupted; prints when the receiver has ended by itself."""

import threading

import rclpy

from tf2_ros import Buffer, TransformListener


def main():
    rclpy.init()
    listener = TransformListener(Buffer(), rclpy.create_node("receiving"))
    try:
        print("receives" if listener.receives else "does not receive", flush=True)
        threading.Event().wait()
    except KeyboardInterrupt:
        while listener.receives:
            threading.Event().wait(0.005)
    print("ended", flush=True)


if __name__ == "__main__":
    main()
