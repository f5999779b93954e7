"""What the error about an unknown frame says beyond that: which known name may have been meant."""

import pytest
from making import at, transform

pytestmark = pytest.mark.ours

LATEST = at(0)


@pytest.fixture
def new_buffer(tf2_py):
    """Makes buffers that know `map` and these frames."""

    def new(*children):
        buffer = tf2_py.BufferCore()
        buffer.set_transforms([transform("map", child) for child in children], "test", True)
        return buffer

    return new


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
        (["机器人/激光"], "激光", "[机器人/激光]"),
    ],
)
def test_the_closest_known_names_are_asked_for(new_buffer, known, name, meant):
    assert advice(new_buffer(*known), name) == f"Did you mean {meant}?"


def test_it_follows_the_text_of_tf2_in_every_error(tf2_py, new_buffer):
    buffer, wrong, asked = new_buffer("base_link"), "bas_link", "Did you mean [base_link]?"
    for argument, call in (
        ("target_frame", lambda: buffer.lookup_transform_full_core(wrong, LATEST, "map", LATEST, "map")),
        ("source_frame", lambda: buffer.lookup_transform_full_core("map", LATEST, wrong, LATEST, "map")),
        ("fixed_frame", lambda: buffer.lookup_transform_full_core("map", LATEST, "map", LATEST, wrong)),
        ("source_frame", lambda: buffer.lookup_transforms("map", wrong, [1, 2])),
        ("source_frame", lambda: buffer._chain("map", LATEST, wrong, LATEST, "map")),
    ):
        with pytest.raises(tf2_py.LookupException) as caught:
            call()
        said = f'"{wrong}" passed to lookupTransform argument {argument} does not exist. {asked}'
        assert str(caught.value) == said
    for call in (buffer.parent, buffer.children, lambda name: buffer.get_latest_common_time("map", name)):
        with pytest.raises(tf2_py.LookupException, match=r"does not exist. Did you mean \[base_link\]\?$"):
            call(wrong)
    assert buffer.can_transform_full_core("map", LATEST, "map", LATEST, wrong) == (
        0,
        f'Invalid frame ID "{wrong}" passed to canTransform argument fixed_frame - frame does not exist. '
        f"{asked}",
    )


def test_it_is_as_new_as_the_frames(new_buffer):
    buffer = new_buffer("odom")
    assert advice(buffer, "bas_link") == ""
    buffer.set_transform(transform("map", "base_link", 1), "test")
    assert advice(buffer, "bas_link") == "Did you mean [base_link]?"
    buffer.__init__()
    assert advice(buffer, "bas_link") == "The buffer is empty"
    buffer.set_transforms([transform("map", "bas_lin", 1), transform("map", "link", 1)], "test")
    assert advice(buffer, "bas_link") == "Did you mean [bas_lin] or [link]?", "as many frames, others"


@pytest.mark.parametrize("name", ["base_\x1b[31mlink", 'base"link', "base[link", "base]link"])
def test_names_that_programs_would_misread_are_not_shown_as_they_are(new_buffer, name):
    text = reason(new_buffer(name), "base_link")
    assert text.endswith("frame does not exist")
    text = reason(new_buffer("base_\nlink"), "base_link")
    assert text.endswith(r"Did you mean [base_\nlink]?")


def test_long_names_are_not_compared(new_buffer):
    known, wanted = "x" * 101, "x" * 100
    assert advice(new_buffer(known), wanted) == ""
    assert advice(new_buffer(wanted), known) == ""
    assert advice(new_buffer(wanted), "x" * 99) == f"Did you mean [{wanted}]?"


def test_in_a_big_tree_nothing_is_compared(new_buffer):
    frames = [f"link_{i}" for i in range(199)]  # and the map
    buffer = new_buffer(*frames)
    assert advice(buffer, "lnk_17").startswith("Did you mean [link_17]")
    buffer.set_transform(transform("map", "one_more", 1), "test")
    assert advice(buffer, "lnk_17") == ""


@pytest.fixture
def compared(monkeypatch):
    """For which names others were compared with them."""
    from tf2_py._objects import errors

    names, closest = [], errors.closest
    monkeypatch.setattr(errors, "closest", lambda name, known: names.append(name) or closest(name, known))
    return names


def test_a_lookup_that_is_repeated_compares_once_and_what_is_remembered_is_limited(new_buffer, compared):
    buffer = new_buffer("base_link")
    names = [f"bas_link{i}" for i in range(65)]
    for name in names:
        assert {advice(buffer, name) for _ in range(3)} == {"Did you mean [base_link]?"}
    assert compared == names
    advice(buffer, names[0])
    assert compared[-1] == names[0]
