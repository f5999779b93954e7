# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Build with setuptools, after checking that the machine has the required tools."""

import shutil
import sys
import warnings
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

from . import install_command, required_tools

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
    Build a wheel only from the present sources.

    setuptools would also add modules that an earlier build left in its folder, even if they no longer exist.
    """
    for left in Path("build").glob("lib*"):
        shutil.rmtree(left)
    install_command.choose(config_settings)
    return build_meta.build_wheel(wheel_directory, config_settings, metadata_directory)


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    """Build in place."""
    # This warns of folders that take precedence over an installation; here, they are the installation.
    warnings.filterwarnings("ignore", "Editable installation")
    return build_meta.build_editable(wheel_directory, config_settings, metadata_directory)


def get_requires_for_build_wheel(config_settings=None):
    """Check the tools, and list what the build needs besides the list in pyproject.toml."""
    required_tools.refuse_incomplete()
    return build_meta.get_requires_for_build_wheel(config_settings)


def get_requires_for_build_editable(config_settings=None):
    """The same for an editable install."""
    required_tools.refuse_incomplete()
    return build_meta.get_requires_for_build_editable(config_settings)
