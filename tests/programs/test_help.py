"""What `help` says: every public class has an example, which runs; lookups begin with the direction."""

import doctest
import importlib
import inspect
import re

import pytest
from sources import PACKAGES
from spinning import spun_node

pytestmark = pytest.mark.ours

PUBLIC_PACKAGES = [name for name in PACKAGES if name not in ("tf2_ros_tools", "tf2_ros_cython")]
OF_ARRAYS = importlib.import_module("tf2_ros.numpy")


def public():
    """The classes and functions of this project that its packages offer, each once, by name."""
    found = {}
    for package in map(importlib.import_module, PUBLIC_PACKAGES):
        for name in dir(package):
            thing = getattr(package, name)
            is_ours = getattr(thing, "__module__", "").partition(".")[0] in PUBLIC_PACKAGES
            if is_ours and not name.startswith("_") and (inspect.isclass(thing) or inspect.isroutine(thing)):
                found[name] = thing
    return found | {name: getattr(OF_ARRAYS, name) for name in OF_ARRAYS.__all__}


PUBLIC = public()
CLASSES = [name for name, thing in PUBLIC.items() if inspect.isclass(thing)]


def examples(thing):
    """The lines to type, and what they print, in the text of a class and of its public methods."""
    members = vars(thing) if inspect.isclass(thing) else {}
    texts = [thing.__doc__, *(m.__doc__ for n, m in members.items() if n[0] != "_" and inspect.isroutine(m))]
    parse = doctest.DocTestParser().get_examples
    return [example for text in texts for example in parse(inspect.cleandoc(text or ""))]


@pytest.mark.parametrize("name", CLASSES)
def test_a_public_class_has_an_example(name):
    cls = PUBLIC[name]
    # One of the base shows how to catch an exception.
    bases = [base for base in cls.__mro__ if base in PUBLIC.values() and issubclass(base, Exception)]
    assert any(examples(thing) for thing in (cls, *bases))


@pytest.mark.parametrize("name", OF_ARRAYS.__all__)
def test_a_function_of_arrays_has_an_example(name):
    assert examples(PUBLIC[name])


@pytest.mark.parametrize("name", [name for name, thing in PUBLIC.items() if examples(thing)])
def test_an_example_runs_and_prints_what_it_says(name):
    with spun_node("example") as node:
        test = doctest.DocTest(examples(PUBLIC[name]), {"node": node}, name, None, None, None)
        said = []
        # Otherwise it would follow the -v of pytest.
        doctest.DocTestRunner(verbose=False).run(test, out=said.append)
    assert said == []


LOOKUPS = [
    (cls, f"lookup_transform{full}{'_core' if cls == 'BufferCore' else ''}")
    for cls in ("Buffer", "BufferClient", "BufferInterface", "BufferCore")
    for full in ("", "_full")
]


@pytest.mark.parametrize(("cls", "method"), LOOKUPS)
def test_the_help_of_a_lookup_begins_with_the_direction_and_the_latest_time(cls, method):
    text = words_before_parameters(getattr(PUBLIC[cls], method))
    first = text.split(". ")[0]
    assert first.startswith("Get the pose of ``source_frame``") and "in ``target_frame``" in first
    assert re.search("data from (the )?source to (the )?target", text)
    assert re.search(r"``Time\(\)``, which is 0, (asks for|means) the latest time", text)


def words_before_parameters(function):
    return " ".join(inspect.getdoc(function).partition(":param")[0].split())


TAKE_TIMEOUT = [
    (cls, name)
    for cls in ("Buffer", "BufferClient", "BufferInterface")
    for name, member in inspect.getmembers(PUBLIC[cls], inspect.isfunction)
    if not name.startswith("_") and "timeout" in inspect.signature(member).parameters
]


@pytest.mark.parametrize(("cls", "name"), TAKE_TIMEOUT)
def test_the_help_of_what_takes_a_timeout_says_what_the_default_does(cls, name):
    method = getattr(PUBLIC[cls], name)
    waits = inspect.signature(method).parameters["timeout"].default is None
    assert ("Without ``timeout`` it waits forever." if waits else "``timeout`` does not wait.") in (
        words_before_parameters(method)
    )


TRANSFORMING = [name for name in PUBLIC if name.startswith("do_transform_")]


@pytest.mark.parametrize("name", TRANSFORMING)
def test_the_help_of_what_transforms_says_from_where_to_where(name):
    text = inspect.getdoc(PUBLIC[name])
    while "from the child frame of ``transform`` to its parent frame" not in " ".join(text.split()):
        # That of a stamped message refers to the one without a header.
        text = inspect.getdoc(PUBLIC[re.search(r"as ``(do_transform_\w+)`` does", text)[1]])


def test_what_transforms_does_carry_data_from_the_child_to_the_parent(tf2_ros):
    from geometry_msgs.msg import PointStamped, TransformStamped

    mount = TransformStamped(child_frame_id="camera")
    mount.header.frame_id, mount.transform.translation.x = "base_link", 0.3
    buffer = tf2_ros.Buffer()
    buffer.set_transform_static(mount, "me")
    found = buffer.lookup_transform("base_link", "camera", tf2_ros.Time())
    moved = PUBLIC["do_transform_point"](PointStamped(), found)
    assert (moved.header.frame_id, moved.point.x) == ("base_link", 0.3)
