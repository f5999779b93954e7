"""List the owners of inboxes, and run the threads that serve the inboxes."""

import atexit
import logging
import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from tf2_ros._forking import LOCK, LiveObjects
from tf2_ros._receive.inbox import begin_anew, run_inboxes, run_reports, stop_inboxes, take_handed
from tf2_ros._wait.endings import call_logged

CHECK_S = 0.7  # between two checks, at least: an idle thread wakes every 1.5 s
THREAD_END_WAIT_S = 5.0  # how long to wait for a thread to end; only a very busy machine needs this long


# Each decides when an inbox, its attribute ``inbox``, begins and ends, and has a method ``stop``, for good.
_owners: LiveObjects[Any] = LiveObjects()
_checked: LiveObjects[Any] = LiveObjects()  # the method ``_tf2_check`` of each is called regularly
_checked_at = 0.0


def add_owner(owner: Any) -> None:
    """Serve the inbox of an owner, and check the owner regularly."""
    _start("tf2_ros receiver", run_inboxes)
    _start("tf2_ros reports", run_reports, _report)
    _owners.add(owner)
    _checked.add(owner)


def check_regularly(checked: Any) -> None:
    """Call ``_tf2_check()`` every one or two seconds, as long as something else refers to the object."""
    _checked.add(checked)
    with suppress(RuntimeError):  # no thread can be started now; the next listener tries again
        _start("tf2_ros reports", run_reports, _report)


_threads: dict[str, threading.Thread] = {}  # those of this process, by their names


def _start(name: str, target: Callable[..., None], *arguments: object) -> None:
    with LOCK:
        if name not in _threads:
            # A daemon, so that the interpreter does not wait for it before it runs the exit handlers.
            args = (name, target, *arguments)
            threading.Thread(target=_run, args=args, name=name, daemon=True).start()


def _run(name: str, target: Callable[..., None], *arguments: object) -> None:
    # A signal handler may raise in the thread that starts this one, which nevertheless begins.
    this = threading.current_thread()
    if _threads.setdefault(name, this) is this:
        target(*arguments)


def _report() -> None:
    global _checked_at
    where = "In the thread that reports"
    for owner in _owners:
        call_logged(owner.inbox.report_pending, where)
    for hand_over in take_handed():
        call_logged(hand_over, where)
    now = time.monotonic()
    if now - _checked_at >= CHECK_S:
        _checked_at = now
        for checked in _checked:
            call_logged(checked._tf2_check, where)


@atexit.register
def _stop_all() -> None:
    for owner in _owners:
        owner.stop()
    stop_inboxes()
    for thread in list(_threads.values()):
        thread.join(THREAD_END_WAIT_S)


def _after_fork_in_child() -> None:
    begin_anew()
    _threads.clear()
    lost = sum([owner.inbox.leave_to_parent() for owner in _owners])
    _owners.clear()
    _checked.clear()
    if lost:
        # Not logged through ROS, whose locks another thread may have held.
        logging.getLogger("tf2_ros").warning(
            f"Process {os.getpid()} was forked from one with {lost} listener(s) or attached buffer(s), which "
            "receive nothing here. Spawn the process instead of forking it, and make its own listeners."
        )


os.register_at_fork(after_in_child=_after_fork_in_child)
