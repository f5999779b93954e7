"""Drive a headless browser: open a page and take pictures of it."""

import asyncio
import base64
import io
import json
import os
import shutil
import signal
import subprocess
from contextlib import contextmanager
from urllib.request import urlopen

import numpy as np
import pytest
from processes import until

CHROMIUM = shutil.which("chromium")

# Drawn by the processor, and without a connection to anywhere but this machine.
OPTIONS = """
    --headless --no-sandbox --no-first-run --disable-quic --disable-background-networking
    --disable-component-update --disable-sync --use-angle=swiftshader --enable-unsafe-swiftshader
    --ignore-gpu-blocklist --window-size=1000,700 --remote-debugging-port=0
""".split()
LOOPBACK_ONLY = "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"
PAGE_S = 60.0
ANSWER_S = 15.0  # a picture of a page that a processor draws takes a second
BROWSERS = 3


def picture_when(url, is_complete, folder):
    """
    Open a page, and wait until a picture of it satisfies a condition.

    Skips the test where browsers stop answering, as one did once.

    :param is_complete: called with pictures: uint8, shape (height, width, 3).
    :param folder: for the browser's own files; its last processes may still write there afterwards.
    :return: the last picture, also where the condition did not come true within PAGE_S.
    """
    for number in range(BROWSERS):
        with _browser(folder / f"profile{number}") as port:
            try:
                return asyncio.run(_picture_when(port, url, is_complete))
            except (TimeoutError, asyncio.TimeoutError):  # one class from Python 3.11 on
                continue
    pytest.skip(f"{BROWSERS} browsers in turn gave no picture")


@contextmanager
def _browser(profile):
    """The port of a running browser."""
    command = [CHROMIUM, *OPTIONS, LOOPBACK_ONLY, f"--user-data-dir={profile}", "about:blank"]
    # A group of its own: the browser is many processes.
    browser = subprocess.Popen(command, stderr=subprocess.DEVNULL, start_new_session=True)
    try:
        port_file = profile / "DevToolsActivePort"
        yield until(lambda: port_file.exists() and port_file.read_text().partition("\n")[0])
    finally:
        os.killpg(browser.pid, signal.SIGKILL)
        browser.wait()


async def _picture_when(port, url, is_complete):
    from tornado.websocket import websocket_connect

    with urlopen(f"http://127.0.0.1:{port}/json", timeout=ANSWER_S) as answer:
        [page] = [target for target in json.load(answer) if target["type"] == "page"]
    connection = await websocket_connect(page["webSocketDebuggerUrl"], max_message_size=1 << 26)
    await _ask(connection, "Page.navigate", url=url)
    loop = asyncio.get_running_loop()
    deadline = loop.time() + PAGE_S
    while True:
        answer = await _ask(connection, "Page.captureScreenshot")
        # It refuses while it is busy with loading the page.
        if answer is not None:
            picture = _pixels(base64.b64decode(answer["data"]))
            if is_complete(picture) or loop.time() > deadline:
                return picture
        elif loop.time() > deadline:
            raise TimeoutError
        await asyncio.sleep(0.2)


async def _ask(connection, method, **parameters):
    """The result; None where there is an error instead."""
    await connection.write_message(json.dumps({"id": 1, "method": method, "params": parameters}))
    return await asyncio.wait_for(_result(connection), ANSWER_S)


async def _result(connection):
    while True:
        answer = json.loads(await connection.read_message())
        if "id" in answer:
            return answer.get("result")


def _pixels(png):
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))
