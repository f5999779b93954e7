"""
Tell PyInstaller, which finds this by the entry point ``pyinstaller40``, what compiled modules import.

It reads the imports of Python code only. Without these hooks, a bundled program ends with "tf2_py._core is
missing".
"""

from importlib.util import find_spec
from pathlib import Path

from tf2_ros_cython import _ros_in_use

# What the .pyx files import from elsewhere; a test compares the two.
IMPORTED = """
array atexit collections collections.abc contextlib ctypes datetime functools heapq numbers operator os stat
struct sys threading traceback types warnings weakref
numpy geometry_msgs.msg nav_msgs.msg sensor_msgs.msg
rclpy rclpy.executors rclpy.impl.implementation_singleton rclpy.time rclpy.waitable
""".split()


def hook_dirs() -> list[str]:
    """Where the hooks are."""
    return [str(Path(__file__).parent)]


def hidden_imports() -> list[str]:
    """All modules of our packages, which import some by name, and what is found of other libraries."""
    # Only PyInstaller's own process has it.
    from PyInstaller.utils.hooks import collect_submodules

    ours = [module for name in _ros_in_use.loadable_packages() for module in collect_submodules(name)]
    return [*ours, *(name for name in IMPORTED if find_spec(name.partition(".")[0]))]
