"""What `help` and `inspect` say of the compiled functions: parameters, defaults and types."""

import ast
import importlib
import inspect
import pydoc

import pytest
from sources import PACKAGES, modules

pytestmark = pytest.mark.ours


def stub_of(module):
    return next((path for path in modules()[module] if path.suffix == ".pyi"), None)


COMPILED = [
    module
    for module, paths in modules().items()
    if module.startswith(PACKAGES) and any(path.suffix == ".pyx" for path in paths) and stub_of(module)
]


def public_functions():
    """(module, dotted name) of each function and method of a stub whose names have no underscore."""
    for module in COMPILED:
        if module.startswith(("tf2_geometry_msgs", "tf2_sensor_msgs")) or module == "tf2_py._tf2_py":
            exported = getattr(importlib.import_module(module), "__all__", None)
            for node in ast.parse(stub_of(module).read_text()).body:
                if exported is not None and getattr(node, "name", None) not in exported:
                    continue
                if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                    yield module, node.name
                elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    for member in node.body:
                        is_property = getattr(member, "decorator_list", [])
                        if isinstance(member, ast.FunctionDef) and not is_property:
                            if not member.name.startswith("_"):
                                yield module, f"{node.name}.{member.name}"


def find(module, name):
    thing = importlib.import_module(module)
    for part in name.split("."):
        thing = getattr(thing, part)
    return thing


every_function = pytest.mark.parametrize(("module", "name"), sorted(set(public_functions())))


@every_function
def test_a_compiled_function_shows_the_type_of_each_parameter_and_of_its_result(module, name):
    signature = inspect.signature(find(module, name))
    parameters = [parameter for parameter in signature.parameters.values() if parameter.name != "self"]
    assert [p.name for p in parameters if p.annotation is inspect.Parameter.empty] == []
    assert signature.return_annotation is not inspect.Signature.empty


@every_function
def test_its_help_has_the_signature_once_and_begins_with_words(module, name):
    function = find(module, name)
    first, *rest = pydoc.render_doc(function, renderer=pydoc.plaintext).splitlines()[2:]
    assert first.startswith(f"{name.rpartition('.')[2]}(") and "->" in first
    assert not any(line.strip().startswith(f"{name}(") for line in rest)
    assert inspect.getdoc(function)[0].isupper()


def test_the_class_has_a_signature_that_calls_it(tf2_py):
    signature = inspect.signature(tf2_py.BufferCore)
    assert list(signature.parameters) == ["cache_time", "max_frames", "max_bytes"]
    arguments = {name: p.default for name, p in signature.parameters.items() if p.kind == p.KEYWORD_ONLY}
    assert tf2_py.BufferCore(signature.parameters["cache_time"].default, **arguments) is not None
    assert not tf2_py.BufferCore.__doc__.lstrip().startswith("BufferCore(")


def test_types_in_a_signature_are_shown_and_not_enforced(tf2_py):
    # What is given is checked by the function itself, which says what is wrong with it.
    class Stamp:
        nanoseconds = 1

    assert tf2_py.BufferCore().lookup_transform_core("a", "a", Stamp()).child_frame_id == "a"
    with pytest.raises(TypeError, match="target_frame: expected a str, got int"):
        tf2_py.BufferCore().lookup_transform_core(5, "a", Stamp())
