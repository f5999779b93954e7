# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Text that anybody may have sent, as people see it."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from times_and_transforms import at, transform

from tf2_py.printable import printable

characters = st.characters() | st.sampled_from("\"'\\\n\x1b\0\u202e\u2028 ")


def one_by_one(text):
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


@given(st.text(characters, max_size=20))
def test_what_does_not_print_is_escaped_and_nothing_else_changes(text):
    assert printable(text) == one_by_one(text)
    assert printable(text).isprintable()


@given(st.text(characters, min_size=1, max_size=6).filter(lambda name: "\0" not in name))
@example("\x1b[31mred\n\u202e\U000e0001")
def test_every_text_of_a_buffer_prints(tf2_py, name):
    name = "n" + name.encode("utf-8", "ignore").decode()
    buffer = tf2_py.BufferCore()
    buffer.set_transform(transform("map", name, 5), name)
    for parent, child in (("moon", "crater" + name), ("a" + name, "b" + name), ("b" + name, "a" + name)):
        buffer.set_transform(transform(parent, child, 1), name)
    texts = [buffer.all_frames_as_string(), buffer.tree()]
    kinds = set()
    for source, seconds in (("nowhere" + name, 1), (name, 6), ("crater" + name, 1), ("a" + name, 1)):
        with pytest.raises(tf2_py.TransformException) as caught:
            buffer.lookup_transform_core("map", source, at(seconds))
        kinds.add(type(caught.value).__name__)
        texts += [str(caught.value), buffer.can_transform_core("map", source, at(seconds))[1]]
    assert kinds == {"LookupException", "ExtrapolationException", "ConnectivityException"}
    for text in texts:
        assert text.replace("\n", "").isprintable()
        assert printable(name) in text
    dot = buffer._allFramesAsDot()  # in which backslashes are doubled
    assert dot.replace("\n", "").isprintable()
