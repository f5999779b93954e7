# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Generate and compile the messages in ``build_ext``."""

import fcntl
from pathlib import Path

from setuptools.command.build_ext import build_ext

from . import messages_extension, required_tools, ros_to_build_for


class BuildMessages(build_ext):
    """Makes what the one extension and the generated Python need, where it is not there yet."""

    def run(self):
        required_tools.refuse_incomplete()
        # An in-place build keeps its folders, so that the next one makes only what has changed; an editable
        # install would give it new ones every time.
        if self.inplace:
            # What was compiled for one release must not be taken for another's.
            folder = Path("build", "inplace", ros_to_build_for.release())
            self.build_lib, self.build_temp = str(folder / "lib"), str(folder / "temp")
            folder.mkdir(parents=True, exist_ok=True)
            # Two builds of one checkout would write into each other's files; the end of the process lets go.
            self._lock = open(folder / "lock", "w")
            fcntl.flock(self._lock, fcntl.LOCK_EX)
        [ext] = self.extensions
        made = Path(self.build_lib, self.get_ext_filename(ext.name))
        if self.force or not messages_extension.is_current(ext, made):
            messages_extension.generate(ext, Path(self.build_temp, messages_extension.NAME))
        super().run()

    def build_extension(self, ext):
        if ext.generated is None:
            return
        messages_extension.build(
            ext, self.compiler, Path(self.get_ext_fullpath(ext.name)).parent, self.build_temp
        )
        super().build_extension(ext)

    def copy_extensions_to_source(self):
        # Also what is older than the file there: that may be another release's.
        self.force = True
        super().copy_extensions_to_source()
        [ext] = self.extensions
        messages_extension.copy_made(
            Path(self.build_lib, messages_extension.NAME), ext.source, self.copy_file
        )
