"""Owns a name that programs find in tf2_py by accident: a context manager that acts on Windows alone."""

from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["add_dll_directories_from_env"]

try:
    from rpyutils import add_dll_directories_from_env  # type: ignore[import-untyped,unused-ignore]
except ModuleNotFoundError as missing:
    if missing.name != "rpyutils":
        raise

    @contextmanager
    def add_dll_directories_from_env(env_name: str) -> Iterator[None]:
        """Do nothing: without ROS there are no libraries to find."""
        yield
