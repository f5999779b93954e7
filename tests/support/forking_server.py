# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Starts processes of a Python program in a tenth of the time: it has imported what they need, and forks itself.

`forking_server.py SOCKET PROGRAM MODULE ...`: imports the modules, and what the program imports. Each message
on the socket has the arguments of a process, in JSON, and the descriptors of its standard input, output and
errors; its id is sent back. The end of the connection ends the server. `processes.Forked` is the client.
"""

import atexit
import importlib
import json
import os
import runpy
import signal
import socket
import sys

LONGEST = 65536  # bytes of a message


def end():
    """Exit without C's handlers of that: those of LTTng, which rclpy loads, cancel threads of others."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)


def main(connection, program, *modules):
    atexit.register(end)  # as the first one, which is called last
    sys.path[0] = os.path.dirname(program)
    for name in modules:
        importlib.import_module(name)
    runpy.run_path(program)
    server = socket.socket(fileno=int(connection))
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody asks how they end
    while True:
        arguments, descriptors, *_ = socket.recv_fds(server, LONGEST, 3)
        if not arguments:
            return
        process = os.fork()
        if process == 0:
            break
        for one in descriptors:
            os.close(one)
        server.send(str(process).encode())
    server.close()
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    for number, one in enumerate(descriptors):
        os.dup2(one, number)
        os.close(one)
    sys.argv = [program, *json.loads(arguments)]
    runpy.run_path(program, run_name="__main__")


main(*sys.argv[1:])
