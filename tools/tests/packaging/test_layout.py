"""The tools import public names of the core, and no modules import each other in a circle."""

import sys

import pytest
import sources
from places import TOOLS
from tool_sources import PACKAGES

pytestmark = pytest.mark.ours

LIBRARIES = {
    *("numpy", "rclpy", "geometry_msgs", "rcl_interfaces", "sensor_msgs", "std_msgs", "tf2_msgs"),
    *("yaml", "rich", "textual", "graphviz", "matplotlib"),
    *("rosbags", "mcap", "mcap_protobuf", "zstandard", "tqdm"),
    *("pyarrow", "dask", "distributed", "cryptography", "rerun"),
}
MODULES = sources.modules(TOOLS, PACKAGES)
IMPORTS = {
    name: {one.module for path in paths for one in sources.imports(path, TOOLS, PACKAGES)}
    for name, paths in MODULES.items()
}


def is_allowed(imported):
    top, *parts = imported.split(".")
    if top in sources.PACKAGES:
        return not any(part.startswith("_") for part in parts)
    return top in {*PACKAGES, *LIBRARIES, *sys.stdlib_module_names}


def test_modules_import_public_names_and_known_libraries():
    assert "tf2_ros_tools.loading" in IMPORTS
    assert [
        f"{name}: {one}" for name, found in IMPORTS.items() for one in sorted(found) if not is_allowed(one)
    ] == []


def test_no_modules_import_each_other_in_a_circle():
    graph = {name: found & MODULES.keys() - {*PACKAGES} for name, found in IMPORTS.items()}
    while free := {name for name, needed in graph.items() if not needed & graph.keys()}:
        for name in free:
            del graph[name]
    assert graph == {}
