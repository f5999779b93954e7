# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""`tf2_monitor --web`: the page that it serves, and the processes that it starts for tabs."""

import asyncio
import os
import signal
import socket
import subprocess
import sys
from contextlib import contextmanager, suppress
from http.client import HTTPException
from pathlib import Path
from urllib.error import HTTPError

import pytest
from processes import killed
from starting_programs import broadcasting, ended, free_port, running
from waiting import DEADLINE_S, until

pytest.importorskip("textual_serve")
pytest.importorskip("pyte")
pytest.importorskip("websockets")

from browsers import PlainTab, browser, needs_chromium, page_at
from websockets.exceptions import InvalidStatus

from tf2_ros_tools.common.optional_libraries import MissingLibraryError
from tf2_ros_tools.pictures import monitor_page
from tf2_ros_tools.programs import tf2_monitor


@pytest.fixture(scope="module", autouse=True)
def robot():
    with broadcasting() as process:
        yield process


@contextmanager
def served(*arguments, **popen):
    """The server, and the address of its page, for a `with` statement."""
    url = f"http://127.0.0.1:{free_port()}"
    with running("tf2_monitor", "--web", url.rpartition(":")[2], *arguments, **popen) as server:
        assert server.stdout.readline() == f"Serving at {url} until Ctrl-C\n"
        yield server, url


@pytest.fixture(scope="module")
def page():
    with served() as (server, url):
        yield server, url
        server.send_signal(signal.SIGINT)
        server.wait(DEADLINE_S)


def tabs_of(server):
    """The processes of its tabs."""
    return set(Path(f"/proc/{server.pid}/task/{server.pid}/children").read_text().split())


