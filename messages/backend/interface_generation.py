# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Generate C, C++ and Python from the interface files of a ROS package, without CMake."""

import importlib
import json
import tempfile
from pathlib import Path

from . import ros_to_build_for

KINDS = ("msg", "srv", "action")

# Fast DDS asks for both: one writes the bytes, the other tells the fields.
_TYPE_SUPPORTS = ["rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c"]

# Each generator's package, and its function with what it takes besides the file of arguments. The `rosidl`
# command would find them by itself, but dies on the wheels, which announce each twice.
GENERATORS = {
    "rosidl_generator_c": ("generate_c",),
    "rosidl_typesupport_fastrtps_c": ("generate_typesupport_fastrtps_c",),
    "rosidl_typesupport_introspection_c": ("generate_c",),
    "rosidl_typesupport_c": ("generate_c", _TYPE_SUPPORTS),
    "rosidl_generator_py": ("generate_py", ["rosidl_typesupport_c"]),
}


def interface_files(source):
    """The package's interface files, relative to ``source``, in a fixed order."""
    return sorted(path.relative_to(source) for kind in KINDS for path in source.glob(f"{kind}/*.{kind}"))


def generate(package, source, output, dependencies, prefix):
    """
    Generate ``package`` from ``source`` into one folder of ``output`` per generator.

    ``dependencies`` are the ROS packages whose interfaces it uses, directly or not; they are looked up in
    ``prefix``. All paths are absolute.
    """
    from rosidl_adapter import convert_to_idl

    files = interface_files(source)
    for file in files:
        convert_to_idl(source, package, file, output / "idl")
    descriptions = output / "rosidl_generator_type_description" / package
    arguments = {
        "package_name": package,
        "idl_tuples": [f"{output / 'idl'}:{file.with_suffix('.idl').as_posix()}" for file in files],
        "ros_interface_files": [str(source / file) for file in files],
        "ros_interface_dependencies": [],
        "target_dependencies": [],
        "include_paths": [
            f"{name}:{ros_to_build_for.share_directory(name, prefix)}" for name in dependencies
        ],
        "type_description_tuples": [
            f"{file.with_suffix('.idl').as_posix()}:{descriptions / file.with_suffix('.json')}"
            for file in files
        ],
    }
    # First, for the others write the type hashes that it computes into what they generate.
    _run("rosidl_generator_type_description", "generate_type_hash", [], arguments, descriptions)
    for generator, (function, *extra) in GENERATORS.items():
        templates = ros_to_build_for.share_directory(generator, prefix) / "resource"
        folder = output / generator / package
        for kind in KINDS:
            (folder / kind).mkdir(parents=True, exist_ok=True)
        _run(generator, function, extra, {**arguments, "template_dir": str(templates)}, folder)
        _write_visibility_header(package, generator, templates, folder / "msg")


def _run(module, function, extra, arguments, folder):
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch, "arguments.json")
        path.write_text(json.dumps({**arguments, "output_dir": str(folder)}), encoding="utf-8")
        getattr(importlib.import_module(module), function)(str(path), *extra)


def _write_visibility_header(package, generator, templates, folder):
    """What CMake's configure_file does for the generated headers, where the generator has such a template."""
    template = templates / f"{generator}__visibility_control.h.in"
    if template.is_file():
        text = template.read_text(encoding="utf-8")
        text = text.replace("@PROJECT_NAME_UPPER@", package.upper()).replace("@PROJECT_NAME@", package)
        (folder / f"{generator}__visibility_control.h").write_text(text, encoding="utf-8")
