# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the error about an unknown frame says beyond that: which known name may have been meant."""

import math

import pytest
from times_and_transforms import at, transform

from tf2_py import BufferCore
from tf2_py._objects import frame_names

LATEST = at(0)


def knowing(*children):
    """A buffer that knows `map` and these frames."""
    buffer = BufferCore()
    buffer.set_transforms([transform("map", child) for child in children], "test", True)
    return buffer


def reason(buffer, name, other="map"):
    """Why a frame cannot be looked up."""
    return buffer.can_transform_core(name, other, LATEST)[1]


def advice(buffer, name):
    """What is said after the error."""
    return reason(buffer, name).partition("frame does not exist")[2].removeprefix(". ")


@pytest.mark.parametrize(
    ("known", "name", "meant"),
    [
        (["base_link", "odom"], "bas_link", "[base_link]"),
        (["base_link", "odom"], "BASE_LINK", "[base_link]"),
        (["robot1/base_link", "odom"], "base_link", "[robot1/base_link]"),
        (["base_link"], "a_rather_long_namespace/base_link", "[base_link]"),
        (["left_camera", "right_camera", "lidar"], "camera", "[left_camera] or [right_camera]"),
        (["link_1", "link_2", "link_3", "link_4"], "link_22", "[link_2] or [link_4] or [link_3]"),
        (
            ["frame_101", "frame_091", "frame_010", "frame_011", "frame_02"],
            "frame_01",
            "[frame_010] or [frame_011] or [frame_101]",
        ),
        (["arm_camera", "amera", "camera_link"], "camera", "[camera_link] or [amera] or [arm_camera]"),
        (["机器人/激光"], "激光", "[机器人/激光]"),
    ],
)
def test_the_closest_known_names_are_asked_for(known, name, meant):
    assert advice(knowing(*known), name) == f"Did you mean {meant}?"


def test_it_follows_the_text_of_tf2_in_every_error(tf2_py):
    buffer, wrong = knowing("base_link"), "bas_link"
    for call in (
        lambda: buffer.lookup_transform_full_core(wrong, LATEST, "map", LATEST, "map"),
        lambda: buffer.lookup_transform_full_core("map", LATEST, wrong, LATEST, "map"),
        lambda: buffer.lookup_transform_full_core("map", LATEST, "map", LATEST, wrong),
        lambda: buffer.lookup_transforms("map", wrong, [1, 2]),
        lambda: buffer.lookup_matrices("map", wrong, [1, 2]),
        lambda: buffer.lookup_matrix("map", wrong, LATEST),
        lambda: buffer._chain("map", LATEST, "base_link", LATEST, wrong),
        lambda: buffer.get_latest_common_time("map", wrong),
        lambda: buffer.parent(wrong),
        lambda: buffer.children(wrong),
    ):
        with pytest.raises(tf2_py.LookupException, match=r"does not exist\. Did you mean \[base_link\]\?$"):
            call()
    reason = buffer.can_transform_full_core("map", LATEST, "map", LATEST, wrong)[1]
    assert reason.endswith(" - frame does not exist. Did you mean [base_link]?")


def test_it_is_as_new_as_the_frames():
    buffer = knowing("odom")
    assert advice(buffer, "bas_link") == ""
    buffer.set_transform(transform("map", "base_link", 1), "test")
    assert advice(buffer, "bas_link") == "Did you mean [base_link]?"
    buffer.__init__()
    assert advice(buffer, "bas_link") == "The buffer is empty"
    buffer.set_transforms([transform("map", "bas_lin", 1), transform("map", "link", 1)], "test")
    assert advice(buffer, "bas_link") == "Did you mean [bas_lin] or [link]?", "as many frames, others"


@pytest.mark.parametrize("name", ["base_\x1b[31mlink", 'base"link', "base[link", "base]link"])
def test_names_that_programs_would_misread_are_not_shown_as_they_are(name):
    text = reason(knowing(name), "base_link")
    assert text.endswith("frame does not exist")
    text = reason(knowing("base_\nlink"), "base_link")
    assert text.endswith(r"Did you mean [base_\nlink]?")


def test_long_names_and_in_a_big_tree_nothing_is_compared():
    known, wanted = "x" * 101, "x" * 100
    assert advice(knowing(known), wanted) == ""
    assert advice(knowing(wanted), known) == ""
    assert advice(knowing(wanted), "x" * 99) == f"Did you mean [{wanted}]?"
    buffer = knowing(*[f"link_{i}" for i in range(199)])  # and the map
    assert advice(buffer, "lnk_17").startswith("Did you mean [link_17]")
    buffer.set_transform(transform("map", "one_more", 1), "test")
    assert advice(buffer, "lnk_17") == "With more than 200 frames, no similar names are suggested"


def test_a_lookup_that_is_repeated_compares_once_and_what_is_remembered_is_limited(monkeypatch):
    compared, closest = [], frame_names.closest
    monkeypatch.setattr(
        frame_names, "closest", lambda name, known: compared.append(name) or closest(name, known)
    )
    buffer = knowing("base_link")
    names = [f"bas_link{i}" for i in range(65)]
    for name in names:
        assert {advice(buffer, name) for _ in range(3)} == {"Did you mean [base_link]?"}
    assert compared == names
    advice(buffer, names[0])
    assert compared[-1] == names[0]


def test_a_frame_whose_transforms_were_refused_is_not_just_unknown():
    buffer = knowing("base_link")
    refused = transform("base_link", "arm", 1)
    refused.transform.rotation.w = 0.0
    buffer.set_transform(refused, "driver")
    reason_text = "the rotation is too short or too long to be normalized"
    assert advice(buffer, "arm") == f"Transforms of [arm] were refused, because {reason_text}"
    refused.transform.rotation.w = math.nan  # which also has no length
    buffer.set_transform(refused, "driver")
    assert advice(buffer, "arm") == "Transforms of [arm] were refused, because a number is NaN"
    assert advice(buffer, "lidar") == ""
    refused.transform.rotation.w = 1.0
    buffer.set_transform(refused, "driver")
    assert buffer.can_transform_core("arm", "map", LATEST) == (True, "")


def test_what_is_remembered_of_refused_frames_is_limited():
    buffer = knowing("base_link")
    for i in range(200):
        buffer.set_transform(transform(f"part_{i}", f"part_{i}", 1), "driver")
    remembered = [i for i in range(200) if "were refused" in advice(buffer, f"part_{i}")]
    assert 1 <= len(remembered) <= 64
