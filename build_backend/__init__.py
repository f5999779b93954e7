"""Owns the build's hooks: setuptools' own, after a look at what the machine lacks."""

import shutil
import sys
from pathlib import Path

# Before anything else is imported: pip asks the hooks before it looks at requires-python.
if sys.version_info < (3, 10):  # noqa: UP036
    raise SystemExit(
        "tf2-ros-cython needs Python 3.10 or newer, and this is"
        f" {sys.version_info[0]}.{sys.version_info[1]}: install a newer Python and use its pip"
    )

from setuptools import build_meta
from setuptools.build_meta import (
    build_sdist,
    get_requires_for_build_sdist,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

from . import environment, startup

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    """
    Build from the sources alone.

    setuptools puts into the wheel whatever an earlier build left in its folder: modules that are gone.
    """
    for left in Path("build").glob("lib*"):
        shutil.rmtree(left)
    name = build_meta.build_wheel(wheel_directory, config_settings, metadata_directory)
    startup.add_to(Path(wheel_directory, name))
    return name


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    """Build in place."""
    name = build_meta.build_editable(wheel_directory, config_settings, metadata_directory)
    startup.add_to(Path(wheel_directory, name))
    return name


def get_requires_for_build_wheel(config_settings=None):
    """What the build needs besides pyproject.toml's list, after a look at the tools."""
    environment.refuse_incomplete()
    return build_meta.get_requires_for_build_wheel(config_settings)


def get_requires_for_build_editable(config_settings=None):
    """The same for an editable install."""
    environment.refuse_incomplete()
    return build_meta.get_requires_for_build_editable(config_settings)
