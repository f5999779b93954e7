"""Owns the note that the build leaves about itself, for the check at import and for ``tf2_ros.cli.which``."""

from pathlib import Path

from . import environment, receiver

NAME = Path("tf2_ros_cython", "_built.py")


def write(build_lib, version, receiver_lacks):
    """
    Write the note below the folder of what is built, and return its path.

    ``version`` is this project's; ``receiver_lacks`` says why the receiver was left out, or is None.
    """
    facts = {
        "VERSION": version,
        "RCLPY": environment.rclpy_version(environment.ros_prefixes()),
        "RECEIVER": None if receiver_lacks else receiver.NAMES[-1],
        "RECEIVER_LACKS": receiver_lacks,
    }
    path = Path(build_lib, NAME)
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [f"{name}: str | None = {value!r}" for name, value in facts.items()]
    path.write_text("\n".join(['"""Written by the build."""', "", *lines, ""]), encoding="utf-8")
    return path
