"""Run a tf2_buffer_server on a host; the end of its standard input interrupts it."""

import os
import signal
import sys
import threading

from tf2_ros_tools.programs.tf2_buffer_server import main


def interrupt_at_end() -> None:
    sys.stdin.read()
    os.kill(os.getpid(), signal.SIGINT)


if __name__ == "__main__":
    threading.Thread(target=interrupt_at_end, daemon=True).start()
    sys.exit(main())
