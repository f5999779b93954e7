"""
Install the packages into a folder of their own, which no other project's files can share.

The packages have the names of tf2's. In the folder of all packages, they would overwrite those of a ROS 2
that is installed there, as by conda, and no Debian package could hold them.
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

# By `-C layout=flat`: no folder of their own, for environments that do not read .pth files.
is_flat = False


def choose(config_settings):
    """Heed pip's option `-C layout=flat`."""
    global is_flat
    layout = (config_settings or {}).get("layout", "private")
    if layout not in ("private", "flat"):
        raise SystemExit(f"tf2-ros-cython: expected layout=private or layout=flat, got layout={layout}")
    is_flat = layout == "flat"


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
        return [*made, copy_pth(self.install_dir)]

    def get_outputs(self):
        return [*map(self._moved, super().get_outputs()), str(Path(self.install_dir, PTH.name))]

    def _moved(self, path):
        package, *inner = Path(path).relative_to(self.install_dir).parts
        if is_flat or package == OWNER:
            return str(path)
        return str(Path(self.install_dir, FOLDER, package, *inner))
