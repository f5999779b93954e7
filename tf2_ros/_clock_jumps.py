"""Owns following a clock: a buffer is cleared when it jumps back, and keeps what belongs after the jump."""

import weakref
from typing import Any

from rclpy.clock import ClockChange, JumpHandle, JumpThreshold, TimeJump
from rclpy.duration import Duration

from tf2_ros._receive.receiver_thread import reinsert_recent

__all__ = ["clear_at_jumps", "jump_text"]

JUMP_BACK = Duration(seconds=-1)  # at least so far, and a buffer is cleared


def clear_at_jumps(buffer: Any) -> JumpHandle:
    """
    Call a buffer's ``time_jump_callback`` when its clock jumps back, or when simulated time is switched.

    :return: what ends that; the end of the buffer does, too.
    """
    # The clock refers to the handle by its address alone, so it must be unregistered before it is destroyed,
    # and the handle must not keep the buffer alive.
    reference = weakref.ref(buffer)

    def on_jump(time_jump: TimeJump) -> None:
        jumping = reference()
        if jumping is None:
            return
        jumping.time_jump_callback(time_jump)
        if time_jump.clock_change == ClockChange.ROS_TIME_NO_CHANGE:
            # Transforms may have arrived before the executor took the message of /clock.
            reinsert_recent(jumping, jumping.clock.now().nanoseconds)

    threshold = JumpThreshold(min_forward=None, min_backward=JUMP_BACK, on_clock_change=True)
    handle = buffer.clock.create_jump_callback(threshold, post_callback=on_jump)
    weakref.finalize(buffer, handle.unregister).atexit = False
    return handle


def jump_text(time_jump: TimeJump) -> str:
    """What happened to the clock."""
    if time_jump.clock_change == ClockChange.ROS_TIME_ACTIVATED:
        return "Simulated time was switched on"
    if time_jump.clock_change == ClockChange.ROS_TIME_DEACTIVATED:
        return "Simulated time was switched off"
    return f"Detected jump back in time by {-time_jump.delta.nanoseconds / 1e9:.3f} s"
