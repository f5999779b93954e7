# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Install the packages into a folder of their own, which no other project's files can share.

The packages have the names of tf2's. In the folder of all packages, they would overwrite those of a ROS 2
that is installed there, as by conda, and no Debian package could hold them.

Where a distribution installs them, perhaps for the sake of another package, they wait for TF2_ROS_CYTHON=1: a
package of the distribution must not change what every program imports.
"""

import shutil
from pathlib import Path

from setuptools.command.install_lib import install_lib

# The package that stays in the folder of all packages, and where it holds the others. Its module
# `_installation` says the same: the build imports nothing that it builds.
OWNER = "tf2_ros_cython"
FOLDER = Path(OWNER, "packages")
# Python reads it when it starts: it puts that folder into its place on the path.
PTH = Path(__file__).parents[1] / "resource" / f"{OWNER}.pth"

# Where ROS's own packages are installed: bloom runs `setup.py install --prefix /opt/ros/jazzy`.
OF_DISTRIBUTIONS = Path("/opt/ros")
# If this file is there, the packages wait for TF2_ROS_CYTHON=1.
OPT_IN = Path(OWNER, "opt_in")

# By `-C precedence=opt-in`.
is_opt_in = False


def choose(config_settings):
    """Heed pip's option `-C precedence=opt-in`."""
    global is_opt_in
    value = (config_settings or {}).get("precedence", "opt-out")
    if value not in ("opt-out", "opt-in"):
        raise SystemExit(
            f"tf2-ros-cython: expected precedence=opt-out or precedence=opt-in, got precedence={value}"
        )
    is_opt_in = value == "opt-in"


def copy_pth(folder):
    """Copy it into the folder of all packages, and return its path."""
    # With its time, so that two builds of the same sources give the same wheel.
    return shutil.copy2(PTH, folder)


class InstallLib(install_lib):
    """Installs what was built, in wheels and by `setup.py install`."""

    def install(self):
        made = []
        for package in sorted(Path(self.build_dir).iterdir()):
            made += self.copy_tree(str(package), self._moved(Path(self.install_dir, package.name)))
        made += [copy_pth(self.install_dir), *map(self._write_note, self._notes())]
        return made

    def get_outputs(self):
        return [
            *map(self._moved, super().get_outputs()),
            str(Path(self.install_dir, PTH.name)),
            *self._notes(),
        ]

    def _notes(self):
        prefix = self.get_finalized_command("install").prefix
        is_of_distribution = prefix is not None and OF_DISTRIBUTIONS in Path(prefix).parents
        return [str(Path(self.install_dir, OPT_IN))] if is_opt_in or is_of_distribution else []

    def _write_note(self, path):
        Path(path).write_text("Python imports these packages only with TF2_ROS_CYTHON=1.\n", encoding="utf-8")
        return path

    def _moved(self, path):
        package, *inner = Path(path).relative_to(self.install_dir).parts
        if package == OWNER:
            return str(path)
        return str(Path(self.install_dir, FOLDER, package, *inner))
