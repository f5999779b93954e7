# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The names that programs import: a change here is a change for them.

`tf2_names.json` lists what the packages of tf2 0.36 (Jazzy, with sensor_msgs_py) offer, made from them.
"""

import importlib
import inspect
import typing
from unittest import mock

import pytest
from paths import ROOT
from processes import output_of
from project_sources import PYPROJECT
from public_names import ADDED, LEFT_OUT, NAMES, OURS
from reference import imported

# What later releases of tf2 import from elsewhere.
ONLY_JAZZY = {("tf2_ros.buffer_interface", "tf2")}


def offered(module, name):
    return getattr(imported(module), name)


@pytest.mark.tf2
@pytest.mark.parametrize(
    ("module", "name"),
    [
        pytest.param(module, name, marks=pytest.mark.tf2("0.36") if (module, name) in ONLY_JAZZY else ())
        for module, content in NAMES.items()
        for name in content["names"]
        if name not in LEFT_OUT.get(module, ())
    ],
)
def test_a_name_imports_and_stands_for_the_same_kind_of_thing(module, name):
    wanted, got = NAMES[module]["names"][name], offered(module, name)
    namespace = {}
    exec(f"from {module} import {name}", namespace)
    assert namespace[name] is got
    kind, _, module_name = wanted["kind"].partition(" ")
    if kind == "module":
        assert got is importlib.import_module(module_name)
    elif kind == "TypeVar":
        assert type(got) is typing.TypeVar
    elif kind == "class" and wanted.get("from") != "typing":
        assert inspect.isclass(got)
        bases = [base.__name__ for base in inspect.getmro(got)[1:]]
        assert [base for base in bases if base in wanted.get("bases", [])] == wanted.get("bases", [])
    elif wanted.get("from") != "typing":  # some of whose objects are callable, or classes, in some releases
        assert callable(got)
    if wanted.get("from") == "typing":
        assert got.__module__ in ("typing", "collections.abc")
    elif wanted.get("from", "").partition(".")[0] in ("geometry_msgs", "rclpy", "sensor_msgs", "std_msgs"):
        assert got is getattr(importlib.import_module(wanted["from"]), name)


def parameters_of(function):
    """Names as in the list: one with a default ends in `=...`."""
    named = []
    for parameter in inspect.signature(function).parameters.values():
        stars = {parameter.VAR_POSITIONAL: "*", parameter.VAR_KEYWORD: "**"}.get(parameter.kind, "")
        default = "" if parameter.default is parameter.empty else "=..."
        named.append(stars + parameter.name + default)
    return named


CALLED = {
    (module, name, member): parameters
    for module, content in NAMES.items()
    for name, found in content["names"].items()
    for member, parameters in [("", found.get("parameters")), *found.get("members", {}).items()]
    if parameters is not None and name not in ("FrameGraph", "LookupTransform", "TFMessage")
    if not member or module.startswith("tf2_ros.")
}
# A parameter that may be None in later releases of tf2; here, None is its default.
OPTIONAL = {("TransformListener", "__init__"): "node"}


@pytest.mark.tf2
@pytest.mark.parametrize(("module", "name", "member"), CALLED)
def test_a_function_or_method_has_the_parameters_of_tf2s(module, name, member):
    wanted, got = CALLED[module, name, member], offered(module, name)
    if member:
        cls, got = got, getattr(got, member)
    if wanted == "attribute":
        assert isinstance(got, dict)
        return
    optional = OPTIONAL.get((name, member))
    found = [optional if one == f"{optional}=..." else one for one in parameters_of(got)]
    more = found[len(wanted) :]
    assert found[: len(wanted)] == wanted
    # More may follow, if a call can do without it.
    is_exception = member == "__init__" and issubclass(cls, Exception)
    assert is_exception or all(one.endswith("=...") or one.startswith("*") for one in more)


def star(module):
    imported(module)
    namespace = {}
    exec(f"from {module} import *", namespace)
    del namespace["__builtins__"]
    return namespace


@pytest.mark.tf2("0.36")  # others import other names for themselves
@pytest.mark.parametrize("module", NAMES)
def test_import_star_gives_what_tf2s_gives(module):
    left_out = LEFT_OUT.get(module, set())
    namespace, wanted = star(module), set(NAMES[module]["import *"]) - left_out
    assert set(namespace) - ADDED.get(module, set()) - left_out == wanted
    for name in wanted:
        assert namespace[name] is offered(module, name)


@pytest.mark.parametrize("module", LEFT_OUT)
def test_import_star_gives_nothing_that_tf2_imports_for_itself_alone(module):
    assert not LEFT_OUT[module] & set(star(module))


@pytest.mark.parametrize("module", NAMES)
def test_what_is_added_imports_by_name(module):
    for name in ADDED.get(module, set()) | OURS.get(module, set()):
        offered(module, name)


LATER = """
import tf2_ros; print('BufferClient' in vars(tf2_ros), 'BufferClient' in dir(tf2_ros))
from tf2_ros import BufferClient; print(BufferClient is vars(tf2_ros)['BufferClient'])
"""


@pytest.mark.parametrize(
    ("program", "printed"),
    [
        pytest.param(
            "import rclpy, tf2_py; print(rclpy.time.__name__, rclpy.duration.__name__)",
            "rclpy.time rclpy.duration",
            marks=pytest.mark.tf2,
        ),
        pytest.param(
            "import tf2_ros; print(tf2_ros.buffer_client.BufferClient is tf2_ros.BufferClient)",
            "True",
            marks=pytest.mark.tf2,
        ),
        (LATER, "False True True"),
    ],
)
def test_an_import_makes_other_modules_and_names_known(program, printed):
    assert output_of("-c", program).split() == printed.split()


def test_the_version_is_that_of_the_project(tf2_ros, tf2_py):
    assert PYPROJECT["project"]["version"] == tf2_ros.__version__ == tf2_py.__version__
    manifest = (ROOT / "package.xml").read_text(encoding="utf-8")
    assert f"<version>{tf2_ros.__version__}</version>" in manifest


@pytest.mark.tf2
def test_the_classes_of_other_modules_can_be_patched():
    for place in ("tf2_ros.transform_listener.Buffer", "tf2_ros.buffer_client.ActionClient"):
        with mock.patch(place) as patched:
            module, _, name = place.rpartition(".")
            assert offered(module, name) is patched


def test_importing_tf2_ros_loads_few_modules():
    loaded = output_of("-c", "import sys, tf2_ros; print(*sys.modules)").split()
    ours = [name for name in loaded if name.startswith(("tf2_py", "tf2_ros"))]
    assert "tf2_ros.buffer" in ours
    assert len(ours) <= 69, ours
    assert not {"sensor_msgs", "tf2_msgs.action"} & set(loaded)
    assert "rclpy.action" in loaded  # as with tf2: programs use it after `import rclpy` alone
