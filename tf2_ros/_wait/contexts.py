"""Owns which context the waits of a buffer depend on."""

from typing import Any

from rclpy.utilities import get_default_context

from tf2_ros._rclpy import context_was_started

__all__ = ["WaitContext"]


class WaitContext:
    """
    The context whose shutdown ends the waits of one buffer.

    :param context: of the buffer's node. None: the default one.
    """

    def __init__(self, context: Any) -> None:
        self._own = context
        self._default = get_default_context() if context is None else None

    def current(self) -> Any:
        """
        The context that counts now; it may never be started.

        rclpy replaces the default context when it is shut down. The one before counts until the next one is
        started.
        """
        if self._own is not None:
            return self._own
        default = get_default_context()
        if default is not self._default and context_was_started(default):
            self._default = default
        return self._default
