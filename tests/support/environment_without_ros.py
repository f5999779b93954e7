# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A Python without ROS, with the extensions of this checkout."""

from dataclasses import dataclass
from pathlib import Path

import installing
from paths import ROOT
from processes import run


@dataclass
class World:
    """A Python without ROS, and what its environment has to say for that."""

    python: Path
    environment: dict[str, str]
    folder: Path

    def run(self, *arguments, **environment):
        return run(self.python, *arguments, cwd=self.folder, env=self.environment | environment)

    def does(self, code):
        """What a program prints that must succeed, in silence but for that."""
        ended = self.run("-c", code)
        assert (ended.returncode, ended.stderr) == (0, "")
        return ended.stdout

    def lacks(self, code):
        """The last line of what a program says that must fail."""
        ended = self.run("-c", code)
        assert ended.returncode == 1
        return ended.stderr.splitlines()[-1]


def make_world(made, libraries, *packages):
    """
    Make one in a folder.

    :param libraries: the requirements of what it has.
    :param packages: folders of packages, besides those of the core.
    """
    folder = installing.link_libraries(made / "libraries", *libraries)
    for package in (*(ROOT / name for name in (*installing.OURS, "tf2_ros_cython")), *packages):
        (folder / package.name).symlink_to(package)
    environment = {**installing.unsourced(), "PYTHONPATH": str(folder), "MPLBACKEND": "agg"}
    return World(installing.new_venv(made / "venv"), environment, made)
