# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Serve the screen of tf2_monitor to web browsers; each tab runs its own process."""

import asyncio
import html
import ipaddress
import logging
import os
import signal
import socket
from contextlib import suppress
from typing import cast
from urllib.parse import urlsplit
from weakref import WeakSet

from aiohttp import web
from aiohttp.typedefs import Handler
from textual_serve.app_service import AppService
from textual_serve.server import Server

from tf2_py.printable import printable
from tf2_ros_tools.common.output import show
from tf2_ros_tools.common.program import RunError

# The page asks another host for its font. On a network that does not answer, it would stay empty meanwhile.
OWN_STYLES = "style-src 'self' 'unsafe-inline'"
# Without it, keys would have no effect before the first click.
TAKE_KEYS = """<script>addEventListener("load", () => document.querySelector("textarea").focus())</script>"""


def serve(host: str, port: int, command: str, title: str) -> None:
    """
    Serve until interrupted.

    :param host: a name or an address of this machine.
    :param command: for a shell; shows a Textual program, and is run for each tab.
    :param title: what the page shows until the program has started.
    :raises RunError: this machine cannot serve there.
    """
    where = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listening = socket.create_server(address, family=family)
    except OSError as failure:
        why = failure.strerror if isinstance(failure, socket.gaierror) else os.strerror(failure.errno or 0)
        raise RunError(f"cannot serve at {where}: {why}") from None
    with listening:
        own = ipaddress.ip_address(listening.getsockname()[0])
        reached = f"{socket.gethostname()}:{port}" if own.is_unspecified else where
        show(f"Serving at http://{reached} until Ctrl-C")
        if not own.is_loopback:
            show("Everybody who reaches this address can see the robot's frames: there is no password.")
        # Of Server.serve(), which makes its socket itself, nobody would learn when it can be reached.
        app = _Page(command, title, _Names(host, own.is_loopback))._make_app()
        for name in ("aiohttp.server", "textual-serve"):
            logging.getLogger(name).addFilter(_shorten)
        web.run_app(app, sock=listening, handle_signals=False, print=None, access_log=None)


def _shorten(record: logging.LogRecord) -> bool:
    """Log in one line what a peer sent wrongly. A program that does not start says itself why."""
    error, record.exc_info = record.exc_info and record.exc_info[1], None
    record.msg, record.args = "A request was not served: %r", (error,)
    return error is not None


class _Names:
    """
    The names by which browsers may ask for the page, besides all IP addresses.

    A site can have its own name lead to this machine, so that browsers take the page for one of that site and
    let the site's scripts read it. It cannot have this machine's names.
    """

    def __init__(self, given: str, is_loopback: bool) -> None:
        self._is_loopback = is_loopback
        self._known = {"localhost", given.lower().rstrip(".")}
        if not is_loopback:
            name = socket.gethostname().lower()
            short = name.partition(".")[0]
            self._known |= {name, short, f"{short}.local"}

    async def include(self, host: str) -> bool:
        """Whether the value of a Host header, with any port, has one of them."""
        try:
            name = (urlsplit(f"//{host}").hostname or "").rstrip(".")
        except ValueError:
            return False
        try:
            ipaddress.ip_address(name)
        except ValueError:
            # The full name is looked up only where needed, because that may take seconds.
            return name in self._known or (
                not self._is_loopback and name == (await asyncio.to_thread(socket.getfqdn)).lower()
            )
        return True


class _Page(Server):
    """Serves browsers at any address by which they reach it, such as the end of an SSH tunnel."""

    def __init__(self, command: str, title: str, names: _Names) -> None:
        super().__init__(command, title=title)
        self._names = names
        self._tabs: WeakSet[asyncio.Task[web.WebSocketResponse]] = WeakSet()

    async def _make_app(self) -> web.Application:
        app = await super()._make_app()
        app.middlewares.append(self._require_own_name)
        return app

    async def on_startup(self, app: web.Application) -> None:
        """Let signals interrupt between requests, not in one, which would be reported. Print no banner."""
        loop = asyncio.get_running_loop()
        handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

        def interrupt(number: int) -> None:
            for one in handlers:
                loop.remove_signal_handler(one)
            for one, handler in handlers.items():
                signal.signal(one, handler)
            signal.raise_signal(number)

        for number in handlers:
            loop.add_signal_handler(number, interrupt, number)

    async def on_shutdown(self, app: web.Application) -> None:
        """End the processes of all tabs, for which aiohttp would wait for a minute."""
        for tab in self._tabs:
            tab.cancel()
        await asyncio.gather(*self._tabs, return_exceptions=True)

    @web.middleware
    async def _require_own_name(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if not await self._names.include(request.host):
            text = f"{printable(request.host)} is not a known name of this machine: use its IP address or "
            raise web.HTTPForbidden(text=f"{text}localhost, or start tf2_monitor with --web NAME:PORT")
        return await handler(request)

    async def handle_index(self, request: web.Request) -> web.Response:
        self.public_url = f"http://{request.host}"
        page = cast(web.Response, await super().handle_index(request))
        page.text = f"{page.text}<title>{html.escape(self.title)}</title>{TAKE_KEYS}"
        page.headers["Content-Security-Policy"] = OWN_STYLES
        return page

    async def handle_websocket(self, request: web.Request) -> web.WebSocketResponse:
        # A browser lets any site connect to this machine, and says which site it is.
        if request.headers.get("Origin") != f"http://{request.host}":
            raise web.HTTPForbidden(text="only for the page of this server")
        if not web.WebSocketResponse().can_prepare(request):
            raise web.HTTPBadRequest(text="only for web sockets")
        tab = asyncio.create_task(super().handle_websocket(request))
        self._tabs.add(tab)
        return await tab

    async def _process_messages(self, websocket: web.WebSocketResponse, app_service: AppService) -> None:
        try:
            await super()._process_messages(websocket, app_service)
        finally:
            # While it starts, it does not read that it is to quit.
            process = app_service._process
            if process is not None and process.returncode is None:
                with suppress(ProcessLookupError):
                    # `terminate` would fetch the status of one that ended.
                    os.kill(process.pid, signal.SIGTERM)
                await process.wait()  # its end must not be reported to a loop that was closed
