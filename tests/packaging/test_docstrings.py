# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What `help` says: every public class has an example, which runs; and the hints, which resolve."""

import doctest
import importlib
import inspect
import pydoc
import re
import types
import typing

import pytest
from spinning_nodes import spun_node

from tf2_py.typing import TimeLike
from tf2_ros_cython import _installation

OF_ARRAYS = importlib.import_module("tf2_ros.numpy")
CORRECTION = importlib.import_module("tf2_ros.correction")
# The texts of these modules and of their functions have examples.
WHOLE = [importlib.import_module(name) for name in ("tf2_ros.records", "tf2_ros.serialization")]


def public():
    """The classes and functions of this project that its packages offer, each once, by name."""
    found = {}
    for package in map(importlib.import_module, _installation.PACKAGES):
        for name in dir(package):
            thing = getattr(package, name)
            is_ours = getattr(thing, "__module__", "").partition(".")[0] in _installation.PACKAGES
            if is_ours and not name.startswith("_") and (inspect.isclass(thing) or inspect.isroutine(thing)):
                found[name] = thing
    return found | {name: getattr(OF_ARRAYS, name) for name in OF_ARRAYS.__all__}


PUBLIC = public()
CLASSES = [name for name, thing in PUBLIC.items() if inspect.isclass(thing)]


def examples(thing):
    """The lines to type, and what they print, in the text of a class and of its public methods."""
    members = vars(thing) if inspect.isclass(thing) else {}
    texts = [thing.__doc__, *(m.__doc__ for n, m in members.items() if n[0] != "_" and inspect.isroutine(m))]
    of_bases = {m.__doc__ for base in getattr(thing, "__mro__", ())[1:] for m in vars(base).values()}
    parse = doctest.DocTestParser().get_examples
    return [
        example for text in texts if text not in of_bases for example in parse(inspect.cleandoc(text or ""))
    ]


@pytest.mark.parametrize("name", CLASSES)
def test_a_public_class_has_an_example(name):
    # One of the base shows how to catch an exception, or what a class with other defaults does.
    assert any(examples(cls) for cls in PUBLIC[name].__mro__ if cls in PUBLIC.values())


@pytest.mark.parametrize("name", CLASSES)
def test_the_text_of_a_method_is_that_of_the_base(name):
    # A second one would sooner or later say something else.
    cls = PUBLIC[name]
    for base in [one for one in cls.__mro__[1:] if one in PUBLIC.values()]:
        for of in (of for of in vars(cls) if of in vars(base) and of[0] != "_"):
            text, of_base = (inspect.getdoc(getattr(one, of)) for one in (cls, base))
            assert text == of_base or of_base is None, of


@pytest.mark.parametrize("name", CLASSES)
def test_a_public_method_has_a_text_and_describes_arguments_that_it_has(name):
    for of, method in methods_of(PUBLIC[name]).items():
        if of == "__init__" or inspect.ismethoddescriptor(method) and not hasattr(method, "__annotations__"):
            continue
        assert method.__doc__, of
        described = {text.split()[-1] for text in re.findall(":param ([^:]+):", method.__doc__)}
        if (name, of) != ("BufferInterface", "lookup_transform"):  # a subclass may have options
            assert described <= {*inspect.signature(method).parameters}, of


def test_help_begins_with_the_public_methods():
    """As far as Python allows, which sorts by name: those with underscores are methods of bases."""
    text = pydoc.render_doc(PUBLIC["Buffer"], renderer=pydoc.plaintext)
    names = re.findall(r"^ \|  (?:async )?(\w+)\(.*\n \|      ", text, re.MULTILINE)
    first = names[: names.index("lookup_transform")]
    assert [name for name in first if name.startswith("_")] == ["__init__"]


@pytest.mark.parametrize("name", PUBLIC)
def test_no_text_refers_to_files_that_are_not_installed(name):
    members = vars(PUBLIC[name]).values() if inspect.isclass(PUBLIC[name]) else ()
    assert not [one for one in (PUBLIC[name], *members) if ".md" in (getattr(one, "__doc__", None) or "")]


@pytest.mark.parametrize("name", OF_ARRAYS.__all__)
def test_a_function_of_arrays_has_an_example(name):
    assert examples(PUBLIC[name])


@pytest.mark.parametrize("name", [name for name in PUBLIC if examples(PUBLIC[name])])
def test_an_example_runs_and_prints_what_it_says(name):
    with spun_node("example") as node:
        assert faults(examples(PUBLIC[name]), {"node": node}) == []


@pytest.mark.parametrize("module", WHOLE, ids=lambda module: module.__name__)
def test_the_examples_of_a_module_run_and_print_what_they_say(module):
    assert examples(module)
    for thing in (module, *(getattr(module, name) for name in module.__all__)):
        assert faults(examples(thing), {}) == []


def faults(lines, variables):
    """What these lines of examples print that they do not say."""
    said = []
    # Otherwise it would follow the -v of pytest.
    runner = doctest.DocTestRunner(verbose=False)
    runner.run(doctest.DocTest(lines, variables, "example", None, None, None), out=said.append)
    return said


# Hints.


def methods_of(cls):
    """Those that this project defines, by name; first those of the class, then those of its bases."""
    ours = [base for base in cls.__mro__ if base.__module__.partition(".")[0] in _installation.PACKAGES]
    found = {}
    for name, member in (item for base in ours for item in vars(base).items()):
        member = getattr(member, "__func__", getattr(member, "fget", member))
        if inspect.isroutine(member) and (not name.startswith("_") or name == "__init__"):
            found.setdefault(name, member)
    return found


def hinted():
    """The public classes and functions, also of modules that no package imports, by name."""
    found = dict(PUBLIC)
    for module in (CORRECTION, *WHOLE):
        found |= {name: getattr(module, name) for name in module.__all__}
    return found


HINTED = hinted()
HINTED_CLASSES = {name: thing for name, thing in HINTED.items() if inspect.isclass(thing)}
# Also the public methods of classes.
FUNCTIONS = {name: thing for name, thing in HINTED.items() if inspect.isroutine(thing)} | {
    f"{name}.{of}": method for name, cls in HINTED_CLASSES.items() for of, method in methods_of(cls).items()
}


@pytest.mark.skipif(isinstance(TimeLike, types.UnionType), reason="neither Python 3.12 nor typing_extensions")
@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_signature_names_types_and_not_what_they_stand_for(name):
    assert "HasNanoseconds" not in str(inspect.signature(FUNCTIONS[name]))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_hints_resolve_at_run_time(name):
    hints = typing.get_type_hints(FUNCTIONS[name])
    annotated = inspect.signature(FUNCTIONS[name], eval_str=True)
    assert {*hints} - {"return"} <= {*annotated.parameters}
    annotations = [one.annotation for one in annotated.parameters.values()]
    for one in (*hints.values(), *annotations, annotated.return_annotation):
        assert not isinstance(one, (str, typing.ForwardRef)), one


@pytest.mark.parametrize("name", HINTED_CLASSES)
def test_hints_of_a_class_resolve_at_run_time(name):
    cls = HINTED_CLASSES[name]
    hints = [*typing.get_type_hints(cls).values()]
    if issubclass(cls, tuple):
        parameters = inspect.signature(cls, eval_str=True).parameters
        assert {*parameters} == {*cls._fields}
        hints += [one.annotation for one in parameters.values()]
    assert [one for one in hints if isinstance(one, (str, typing.ForwardRef))] == []
