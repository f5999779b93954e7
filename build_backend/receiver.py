"""Owns what the receiver is compiled with: the headers and libraries of rcl, where there are any."""

import os

from . import environment

# They need rcl; the second one is built on the first.
NAMES = ("tf2_ros._receive.arrival_waitable", "tf2_ros._receive.loop")

# Of these it calls functions; rmw's, which it also uses, are macros.
_LIBRARIES = ("rcl", "rcutils")
_NEEDED = ("include/rcl/rcl/rcl.h", *(f"lib/lib{library}.so" for library in _LIBRARIES))


def complete(ext, environ=os.environ):
    """
    Note in ``ext`` what it is compiled and linked with; return what is lacking for that, or None.

    No path to the libraries goes into the extension: rclpy has loaded them before, and the loader knows them
    by name. So of two installations only one is ever in use.
    """
    if environment.without_ros():
        return "the build was without ROS 2 (-C ros=none)"
    prefixes = environment.ros_prefixes(environ)
    for file in _NEEDED:
        if not any((prefix / file).is_file() for prefix in prefixes):
            return f"the ROS 2 in {os.pathsep.join(map(str, prefixes))} has no {file}"
    for prefix in prefixes:
        # Each package has a folder of its own in there, and rcl's headers use those of some twenty.
        folders = sorted((prefix / "include").glob("*"))
        ext.include_dirs += [str(folder) for folder in folders if (folder / folder.name).is_dir()]
    ext.library_dirs += [str(prefix / "lib") for prefix in prefixes]
    ext.libraries += _LIBRARIES
    return None
