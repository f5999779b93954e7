# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compile the extensions: which ones there are, their flags, and ``build_ext``."""

import fcntl
import os
import sys
import threading
from contextlib import suppress
from pathlib import Path

import numpy
from setuptools import Extension, find_packages
from setuptools.command.build_ext import build_ext

from . import built_version, install_command, required_tools

# No -ffast-math, because comparisons with NaN and infinity decide what is refused. No contraction into fused
# multiply-adds, because the last bits would depend on the machine. No vectors out of straight-line code: for
# products of quaternions, GCC shuffles more than it computes, and a static hop takes 15 ns instead of 11.
COMPILE_ARGS = ["-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-tree-slp-vectorize"]
# Python's flags add debug information, which would be three quarters of the installed size.
NO_DEBUG_ARGS = ["-g0"]
DIRECTIVES = {
    "language_level": 3,
    "boundscheck": False,
    "wraparound": False,
    "initializedcheck": False,
    "cdivision": True,
    # Give functions signatures for `inspect`, with annotations, which are only text.
    "binding": True,
    "annotation_typing": False,
}


def packages(root):
    """All packages of the project: those whose names begin as tf2's."""
    return find_packages(str(root), include=["tf2_*"])


def cython_extensions(root):
    """One extension for each ``.pyx`` of the packages, which may have none."""
    return [
        Extension(
            f"{package}.{path.stem}",
            [path.relative_to(root).as_posix()],
            include_dirs=[numpy.get_include(), str(root)],
            depends=[header.relative_to(root).as_posix() for header in path.parent.glob("*.h")],
            define_macros=[("NPY_NO_DEPRECATED_API", "NPY_1_7_API_VERSION")],
            extra_compile_args=COMPILE_ARGS,
        )
        for package in packages(root)
        for path in sorted(Path(root, *package.split(".")).glob("*.pyx"))
    ]


class BuildExtensions(build_ext):
    """Compiles in several threads, and generates the C code of one extension while others are compiled."""

    def finalize_options(self):
        super().finalize_options()
        if self.parallel is None:
            self.parallel = os.cpu_count()

    def run(self):
        required_tools.refuse_incomplete()
        required_tools.refuse_other_cython()
        # An in-place build keeps its folders, so that the next one makes only what has changed; an editable
        # install would give it new ones every time.
        if self.inplace:
            folder = Path("build", "inplace", sys.implementation.cache_tag)
            self.build_lib, self.build_temp = str(folder / "lib"), str(folder / "temp")
            folder.mkdir(parents=True, exist_ok=True)
            # Two builds of one checkout would overwrite each other's files. The lock ends with the process.
            self._lock = open(folder / "lock", "w")
            fcntl.flock(self._lock, fcntl.LOCK_EX)
        self._made = built_version.write(Path(self.build_lib), self.distribution.get_version())
        self._generating, self._refused, self._done = threading.Lock(), [], 0
        super().run()
        if self._refused:
            names = ", ".join(one.name for one in self._refused)
            raise SystemExit(f"Cython refused {names}; what it says is above")

    def build_extensions(self):
        # One is a quarter of the work: begun last, it would keep one thread busy while the others are idle.
        self.extensions.sort(key=_size_of_sources, reverse=True)
        super().build_extensions()
        # A broken module shows all its errors, and does not prevent the others from being built.
        self.extensions = [one for one in self.extensions if one not in self._refused]

    def build_extension(self, ext):
        made = Path(self.get_ext_fullpath(ext.name))
        before = made.stat().st_mtime_ns if made.exists() else None
        with self._generating:  # Cython is Python code, so threads would only wait for each other
            self._generate(ext)
        if ext in self._refused:
            return
        if not (self.inplace or self.debug):
            ext.extra_compile_args = ext.extra_compile_args + NO_DEBUG_ARGS
        super().build_extension(ext)
        with self._generating:
            self._done += 1
            if made.stat().st_mtime_ns != before:
                _report(f"  {self._done} of {len(self.extensions)}: {ext.name}")

    def copy_extensions_to_source(self):
        super().copy_extensions_to_source()
        self.copy_file(str(self._made), str(self._made.relative_to(self.build_lib)))
        if self.editable_mode:
            # The wheel of an editable installation has no other files of the project.
            install_command.copy_pth(self.get_finalized_command("install").install_lib)

    def _generate(self, ext):
        """Generate C from the ``.pyx``, unless that was done before; note a module that Cython refuses."""
        import Cython
        from Cython.Build import cythonize
        from Cython.Compiler.Errors import CompileError

        base = self.get_finalized_command("build").build_base
        # For `make coverage`, which counts lines of the sources and not of the C code.
        has_lines = bool(os.environ.get("CYTHON_LINES"))
        # A newer Cython checks only the age of the sources, and would reuse the C code of an older one.
        folder = Path(base, f"cython-{'lines-' if has_lines else ''}{Cython.__version__}")
        [source] = ext.sources
        generated = folder / Path(source).with_suffix(".c")
        if not self.force and _is_newest(generated, source):
            ext.sources = [str(generated)]
            return
        try:
            [done] = cythonize(
                ext,
                build_dir=str(folder),
                compiler_directives=DIRECTIVES,
                emit_linenums=has_lines,
                force=True,
                quiet=True,
            )
            ext.sources = done.sources
        except CompileError:
            self._refused.append(ext)


def _report(line):
    """Write how far the build is to where make asks for it: pip shows nothing until a build has ended."""
    if place := os.environ.get("BUILD_PROGRESS"):
        with suppress(OSError), open(place, "a") as terminal:
            print(line, file=terminal)


def _size_of_sources(ext):
    """The bytes of what an extension is generated from."""
    [source] = ext.sources
    return sum(path.stat().st_size for path in _sources_of_project(source))


def _is_newest(generated, source):
    """
    Whether C code is newer than all files of the project that it was generated from.

    Cython also looks at its own files and at those of NumPy, which are newer in each new environment.
    """
    if not generated.exists():
        return False
    return max(path.stat().st_mtime for path in _sources_of_project(source)) <= generated.stat().st_mtime


def _sources_of_project(source):
    """The files that C code is generated from, without those of Cython and NumPy."""
    from Cython.Build.Dependencies import create_dependency_tree

    used = map(Path, create_dependency_tree(quiet=True).all_dependencies(source))
    return [path for path in used if not path.is_absolute()]
