"""Owns what the receiver is compiled with: the headers and libraries of rcl, where there are any."""

from . import environment

NAME = "tf2_py._receiver"

_LIBRARIES = ("rcl", "rcutils")  # of these it calls functions, rmw's are macros


def complete(ext):
    """Note in `ext` what it is compiled and linked with; return what is lacking, or None.

    No path to the libraries goes into the extension: rclpy has loaded them before, and the loader knows them
    by their names. Of two installations no other one must come in.
    """
    prefixes = environment.ros_prefixes()
    if not any((prefix / "include" / "rcl" / "rcl" / "rcl.h").is_file() for prefix in prefixes):
        return "the headers of rcl"
    for library in _LIBRARIES:
        if not any((prefix / "lib" / f"lib{library}.so").is_file() for prefix in prefixes):
            return f"lib{library}.so"
    for prefix in prefixes:
        # Each package has a folder of its own in there, and rcl's headers use those of some twenty.
        folders = sorted((prefix / "include").glob("*"))
        ext.include_dirs += [str(folder) for folder in folders if (folder / folder.name).is_dir()]
    ext.library_dirs += [str(prefix / "lib") for prefix in prefixes]
    ext.libraries += _LIBRARIES
    return None