def have_ended(processes):
    """Whether none of these is left, but for those whose parent has not noticed their ends."""

    def has_ended(one):
        try:
            return Path(f"/proc/{one}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
        except OSError:
            return True

    return all(map(has_ended, processes))


def has_table(lines):
    return any(line.startswith(" base_link ") for line in lines)


def order(lines):
    """The frames of the robot, in the order of the rows."""
    return [line.split()[0] for line in lines if line.startswith((" base_link", " camera", " odom"))]


def test_the_table_appears_and_keys_sort_and_filter_it(page):
    with PlainTab(page[1]) as tab:
        tab.shows(has_table)
        for key, wanted in (("n", ["base_link", "camera", "odom"]), ("/ODO", ["base_link", "odom"])):
            tab.press(key)
            tab.shows(lambda lines, wanted=wanted: order(lines) == wanted)


def test_each_tab_has_a_process_that_ends_with_it(page):
    server, url = page
    until(lambda: not tabs_of(server))
    with PlainTab(url) as one:
        one.shows(has_table)
        first = tabs_of(server)
        with PlainTab(url) as other:
            other.shows(has_table)
            second = tabs_of(server) - first
        assert (len(first), len(second)) == (1, 1)
        until(lambda: have_ended(second))
        one.press("n")
        one.shows(lambda lines: ", by name" in lines[0])
    until(lambda: have_ended(first))


def test_a_tab_that_is_resized_and_closed_at_once_leaves_no_process(page):
    server, url = page
    until(lambda: not tabs_of(server))
    with PlainTab(url) as tab:
        tab.tell("resize", {"width": 81, "height": 25})
        processes = until(lambda: tabs_of(server))
    until(lambda: have_ended(processes))


def test_a_page_of_another_site_is_refused(page):
    [_, url] = page
    with pytest.raises(InvalidStatus, match="HTTP 403"), PlainTab(url, origin="http://example.org"):
        pass


@pytest.mark.parametrize("host", ["192.168.1.7:9000", "localhost:9000", "LOCALHOST", "[fd00::1]:9000"])
def test_a_page_is_the_same_by_any_address(page, host):
    [_, url] = page
    there = page_at(url, Host=host)
    assert f'src="http://{host}/static/js/textual.js"' in there
    assert f'data-session-websocket-url="ws://{host}/ws"' in there
    assert "<title>tf2_monitor</title>" in there


OTHER_NAMES = ["evil.example", "127.0.0.1.evil.example", "localhost.evil.example", "[::1", ""]


@pytest.mark.parametrize("name", [*OTHER_NAMES, socket.gethostname()])
def test_a_site_whose_name_leads_to_this_machine_is_refused(page, name):
    [_, url] = page
    headers = {"Host": f"{name}:9000", "Origin": f"http://{name}:9000"}
    said = "is not a known name of this machine: use its IP address or localhost, or start tf2_monitor with"
    for path in ("/", "/ws"):
        with pytest.raises(HTTPError) as refused:
            page_at(url + path, **headers)
        with refused.value as answer:
            text = answer.read().decode()
        assert (refused.value.code, text) == (403, f"{name}:9000 {said} --web NAME:PORT")


@pytest.mark.parametrize("is_loopback", [True, False])
def test_names_that_are_served(is_loopback):
    names = monitor_page._Names("Robot.Example", is_loopback)
    host = socket.gethostname()
    assert is_loopback or asyncio.run(names.include(socket.getfqdn()))
    for name, served in (
        *(
            (given, True)
            for given in ("robot.example", "ROBOT.example.:9000", "localhost:1", "1.2.3.4", "[::1]:1")
        ),
        *((own, not is_loopback) for own in (host, f"{host}.local:9000")),
        *((other, False) for other in OTHER_NAMES),
    ):
        assert asyncio.run(names.include(name)) == served, name


def test_what_is_not_for_it_is_one_line_at_most():
    with served() as (server, url):
        host, port = url.removeprefix("http://").split(":")
        web_socket = f"GET /ws HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n\r\n".encode()
        for request in (b"\x16\x03\x01 TLS\r\n\r\n", b"GET / HTTP/1.1\r\n\r\n", web_socket):
            with socket.create_connection((host, port)) as connection:
                connection.sendall(request)
                assert b" 400 Bad Request" in connection.recv(1000)
        with PlainTab(url) as tab:
            until(lambda: tabs_of(server))
            tab.tell("resize", {})
            until(lambda: not tabs_of(server))
        server.send_signal(signal.SIGINT)
        _, err = server.communicate(timeout=DEADLINE_S)
    lines = err.splitlines()
    assert lines[-1] == "A request was not served: KeyError('width')"
    assert all(line.startswith("A request was not served: ") for line in lines)


def test_a_tab_that_is_closed_while_it_starts_ends_without_starting(page):
    server, url = page
    until(lambda: not tabs_of(server))
    with PlainTab(url):
        [process] = until(lambda: tabs_of(server))
        os.kill(int(process), signal.SIGSTOP)  # it cannot start
    with suppress(ProcessLookupError):  # it may have ended
        os.kill(int(process), signal.SIGCONT)
    until(lambda: have_ended([process]))


@pytest.mark.parametrize(
    ("number", "times"), [(signal.SIGINT, 3), (signal.SIGTERM, 1), (signal.SIGKILL, 1)], ids=str
)
def test_the_end_of_the_server_ends_all_tabs(number, times):
    with served() as (server, url), PlainTab(url) as one, PlainTab(url) as other:
        one.shows(has_table)
        other.shows(has_table)
        tabs = tabs_of(server)
        for _ in range(times):
            server.send_signal(number)
        _, err = server.communicate(timeout=DEADLINE_S)
        until(lambda: have_ended(tabs))
    assert (server.returncode, err) == (-number if number == signal.SIGKILL else 0, "")


IS_INTERRUPTED_IN_A_REQUEST = """
import os, signal, sys
from tf2_ros_tools.common.options import Parser
from tf2_ros_tools.common.program import run
from tf2_ros_tools.pictures.monitor_page import serve

class Title(str):
    def replace(self, *parts):  # by the page, which escapes it
        os.kill(os.getpid(), int(sys.argv[2]))
        return super().replace(*parts)

def work(_):
    serve("127.0.0.1", int(sys.argv[1]), "false", Title("robot"))

sys.exit(run(Parser(prog="serves", description="", example=""), work, ["serves"], interrupted=0))
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_during_a_request_ends_the_server_in_silence(number):
    port = free_port()
    words = [sys.executable, "-c", IS_INTERRUPTED_IN_A_REQUEST, str(port), str(int(number))]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(words, **pipes) as server, killed(server):
        server.stdout.readline()
        with suppress(OSError, HTTPException):
            page_at(f"http://127.0.0.1:{port}")
        _, err = server.communicate(timeout=DEADLINE_S)
    assert (server.returncode, err) == (0, "")


def test_what_c_code_prints_does_not_disturb_the_screen(peer):
    to_stdout = {"RCUTILS_LOGGING_USE_STDOUT": "1", "RCUTILS_LOGGING_BUFFERED_STREAM": "0"}
    environment = os.environ | to_stdout
    with served(env=environment) as (_, url), PlainTab(url) as tab:
        talker = peer()

        def is_refused(lines):
            talker.send(("base_link", "broken", 1, float("nan")))
            return any("transforms of broken" in line for line in lines)

        tab.shows(has_table)  # from here on, log lines are kept
        tab.shows(is_refused)
        tab.press("n")
        tab.shows(lambda lines: ", by name" in lines[0])


def test_frames_are_chosen_as_on_a_terminal():
    with served("map", "camera") as (_, url), PlainTab(url) as tab:
        tab.shows(lambda lines: lines[0].startswith(" map -> odom -> base_link -> camera: net delay "))
        assert "<div>tf2_monitor map camera</div>" in page_at(url)


def test_a_warning_says_who_sees_the_robot():
    port = free_port()
    with running("tf2_monitor", "--web", f"0.0.0.0:{port}") as server:
        assert server.stdout.readline() == f"Serving at http://{socket.gethostname()}:{port} until Ctrl-C\n"
        said = "Everybody who reaches this address can see the robot's frames: there is no password.\n"
        assert server.stdout.readline() == said
        with PlainTab(f"http://127.0.0.1:{port}") as tab:
            tab.shows(has_table)


@pytest.mark.parametrize("given", ["", "x", "0", "65536", "robot", "robot:", "robot:-1", "127.0.0.1"])
def test_a_wrong_address_is_wrong_usage(given):
    status, out, err = ended("tf2_monitor", "--web", given)
    said = f"argument --web: expected a port from 1 to 65535, or HOST:PORT, got '{given}'"
    assert (status, out, err) == (2, "", f"tf2_monitor: {said} (see tf2_monitor --help)\n")


@pytest.mark.parametrize("other", ["--json", "--interval=1"])
def test_reports_are_not_for_a_browser(other):
    status, _, err = ended("tf2_monitor", "--web", "8000", other)
    said = "--web cannot be combined with --json or --interval"
    assert (status, err) == (2, f"tf2_monitor: {said} (see tf2_monitor --help)\n")


def test_a_port_in_use_is_reported():
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        status, out, err = ended("tf2_monitor", "--web", str(port))
    said = f"cannot serve at 127.0.0.1:{port}: Address already in use"
    assert (status, out, err) == (1, "", f"tf2_monitor: {said}\n")


def test_a_host_that_is_not_this_machine_is_reported():
    status, out, err = ended("tf2_monitor", "--web", "robot.invalid:8000")
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert err.startswith("tf2_monitor: cannot serve at robot.invalid:8000: ")


def test_a_robot_that_is_not_there_is_reported_before_it_serves():
    robot = f"ws://127.0.0.1:{free_port()}"
    status, out, err = ended("tf2_monitor", "--web", str(free_port()), "--live", robot)
    assert (status, out, err.count("\n")) == (1, "", 1) and robot in err


def test_a_library_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "textual_serve", None)
    options = tf2_monitor.PARSER.read(["tf2_monitor", "--web", "8000"])
    with pytest.raises(MissingLibraryError, match=r"pip install 'tf2-ros-tools\[web\]'"):
        tf2_monitor.monitor(options)


@needs_chromium
def test_chromium_shows_the_table_on_a_network_that_does_not_answer(tmp_path):
    with served() as (server, url), browser(tmp_path) as chromium:
        first, second = chromium.open(url), chromium.open(url)
        for tab in (first, second):
            tab.shows(has_table)
        second.press("n")
        second.shows(lambda lines: ", by name" in lines[0])
        assert ", by trouble" in first.lines[0]
        tabs = tabs_of(server)
        assert len(tabs) == 2
        server.send_signal(signal.SIGINT)
        _, err = server.communicate(timeout=DEADLINE_S)
        for tab in (first, second):
            until(lambda tab=tab: tab.value("document.querySelector('.closed-dialog').checkVisibility()"))
        assert (server.returncode, err, have_ended(tabs)) == (0, "", True)
