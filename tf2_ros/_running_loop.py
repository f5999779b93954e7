# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Find the asyncio loop of a thread, without importing asyncio."""

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import asyncio


def running_loop() -> "asyncio.AbstractEventLoop | None":
    """The event loop that runs in this thread, if any."""
    # If one runs, asyncio is loaded. It is not imported here: that takes a tenth of the time of importing
    # tf2_ros, and in a forked child it could wait forever for a thread of the parent that was importing it.
    get_running_loop = getattr(sys.modules.get("asyncio"), "_get_running_loop", None)
    return None if get_running_loop is None else get_running_loop()
