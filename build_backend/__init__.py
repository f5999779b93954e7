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

    setuptools puts into the wheel whatever an earlier build left in its folder: modules that are gone, and a
    ``tf2_msgs`` that would shadow the one of a ROS 2 sourced since.
    """
    environment.choose(config_settings)
    for left in Path("build").glob("lib*"):
        shutil.rmtree(left)
    name = build_meta.build_wheel(wheel_directory, config_settings, metadata_directory)
    startup.add_to(Path(wheel_directory, name))
    return name


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    """Build in place."""
    environment.choose(config_settings)
    name = build_meta.build_editable(wheel_directory, config_settings, metadata_directory)
    startup.add_to(Path(wheel_directory, name))
    return name


def get_requires_for_build_wheel(config_settings=None):
    """What the build needs besides pyproject.toml's list: the ROS wheels, unless a ROS 2 is sourced."""
    environment.choose(config_settings)
    environment.refuse_incomplete()
    return build_meta.get_requires_for_build_wheel(config_settings) + environment.ros_wheels()


def get_requires_for_build_editable(config_settings=None):
    """The same for an editable install."""
    environment.choose(config_settings)
    environment.refuse_incomplete()
    return build_meta.get_requires_for_build_editable(config_settings) + environment.ros_wheels()


def prepare_metadata_for_build_wheel(metadata_directory, config_settings=None):
    """Metadata without a build: which packages there are depends on the choice of ROS, too."""
    environment.choose(config_settings)
    return build_meta.prepare_metadata_for_build_wheel(metadata_directory, config_settings)


def prepare_metadata_for_build_editable(metadata_directory, config_settings=None):
    """The same for an editable install."""
    environment.choose(config_settings)
    return build_meta.prepare_metadata_for_build_editable(metadata_directory, config_settings)
