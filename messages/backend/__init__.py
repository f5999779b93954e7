# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Build hooks: setuptools' own, for the chosen ROS release."""

import shutil
from pathlib import Path

from setuptools import build_meta

from . import required_tools, ros_to_build_for

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
    """Generate, compile, pack; anew, for setuptools takes what another release left in its folder."""
    ros_to_build_for.choose(config_settings)
    for left in Path("build").glob("[lt]*"):
        shutil.rmtree(left)
    return build_meta.build_wheel(wheel_directory, config_settings, metadata_directory)


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    """Build in place."""
    ros_to_build_for.choose(config_settings)
    return build_meta.build_editable(wheel_directory, config_settings, metadata_directory)


def build_sdist(sdist_directory, config_settings=None):
    """The sources for one release, whose name they have."""
    ros_to_build_for.choose(config_settings)
    return build_meta.build_sdist(sdist_directory, config_settings)


def get_requires_for_build_wheel(config_settings=None):
    """The wheels of that release."""
    ros_to_build_for.choose(config_settings)
    ros_to_build_for.refuse_sourced()
    required_tools.refuse_incomplete()
    return build_meta.get_requires_for_build_wheel(config_settings) + ros_to_build_for.ros_wheels()


def get_requires_for_build_editable(config_settings=None):
    """The same for an editable install."""
    return get_requires_for_build_wheel(config_settings)


def get_requires_for_build_sdist(config_settings=None):
    """Nothing but setuptools."""
    ros_to_build_for.choose(config_settings)
    return build_meta.get_requires_for_build_sdist(config_settings)


def prepare_metadata_for_build_wheel(metadata_directory, config_settings=None):
    """Metadata without a build: the name is that of the release."""
    ros_to_build_for.choose(config_settings)
    return build_meta.prepare_metadata_for_build_wheel(metadata_directory, config_settings)


def prepare_metadata_for_build_editable(metadata_directory, config_settings=None):
    """The same for an editable install."""
    ros_to_build_for.choose(config_settings)
    return build_meta.prepare_metadata_for_build_editable(metadata_directory, config_settings)
