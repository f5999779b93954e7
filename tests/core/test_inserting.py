"""What a BufferCore inserts, and what it refuses."""

import math
import types

import pytest
from making import S, about_z, at, rotation, transform, translation
from ros_optional import Duration

NAN, INF = math.nan, math.inf


@pytest.fixture
def buffer(tf2_py):
    return tf2_py.BufferCore()


def frames(buffer):
    return buffer._getFrameStrings()


REFUSED = {
    "TF_SELF_TRANSFORM": transform("a", "/a", 1),
    "TF_NO_FRAME_ID": transform("/", "b", 1),
    "TF_NO_CHILD_FRAME_ID": transform("a", "", 1),
    "TF_NAN_INPUT": transform("a", "b", 1, (0, NAN, 0)),
    "TF_DENORMALIZED_QUATERNION": transform("a", "b", 1, xyzw=(0, 0, 0, 0)),
}


@pytest.mark.parametrize("tag", REFUSED)
@pytest.mark.parametrize("method", ["set_transform", "set_transform_static"])
def test_a_refusal_is_logged_and_returns_none(buffer, capfd, tag, method):
    assert getattr(buffer, method)(REFUSED[tag], "someone") is None
    assert frames(buffer) == []
    assert tag in capfd.readouterr().err


@pytest.mark.ours
def test_one_line_names_every_reason_the_frames_and_the_authority(buffer, capfd):
    buffer.set_transform(transform("cup", "cup", 1, (NAN, 0, 0), (0, 0, 0, 0)), "grip per")
    line = [x for x in capfd.readouterr().err.splitlines() if "TF_" in x]
    assert len(line) == 1
    for part in ("TF_SELF_TRANSFORM", "TF_NAN_INPUT", "TF_DENORMALIZED_QUATERNION", "cup", "grip per"):
        assert part in line[0]
    assert "TF_NO_FRAME_ID" not in line[0]


def test_old_data_is_refused_with_a_warning_but_registers_its_parent(buffer, capfd):
    buffer.set_transform(transform("map", "odom", 100), "x")
    buffer.set_transform(transform("old_map", "odom", 89.5), "x")
    assert frames(buffer) == ["odom", "map", "old_map"]
    assert "TF_OLD_DATA" in capfd.readouterr().err
    assert not buffer.can_transform_core("old_map", "odom", at(89.5))[0]


@pytest.mark.parametrize("length", [1.5e-154, 1e-150, 1e-20, 1e20, 1e150, 1e154])
def test_a_rotation_of_any_length_whose_square_is_a_normal_number_is_normalised(buffer, length):
    q = about_z(0.7)
    buffer.set_transform(transform("map", "odom", 1, xyzw=tuple(length * x for x in q)), "x")
    assert rotation(buffer.lookup_transform_core("map", "odom", at(1))) == pytest.approx(q, abs=1e-15)
    if hasattr(buffer, "_self_check"):
        buffer._self_check()


class TestDuckTypes:
    def namespace(self, **changes):
        fields = {
            "header": types.SimpleNamespace(stamp=types.SimpleNamespace(nanoseconds=S), frame_id="map"),
            "child_frame_id": "odom",
            "transform": types.SimpleNamespace(
                translation=types.SimpleNamespace(x=1, y=2.0, z=3),
                rotation=types.SimpleNamespace(x=0, y=0, z=0, w=1),
            ),
        }
        return types.SimpleNamespace(**(fields | changes))

    @pytest.mark.ours
    def test_any_object_with_the_fields_is_a_transform(self, buffer):
        buffer.set_transform(self.namespace(), "x")
        assert translation(buffer.lookup_transform_core("map", "odom", at(1))) == (1, 2, 3)

    @pytest.mark.ours
    @pytest.mark.parametrize(
        "changes",
        [
            {"child_frame_id": b"odom"},
            {"child_frame_id": None},
            {"header": None},
            {"transform": types.SimpleNamespace(translation=(1, 2, 3), rotation=(0, 0, 0, 1))},
            {"header": types.SimpleNamespace(stamp=1.0, frame_id="map")},
            {"header": types.SimpleNamespace(stamp=types.SimpleNamespace(sec=1.5, nanosec=0), frame_id="m")},
        ],
    )
    def test_other_objects_are_a_type_error(self, buffer, changes):
        with pytest.raises(TypeError):
            buffer.set_transform(self.namespace(**changes), "x")
        assert frames(buffer) == []

    @pytest.mark.parametrize("missing", ["header", "child_frame_id", "transform"])
    def test_a_missing_attribute_is_an_attribute_error(self, buffer, missing):
        message = self.namespace()
        delattr(message, missing)
        with pytest.raises(AttributeError, match=missing):
            buffer.set_transform(message, "x")
        for nothing in (None, 5):
            with pytest.raises(AttributeError, match="header"):
                buffer.set_transform_static(nothing, "x")
        assert frames(buffer) == []

    @pytest.mark.ours
    def test_a_stamp_beyond_64_bits_is_an_overflow_error(self, buffer):
        for stamp in (
            types.SimpleNamespace(sec=2**63 // S + 1, nanosec=0),
            types.SimpleNamespace(nanoseconds=2**63),
        ):
            message = self.namespace(header=types.SimpleNamespace(stamp=stamp, frame_id="map"))
            with pytest.raises(OverflowError):
                buffer.set_transform(message, "x")

    @pytest.mark.ours
    @pytest.mark.parametrize("name", ["a\0b", "\ud800"])
    def test_a_name_that_is_no_text_is_a_value_error(self, buffer, name):
        with pytest.raises(ValueError):  # UnicodeEncodeError is one
            buffer.set_transform(self.namespace(child_frame_id=name), "x")


@pytest.mark.ours
class TestManyAtOnce:
    def test_a_wrong_element_leaves_the_buffer_as_it_was(self, buffer):
        with pytest.raises(TypeError):
            buffer.set_transforms([transform("map", "odom", 1), "odom"], "x")
        assert frames(buffer) == []

    def test_names_stay_alive_while_later_elements_run_code(self, buffer):
        # A property of a later element drops the only reference to an earlier element's name.
        first = types.SimpleNamespace(**vars(TestDuckTypes().namespace(child_frame_id="o" + "d" * 40)))

        class Evil:
            header = first.header
            transform = first.transform

            @property
            def child_frame_id(self):
                first.child_frame_id = None
                return "evil"

        assert buffer.set_transforms([first, Evil()], "x") == 2
        assert frames(buffer) == ["o" + "d" * 40, "map", "evil"]


class TestConstruction:
    @pytest.mark.ours
    @pytest.mark.parametrize("wrong", ["10", True, object()])
    def test_a_cache_time_that_is_no_duration_is_a_type_error(self, tf2_py, wrong):
        with pytest.raises(TypeError, match="^cache_time: expected a duration or seconds, got "):
            tf2_py.BufferCore(wrong)

    @pytest.mark.ours
    def test_a_negative_cache_time_is_a_value_error(self, tf2_py):
        with pytest.raises(ValueError, match="expected 0 or more"):
            tf2_py.BufferCore(Duration(seconds=-1))

    @pytest.mark.ours
    def test_init_again_with_a_wrong_cache_time_changes_nothing(self, buffer):
        buffer.set_transform(transform("map", "odom", 1), "x")
        with pytest.raises(ValueError):
            buffer.__init__(Duration(seconds=-1))
        assert buffer.can_transform_core("map", "odom", at(1)) == (1, "")
