"""A buffer in a recording of rerun: what is read back, and what its viewer draws."""

import re
import signal
from urllib.request import urlopen

import numpy as np
import pytest
from making_bags import S, Sent, Tf, drive, raw
from numpy.testing import assert_allclose
from starting_programs import broadcasting, ended, running
from waiting import DEADLINE_S, until

import tf2_ros_tools.rerun
from tf2_py import BufferCore, LookupException
from tf2_ros_tools.rerun import Live

pytestmark = [pytest.mark.ours, pytest.mark.long("needs rerun")]

rr = pytest.importorskip("rerun")
RrdReader = pytest.importorskip("rerun.chunk").RrdReader

BEGIN = 1_700_000_000 * S
FLOAT32 = {"rtol": 1e-6, "atol": 1e-6}


def buffer_of(*moving):
    buffer = BufferCore()
    buffer.set_transforms_cdr(raw(Sent(0, "/tf", moving)), "test")
    return buffer


def driving():
    """map -> odom -> base -> (static) camera and lidar."""
    buffer = BufferCore()
    for one in drive(begin_ns=BEGIN):
        buffer.set_transforms_cdr(raw(one), "test", one.topic == "/tf_static")
    return buffer


class Logged:
    """
    What a recording holds.

    `static` and `moving`: by entity, lists of rows, dicts of the components without their archetype; a row of
    `moving` has its `stamp` in ns, too.
    """

    def __init__(self, path):
        self.static, self.moving = {}, {}
        for chunk in RrdReader(path).stream():
            of = self.static if chunk.is_static else self.moving
            for row in chunk.to_record_batch().to_pylist():
                rows = of.setdefault(chunk.entity_path, [])
                rows.append({key.rpartition(":")[2]: value for key, value in row.items() if ":" in key})
                if not chunk.is_static:
                    rows[-1]["stamp"] = row["stamp"].value
        self.static.pop("/__properties", None)


@pytest.fixture
def logged(tmp_path):
    """A function: a buffer is saved, with options of `log`, and read back."""

    def save_and_read(buffer, **how):
        path = tmp_path / "buffer.rrd"
        tf2_ros_tools.rerun.save(buffer, path, **how)
        return Logged(path)

    return save_and_read


def the(row, component):
    [value] = row[component]
    return value


def transforms_of(rows):
    return [row for row in rows if row.get("translation")]


def test_every_sample_is_logged_at_its_stamp_between_its_frames(logged):
    buffer = driving()
    found = logged(buffer)
    assert set(found.moving) == {"/tf_samples"}
    rows = found.moving["/tf_samples"]
    assert [row["stamp"] for row in rows] == sorted(row["stamp"] for row in rows)
    for parent, name in (("map", "odom"), ("odom", "base")):
        own = [row for row in rows if the(row, "child_frame") == name]
        stamps = np.array([row["stamp"] for row in own])
        assert len(own) == buffer.frames()[name].count == 20
        translations, rotations = buffer.lookup_transforms(parent, name, stamps)
        assert_allclose([the(row, "translation") for row in own], translations, **FLOAT32)
        assert_allclose([the(row, "quaternion") for row in own], rotations, **FLOAT32)
        assert {the(row, "parent_frame") for row in own} == {parent}
    assert len(transforms_of(found.static["/tf/camera"])) == 1
    with_axes = {path for path, rows in found.static.items() if any(row.get("axis_length") for row in rows)}
    assert with_axes == {f"/tf/{name}" for name in buffer.frames()}


def test_a_frame_that_changed_its_parent_is_below_the_one_that_each_sample_names(logged):
    moves = [Tf("table", "cup", BEGIN, (1, 0, 0)), Tf("hand", "cup", BEGIN + S, (2, 0, 0))]
    moves += [Tf("room", "table", BEGIN), Tf("room", "hand", BEGIN)]
    rows = [
        row for row in logged(buffer_of(*moves)).moving["/tf_samples"] if the(row, "child_frame") == "cup"
    ]
    below = [(the(row, "parent_frame"), the(row, "translation")[0]) for row in rows]
    assert below == [("table", 1), ("hand", 2)]


