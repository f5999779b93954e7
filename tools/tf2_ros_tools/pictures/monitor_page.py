# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Serve the screen of tf2_monitor to web browsers; each tab runs its own process."""

import asyncio
import ipaddress
import os
import socket
from typing import cast
from weakref import WeakSet

from aiohttp import web
from textual_serve.server import Server

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
        app = _Page(command, title=title)._make_app()
        web.run_app(app, sock=listening, handle_signals=False, print=None, access_log=None)


class _Page(Server):
    """Serves browsers at any address by which they reach it, such as the end of an SSH tunnel."""

    def __init__(self, command: str, title: str) -> None:
        super().__init__(command, title=title)
        self._tabs: WeakSet[asyncio.Task[web.WebSocketResponse]] = WeakSet()

    async def on_startup(self, app: web.Application) -> None:
        """Print no banner."""

    async def on_shutdown(self, app: web.Application) -> None:
        """End the processes of all tabs, for which aiohttp would wait for a minute."""
        for tab in self._tabs:
            tab.cancel()

    async def handle_index(self, request: web.Request) -> web.Response:
        self.public_url = f"http://{request.host}"
        page = cast(web.Response, await super().handle_index(request))
        page.text = f"{page.text}{TAKE_KEYS}"
        page.headers["Content-Security-Policy"] = OWN_STYLES
        return page

    async def handle_websocket(self, request: web.Request) -> web.WebSocketResponse:
        # A browser lets any site connect to this machine, and says which site it is.
        if request.headers.get("Origin") != f"http://{request.host}":
            raise web.HTTPForbidden(text="only for the page of this server")
        tab = asyncio.create_task(super().handle_websocket(request))
        self._tabs.add(tab)
        return await tab
