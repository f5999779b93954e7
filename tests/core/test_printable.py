"""Text that anybody may have sent, as people see it."""

from collections import OrderedDict

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tf2_py import BufferCore
from tf2_py._objects.errors import class_name, counted, printable
from tf2_ros_tools import output

pytestmark = pytest.mark.ours

characters = st.characters() | st.sampled_from("\"'\\\n\x1b\0\u202e\u2028 ")


def one_by_one(text):
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


@given(st.text(characters, max_size=20))
def test_what_does_not_print_is_escaped_and_nothing_else_changes(text):
    assert printable(text) == output.printable(text) == one_by_one(text)
    assert printable(text).isprintable()


def test_a_class_is_named_with_its_package():
    assert class_name(OrderedDict) == "collections.OrderedDict"
    assert class_name(BufferCore) == "tf2_py.BufferCore"  # which is defined in a module of that package


@pytest.mark.parametrize(("number", "said"), [(0, "0 frames"), (1, "1 frame"), (2, "2 frames")])
def test_one_thing_is_in_the_singular(number, said):
    assert counted(number, "frame") == said
