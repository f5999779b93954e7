# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Tabs in which tests look at a page with a terminal, such as that of `tf2_monitor --web`.

`PlainTab` does what the page's script does, without a browser. `Browser` is a headless Chromium, which is
steered over its DevTools protocol.
"""

import itertools
import json
import re
import shutil
import socket
import subprocess
import time
import urllib.request
from base64 import b64decode
from contextlib import ExitStack, contextmanager

import pyte
import pytest
from processes import killed
from waiting import DEADLINE_S, until
from websockets.sync.client import connect

SESSION = re.compile(r'data-session-websocket-url="([^"]+)"')


def page_at(url, **headers):
    """The source of a page."""
    with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=DEADLINE_S) as answer:
        return answer.read().decode()


class PlainTab:
    """For a `with` statement."""

    def __init__(self, url, origin=None, columns=80, rows=24):
        [address] = SESSION.findall(page_at(url))
        self._screen = pyte.Screen(columns, rows)
        self._stream = pyte.ByteStream(self._screen)
        self._connecting = connect(f"{address}?width={columns}&height={rows}", origin=origin or url)

    def __enter__(self):
        self._connection = self._connecting.__enter__()
        return self

    def __exit__(self, *error):
        self._connecting.__exit__(*error)

    @property
    def lines(self):
        return [line.rstrip() for line in self._screen.display]

    def tell(self, *message):
        self._connection.send(json.dumps(message))

    def press(self, keys):
        self.tell("stdin", keys)

    def shows(self, condition):
        """Wait until the condition holds for the lines of the terminal; its value."""
        deadline = time.monotonic() + DEADLINE_S
        while not (value := condition(self.lines)):
            assert time.monotonic() < deadline, "never so; the screen is\n" + "\n".join(self.lines)
            try:
                self._stream.feed(self._connection.recv(0.1))
            except TimeoutError:
                continue
        return value


CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
# xterm.js draws on a canvas, and nothing refers to its terminal but an object of the page.
NOTE_TERMINAL = """
Object.defineProperty(Object.prototype, "terminal", {set(value) {
    window.noted = value;
    Object.defineProperty(this, "terminal", {value, writable: true});
}});
"""
LINES = """
Array.from({length: noted.rows}, (_, row) =>
    noted.buffer.active.getLine(noted.buffer.active.viewportY + row).translateToString(true))
"""


def needs_chromium(test):
    """Mark a test that needs Chromium, which `make test-all` installs as root, where apt-get is."""
    is_missing = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
    return pytest.mark.long("needs Chromium")(is_missing(test))


@contextmanager
def browser(folder):
    """
    Run a Chromium, which reaches this machine only: other hosts accept connections and never answer.

    :param folder: for its profile.
    """
    with ExitStack() as ends:
        silent = ends.enter_context(socket.create_server(("127.0.0.1", 0)))
        options = [
            *("--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--window-size=1000,500"),
            *("--remote-debugging-port=0", "--remote-allow-origins=*", f"--user-data-dir={folder}"),
            f"--host-resolver-rules=MAP * 127.0.0.1:{silent.getsockname()[1]}, EXCLUDE 127.0.0.1",
        ]
        process = subprocess.Popen([CHROMIUM, *options, "about:blank"], stderr=subprocess.PIPE, text=True)
        ends.enter_context(killed(process))
        address = until(lambda: process.stderr.readline().partition("DevTools listening on ws://")[2])
        yield Browser(address.partition("/")[0], ends)


class Browser:
    def __init__(self, address, ends):
        self._address, self._ends = address, ends

    def open(self, url):
        """Open a page in a new tab."""
        request = urllib.request.Request(f"http://{self._address}/json/new?about:blank", method="PUT")
        with urllib.request.urlopen(request, timeout=DEADLINE_S) as answer:
            target = json.load(answer)["webSocketDebuggerUrl"]
        tab = Tab(self._ends.enter_context(connect(target, max_size=None)))
        tab.tell("Page.enable")
        tab.tell("Page.addScriptToEvaluateOnNewDocument", source=NOTE_TERMINAL)
        tab.tell("Page.navigate", url=url)
        return tab


class Tab:
    """A tab with a terminal."""

    def __init__(self, connection):
        self._connection, self._numbers = connection, itertools.count()

    def tell(self, method, **parameters):
        """Call a method of the protocol; its result."""
        number = next(self._numbers)
        self._connection.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self._connection.recv(DEADLINE_S))
            if answer.get("id") == number:
                return answer["result"]

    def value(self, expression):
        """What a JavaScript expression is; None: it has raised."""
        return self.tell("Runtime.evaluate", expression=expression, returnByValue=True)["result"].get("value")

    @property
    def lines(self):
        return self.value(LINES) or []

    def shows(self, condition):
        """Wait until the condition holds for the lines of the terminal; its value."""
        return until(lambda: condition(self.lines))

    def press(self, keys):
        for key in keys:
            self.tell("Input.dispatchKeyEvent", type="keyDown", key=key, text=key)
            self.tell("Input.dispatchKeyEvent", type="keyUp", key=key)

    def picture(self):
        """A PNG of the page."""
        return b64decode(self.tell("Page.captureScreenshot")["data"])
