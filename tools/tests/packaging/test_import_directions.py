# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The tools use names of the core that its reference lists, and no modules import each other in a circle."""

import ast
import importlib
import re
import sys

import project_sources
import pytest
from paths import ROOT
from public_names import ADDED, NAMES, OURS
from tool_paths import TOOLS
from tool_project import PACKAGES

LIBRARIES = {
    *("numpy", "rclpy", "geometry_msgs", "rcl_interfaces", "tf2_msgs"),
    *("yaml", "rich", "textual", "graphviz", "matplotlib"),
    *("textual_serve", "aiohttp"),
    *("rosbags", "mcap", "mcap_protobuf", "zstandard", "tqdm"),
    "pyarrow",
    *("cyclonedds", "zenoh", "xxhash", "websockets"),
}
MODULES = project_sources.modules(TOOLS, PACKAGES)
IMPORTS = {
    name: {one.module for path in paths for one in project_sources.imports(path, TOOLS, PACKAGES)}
    for name, paths in MODULES.items()
}


def test_modules_import_known_libraries():
    assert "tf2_ros_tools.recordings.bag_loader" in IMPORTS
    known = {*PACKAGES, *project_sources.PACKAGES, *LIBRARIES, *sys.stdlib_module_names}
    imported = {(name, one) for name, found in IMPORTS.items() for one in found}
    assert {(name, one) for name, one in imported if one.partition(".")[0] not in known} == set()


def listed():
    """The names that the reference of the core lists, those of tf2, and the modules that have them."""
    found = {f"{module}.{name}" for names in (ADDED, OURS) for module in names for name in names[module]}
    found |= {f"{module}.{name}" for module, content in NAMES.items() for name in content["names"]}
    for page in sorted((ROOT / "docs" / "api").glob("*.rst")):
        module = ""
        for directive, name, is_whole in re.findall(
            r"^\.\. (\S+):: (\S+)(\n   :members:)?", page.read_text(encoding="utf-8"), re.MULTILINE
        ):
            if directive == "py:currentmodule":
                module = name
            elif directive == "automodule" and is_whole:
                found |= {f"{name}.{one}" for one in importlib.import_module(name).__all__}
            elif directive.startswith("auto") and directive != "automodule":
                found.add(name)
            elif directive == "py:data":
                found.add(f"{module}.{name}")
    return found | {name.rpartition(".")[0] for name in found}


def used(tree, packages=project_sources.PACKAGES):
    """What a module imports from these packages, and which names of theirs it uses as attributes."""
    modules, found = {}, set()
    for node in ast.walk(tree):
        match node:
            case ast.ImportFrom(module=str(module), names=aliases) if module.partition(".")[0] in packages:
                found |= {f"{module}.{one.name}" for one in aliases}
            case ast.Import(names=aliases):
                for one in (one for one in aliases if one.name.partition(".")[0] in packages):
                    found.add(one.name)
                    modules[one.asname or one.name] = one.name
    attributes = {
        f"{modules[of]}.{node.attr}"
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and (of := ast.unparse(node.value)) in modules
    }
    return found | attributes


def test_the_tools_use_names_of_the_core_that_its_reference_lists():
    names = listed()
    assert {"tf2_ros.Buffer", "tf2_py.typing.TimeLike", "tf2_ros.numpy.to_matrix"} < names
    trees = {name: ast.parse(path.read_text(encoding="utf-8")) for name, [path] in MODULES.items()}
    assert "tf2_py.FrameInfo" in used(trees["tf2_ros_tools.pictures.tree"])
    assert {name: unlisted for name, tree in trees.items() if (unlisted := used(tree) - names)} == {}


@pytest.mark.parametrize(
    "code",
    [
        "from tf2_py.printable import unlisted as number",
        "import tf2_py.printable\ntf2_py.printable.unlisted(1)",
        "import tf2_py.printable as t\nt.unlisted(1)",
    ],
)
def test_an_unlisted_name_is_noticed(code):
    assert used(ast.parse(code)) - listed() == {"tf2_py.printable.unlisted"}


def test_no_modules_import_each_other_in_a_circle():
    graph = {name: found & MODULES.keys() - {*PACKAGES} for name, found in IMPORTS.items()}
    while free := {name for name, needed in graph.items() if not needed & graph.keys()}:
        for name in free:
            del graph[name]
    assert graph == {}
