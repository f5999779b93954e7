"""
A program of this project that watches transforms, and what it costs. Its arguments: the name of the program
and the program's own arguments; before them `live` for one whose output is a terminal.
"""

import os
import pty
import subprocess
import sys
import threading

from serving import serve

SETTLED_S = 0.2
END_S = 10.0


class Watching:
    def __init__(self, arguments):
        self._terminal = None
        live = arguments[0] == "live"
        name, *rest = arguments[live:]
        output = subprocess.DEVNULL
        if live:
            self._terminal, output = pty.openpty()
            threading.Thread(target=self._read, daemon=True).start()
        self._program = subprocess.Popen([sys.executable, "-m", f"tf2_ros.cli.{name}", *rest], stdout=output)

    def _read(self):
        # As a terminal does: a full one would stop the program.
        while os.read(self._terminal, 1 << 16):
            continue

    def end(self):
        self._program.terminate()
        self._program.wait(END_S)

    def order_cost(self):
        """ns of CPU of the program since its start."""
        cpu_ns = 0
        tasks = f"/proc/{self._program.pid}/task"
        for task in os.listdir(tasks):
            with open(f"{tasks}/{task}/schedstat") as stat:
                cpu_ns += int(stat.read().split()[0])
        return {"cpu_ns": cpu_ns, "threads": {}}

    def order_arrived(self, number):
        """Wait until message `number` must have arrived; nothing shows that here."""
        threading.Event().wait(SETTLED_S)
        return {"arrived": self._program.poll() is None}


if __name__ == "__main__":
    watching = Watching(sys.argv[1:])
    serve(watching, watching.end)
