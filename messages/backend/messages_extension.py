# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Make ``tf2_msgs``: three shared libraries, an extension on them, the generated Python."""

import os
import shutil
from pathlib import Path

import numpy
from setuptools import Extension

from . import interface_generation, ros_to_build_for

NAME = "tf2_msgs"
_NOTE = "_release.py"

# Whose interfaces ours use, directly or not.
_INTERFACE_PACKAGES = (
    "builtin_interfaces",
    "std_msgs",
    "geometry_msgs",
    "unique_identifier_msgs",
    "service_msgs",
    "action_msgs",
)

_RUNTIME_PACKAGES = (
    "rcutils",
    "rmw",
    "rosidl_dynamic_typesupport",
    "rosidl_runtime_c",
    "rosidl_runtime_cpp",
    "rosidl_typesupport_c",
    "rosidl_typesupport_cpp",
    "rosidl_typesupport_fastrtps_c",
    "rosidl_typesupport_fastrtps_cpp",
    "rosidl_typesupport_interface",
    "rosidl_typesupport_introspection_c",
)

# The libraries in the order of their making, each with what it needs besides those before it and those of its
# kind of the interface packages. ROS opens the last two by bare name at run time: the names are ROS's choice.
_LIBRARIES = {
    "rosidl_generator_c": ("rosidl_runtime_c", "rcutils"),
    "rosidl_typesupport_fastrtps_c": (
        "rosidl_typesupport_fastrtps_c",
        "rosidl_typesupport_fastrtps_cpp",
        "fastcdr",
        "rmw",
    ),
    "rosidl_typesupport_introspection_c": ("rosidl_typesupport_introspection_c",),
}

# Generated code has no hot loop of ours, and its debug information would be most of its size.
_COMPILE_ARGS = ["-O2", "-g0"]


class MessagesExtension(Extension):
    """The extension that rosidl's Python looks for; the libraries it stands on are made together with it."""

    def __init__(self, source):
        self.source = Path(source).resolve()
        self.generated = None
        super().__init__(f"{NAME}.{NAME}_s__rosidl_typesupport_c", sources=[], language="c++")


def is_current(ext, extension_path):
    """Whether the extension and what is made beside it are there, and newer than what they are made from."""
    folder = extension_path.parent
    made = [extension_path, *(folder / f"lib{NAME}__{kind}.so" for kind in _LIBRARIES)]
    made += [folder / kind / "__init__.py" for kind in interface_generation.KINDS]
    note = folder / _NOTE
    if not all(path.is_file() for path in [*made, note]) or note.read_text(encoding="utf-8") != _note():
        return False
    needed = [ext.source / file for file in interface_generation.interface_files(ext.source)]
    needed += Path(__file__).parent.glob("*.py")
    return min(map(os.path.getmtime, made)) > max(map(os.path.getmtime, needed))


def generate(ext, folder):
    """Generate all sources into ``folder``, and note in ``ext`` what it is compiled from."""
    shutil.rmtree(folder, ignore_errors=True)
    prefix = ros_to_build_for.ros_prefix()
    interface_generation.generate(NAME, ext.source, folder.resolve(), _INTERFACE_PACKAGES, prefix)
    ext.generated = folder
    ext.sources = _sources(folder / "rosidl_generator_py") + _sources(folder / "rosidl_typesupport_c")
    ext.extra_compile_args = _COMPILE_ARGS
    ext.include_dirs = [str(folder / name) for name in interface_generation.GENERATORS] + [
        numpy.get_include()
    ]
    headers = prefix / "include"
    ext.include_dirs.append(str(headers))
    ext.include_dirs += [str(headers / name) for name in _RUNTIME_PACKAGES + _INTERFACE_PACKAGES]
    ext.library_dirs = [str(prefix / "lib")]


def build(ext, compiler, target, output_dir):
    """
    Make the libraries and the generated Python in ``target``, and note in ``ext`` what it is linked with.

    Compiled objects go to ``output_dir``.
    """
    target.mkdir(parents=True, exist_ok=True)
    ext.library_dirs.insert(0, str(target))
    libraries = []
    for kind, needed in _LIBRARIES.items():
        library = f"{NAME}__{kind}"
        libraries += [*_of_interface_packages(kind), *needed]
        objects = compiler.compile(
            _sources(ext.generated / kind),
            output_dir=output_dir,
            include_dirs=ext.include_dirs,
            extra_postargs=_COMPILE_ARGS,
        )
        compiler.link_shared_object(
            objects,
            str(target / f"lib{library}.so"),
            libraries=libraries,
            library_dirs=ext.library_dirs,
            extra_preargs=["-Wl,--as-needed"],
            extra_postargs=[f"-Wl,-soname,lib{library}.so", "-Wl,-rpath,$ORIGIN", "-Wl,--no-undefined"],
            target_lang="c++" if "fastrtps" in kind else "c",
        )
        libraries.insert(0, library)
    libraries += _of_interface_packages("rosidl_generator_py")
    libraries += [*_of_interface_packages("rosidl_typesupport_c"), "rosidl_typesupport_c"]
    ext.libraries = libraries
    ext.extra_link_args = ["-Wl,-rpath,$ORIGIN"]
    for file in (ext.generated / "rosidl_generator_py" / NAME).glob("*/*.py"):
        (target / file.parent.name).mkdir(exist_ok=True)
        shutil.copyfile(file, target / file.parent.name / file.name)
    (target / _NOTE).write_text(_note(), encoding="utf-8")


def copy_made(source, target, copy_file):
    """
    Copy the libraries and the generated Python from one folder to another, for an in-place build.

    ``copy_file`` is the command's: it replaces a file, and does not write into one that a program has mapped.
    """
    for file in [*source.glob("lib*.so"), source / _NOTE, *source.glob("*/*.py")]:
        copy_file(str(file), str(target / file.relative_to(source)))


def _note():
    # For the check, when a program runs, that it uses the libraries on which this was built.
    return (
        f'"""Written by the build."""\n\nRELEASE = {ros_to_build_for.release()!r}\n'
        f"TYPE_SUPPORT = {ros_to_build_for.type_support()!r}\n"
    )


def _of_interface_packages(kind):
    return [f"{name}__{kind}" for name in _INTERFACE_PACKAGES]


def _sources(folder):
    return sorted(str(path) for suffix in ("c", "cpp") for path in folder.rglob(f"*.{suffix}"))