def test_any_name_of_a_frame_comes_back(logged):
    names = ["robot1/base link", "robot1", "ü", "a:b[0]", "\\", "tf", "two\nlines", "."]
    found = logged(buffer_of(*(Tf("map", name, BEGIN + i) for i, name in enumerate(names))))
    rows = found.moving["/tf_samples"]
    assert [(the(row, "child_frame"), row["stamp"] - BEGIN) for row in rows] == [
        (name, i) for i, name in enumerate(names)
    ]
    placed = {the(row, "frame") for rows in found.static.values() for row in rows if row.get("frame")}
    assert placed == {"map", *names}


def test_the_root_of_the_largest_tree_stands_still_unless_another_frame_is_chosen(logged):
    buffer = driving()
    buffer.set_transforms_cdr(raw(Sent(0, "/tf", [Tf("a", "b", BEGIN)])), "test")
    assert the(logged(buffer).static["/tf"][0], "frame") == "map"
    assert the(logged(buffer, origin="base").static["/tf"][0], "frame") == "base"


def test_the_current_recording_is_logged_to(tmp_path):
    recording = rr.RecordingStream("of a program")
    recording.save(tmp_path / "own.rrd")
    with recording:
        tf2_ros_tools.rerun.log(driving())
    recording.disconnect()
    assert set(Logged(tmp_path / "own.rrd").moving) == {"/tf_samples"}


def test_an_unknown_origin_is_refused(tmp_path):
    with pytest.raises(LookupException, match="nobody"):
        tf2_ros_tools.rerun.save(driving(), tmp_path / "buffer.rrd", origin="nobody")
    assert list(tmp_path.iterdir()) == []


class Robot:
    """A buffer that is filled step by step, and what is sent of it."""

    def __init__(self, folder, **how):
        self.buffer, self.path = BufferCore(), folder / "live.rrd"
        self.live = Live(self.buffer, **how)
        self.live.recording.save(self.path)

    def send(self, *transforms, static=False):
        self.buffer.set_transforms_cdr(raw(Sent(0, "/tf", list(transforms))), "test", static)
        self.live.send()

    def read(self):
        self.live.recording.disconnect()
        return Logged(self.path)


class TestLive:
    def test_each_sample_is_sent_once(self, tmp_path):
        one = Robot(tmp_path)
        for i in range(5):
            ns = BEGIN + i * S // 10
            same = [Tf("odom", "base", ns + 7), Tf("odom", "base", ns + 9)]
            one.send(Tf("map", "odom", ns), *same)
            one.live.send()
        rows = transforms_of(one.read().moving["/tf_samples"])
        assert [(row["stamp"] - BEGIN, the(row, "child_frame")) for row in rows] == [
            (i * S // 10 + k, name) for i in range(5) for k, name in ((0, "odom"), (7, "base"), (9, "base"))
        ]

    def test_a_static_transform_is_sent_again_only_if_it_changes(self, tmp_path):
        one = Robot(tmp_path)
        for x in (1.0, 1.0, 2.0):
            one.send(Tf("base", "camera", 0, (x, 0.0, 0.0)), static=True)
        rows = transforms_of(one.read().static["/tf/camera"])
        assert [the(row, "translation")[0] for row in rows] == [1.0, 2.0]

    def test_after_the_clock_jumped_back_what_arrives_is_sent(self, tmp_path):
        one = Robot(tmp_path)
        for ns in (BEGIN + 10 * S, BEGIN + 11 * S):
            one.send(Tf("map", "odom", ns))
        one.buffer.clear()
        one.send(Tf("map", "odom", BEGIN))
        one.send(Tf("map", "odom", BEGIN + 1))
        stamps = [row["stamp"] - BEGIN for row in one.read().moving["/tf_samples"]]
        assert sorted(stamps) == [0, 1, 10 * S, 11 * S]

    def test_a_trail_leads_where_the_frame_was_without_a_break(self, tmp_path):
        one = Robot(tmp_path, trails=["camera", "nobody"])
        one.send(Tf("base", "camera", 0, (0.0, 0.0, 1.0)), static=True)
        for i in range(6):
            ns = BEGIN + i * S // 10
            one.send(Tf("odom", "base", ns, (float(i), 0.0, 0.0)))
            if i % 2:  # until it arrives, the camera's place at the newer stamp is unknown
                one.send(Tf("map", "odom", ns, (0.0, float(i), 0.0)))
        found = one.read()
        rows = found.moving["/trails/map/camera"]
        strips = np.array([the(row, "strips") for row in rows])
        stamps = np.array([row["stamp"] for row in rows])
        places, _ = one.buffer.lookup_transforms("map", "camera", stamps)
        assert len(stamps) == 5  # from the first stamp with an answer
        assert_allclose(strips[:, 1], places, **FLOAT32)
        assert_allclose(strips[1:, 0], strips[:-1, 1])
        assert the(found.static["/trails/map/camera"][-1], "frame") == "map"
        # As long as nothing was known above it, odom was the origin.
        assert len(found.moving["/trails/odom/camera"]) == 2


@pytest.fixture
def viewer_home(monkeypatch, tmp_path):
    """A home whose rerun reports to nobody that it is used."""
    settings = tmp_path / "home" / ".config" / "rerun" / "analytics.json"
    settings.parent.mkdir(parents=True)
    settings.write_text('{"analytics_enabled": false, "analytics_id": "tests", "metadata": {}}')
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for variable in ("XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        monkeypatch.delenv(variable, raising=False)


@pytest.mark.parametrize("display", [None, ":54321"], ids=["none", "one that is not there"])
def test_without_a_screen_tf2_view_names_the_options_that_need_none(display, viewer_home, monkeypatch):
    for variable in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(variable, raising=False)
    if display is not None:
        monkeypatch.setenv("DISPLAY", display)
    status, out, err = ended("tf2_view")
    assert (status, out) == (1, "")
    said = r"tf2_view: the viewer of rerun did not open: there is no screen \([^()/]*\)"
    assert re.fullmatch(f"{said}; --web and -o FILE do not need a screen", err.splitlines()[-1])


def test_a_running_robot_is_written_until_interrupted_and_an_unknown_frame_told(tmp_path):
    path = tmp_path / "live.rrd"
    options = ("-o", str(path), "--trail", "camera", "camra", "--origin", "/map")
    with broadcasting(), running("tf2_view", *options) as process:
        lines = iter(process.stderr.readline, "")
        assert any("there is no frame camra; did you mean camera?" in line for line in lines)
        until(lambda: path.exists() and path.stat().st_size > 100_000)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0 and "not known" not in err, err
    found = Logged(path)
    assert {"/tf/map", "/tf/odom", "/tf/base_link", "/tf/camera"} <= set(found.static)
    assert {the(row, "child_frame") for row in found.moving["/tf_samples"]} == {"odom", "base_link"}
    stamps = [row["stamp"] for row in found.moving["/trails/map/camera"]]
    assert len(stamps) > 10 and stamps == sorted(set(stamps))


def test_a_browser_is_served_until_interrupted(viewer_home, tmp_path, monkeypatch):
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    log = tmp_path / "view.log"
    with log.open("w") as errors, running("tf2_view", "--web", stderr=errors) as process:
        [page] = until(lambda: re.findall(r"The viewer is at (\S+)", log.read_text()))
        with urlopen(page, timeout=DEADLINE_S) as answer:
            assert b"<title>Rerun" in answer.read()
        process.send_signal(signal.SIGINT)
        process.wait(DEADLINE_S)
    assert process.returncode == 0, log.read_text()
