"""A full disk: every program that writes says so in one line, and leaves what was there."""

import importlib
import os
import resource
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from making import transform
from making_bags import drive, write_mcap
from processes import DEADLINE_S, broadcasting, needs_dot, program

from tf2_py import BufferCore

pytestmark = pytest.mark.ours

BEFORE = "what was there before"


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return str(write_mcap(tmp_path_factory.mktemp("bag") / "drive.mcap", drive(100)))


@pytest.fixture(scope="module", autouse=True)
def fonts():
    """Matplotlib writes down once which fonts there are; where it cannot, it says so."""
    with suppress(ImportError):
        importlib.import_module("matplotlib.font_manager")


@pytest.fixture
def full(tmp_path):
    """A folder on a small file system; the reason of its errors; and what a program is to begin with."""
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=16k", "tmpfs", tmp_path], capture_output=True, text=True
    )
    if mounted.returncode:
        pytest.skip(f"no small file system can be mounted here: {mounted.stderr.strip()}")
    try:
        (tmp_path / "rest").write_bytes(bytes(12 << 10))
        yield tmp_path, "No space left on device", None
    finally:
        subprocess.run(["umount", "--lazy", tmp_path], check=True)


@pytest.fixture
def limited(tmp_path):
    """The same of a folder where the limits of the process let no file become large: that needs no rights."""
    return tmp_path, "File too large", limit_size


def limit_size():
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))


def ended(command, arguments, limit, **popen):
    # Python leaves half of a compiled module where a file may not become large, and reads it the next time.
    popen["env"] = {**os.environ, **popen.get("env", {}), "PYTHONDONTWRITEBYTECODE": "1"}
    process = program(command, *map(str, arguments), preexec_fn=limit, **popen)
    try:
        out, err = process.communicate(timeout=3 * DEADLINE_S)  # to import what draws takes seconds
    finally:
        process.kill()
        process.communicate()
    return process.returncode, out, err


def refuses_to_write(command, arguments, place, name):
    """It writes nothing, and tells why."""
    folder, reason, limit = place
    target = folder / name
    target.write_text(BEFORE)
    left = sorted(os.listdir(folder))
    status, _, err = ended(command, arguments, limit)
    # Kilted's Fast DDS says that the limit leaves no shared memory.
    lines = [line for line in err.splitlines() if "[INFO]" not in line and "RTPS_" not in line]
    assert (status, len(lines)) == (1, 1), err
    assert str(target) in lines[0] and lines[0].endswith(f": {reason}"), err
    assert target.read_text() == BEFORE
    assert sorted(os.listdir(folder)) == left


OF_BAGS = {
    "way.csv": "lookup {bag} map base --rate 1000 -o {target}",
    "way.tum": "lookup {bag} map base --rate 1000 -o {target}",
    "way.npz": "lookup {bag} map base --rate 1000 -o {target}",
    "way.parquet": "lookup {bag} map base --rate 1000 -o {target}",
    "tree.gv": "tree {bag} -o {target}",
    "plot.png": "plot {bag} -o {target}",
    "plot.svg": "plot {bag} --path map base -o {target}",
    "robot.rrd": "view {bag} -o {target}",
}


NEEDED = {"robot.rrd": "rerun", "way.parquet": "pyarrow"}


@pytest.mark.parametrize("name", OF_BAGS)
def test_programs_for_recordings(recording, limited, name):
    if name in NEEDED:
        pytest.importorskip(NEEDED[name])
    words = OF_BAGS[name].format(bag=recording, target=limited[0] / name).split()
    refuses_to_write("tf2_bag", words, limited, name)


def test_a_report_for_machines(recording, limited):
    folder, reason, limit = limited
    target = folder / "junit.xml"
    target.write_text(BEFORE)
    status, _, err = ended("tf2_bag", ["check", recording, "--junit", target], limit)
    # As for a folder that does not exist, what was asked of it cannot be done.
    assert (status, err) == (2, f"tf2_bag check: {target}: {reason} (see tf2_bag check --help)\n")
    assert (target.read_text(), os.listdir(folder)) == (BEFORE, ["junit.xml"])


def test_a_disk_that_is_full(recording, full):
    for name in ("way.csv", "plot.png"):
        words = OF_BAGS[name].format(bag=recording, target=full[0] / name).split()
        refuses_to_write("tf2_bag", words, full, name)
        (full[0] / name).unlink()


@needs_dot
def test_a_picture_of_a_tree(recording, limited):
    refuses_to_write("tf2_bag", ["tree", recording, "-o", limited[0] / "tree.svg"], limited, "tree.svg")


@pytest.mark.parametrize(("name", "output"), [("view_frames", "frames.gv"), ("tf2_plot", "plot.png")])
def test_programs_that_listen(limited, name, output):
    target = limited[0] / output.replace(".gv", ".pdf")
    with broadcasting():
        refuses_to_write(name, ["-t", "2", "-o", target], limited, output)


def test_many_recordings(recording, limited):
    pytest.importorskip("pyarrow")
    pytest.importorskip("distributed")
    folder, reason, limit = limited
    status, out, err = ended(
        "tf2_bag", ["batch", Path(recording).parent, "--lookup", "map", "base", "--out", folder], limit
    )
    assert status == 1, (out, err)
    assert "Traceback" not in err and reason in err, err
    assert [name for name in os.listdir(folder) if name not in ("rest", "findings.txt")] == []


def test_a_buffer_is_saved_whole_or_not_at_all(tmp_path):
    buffer = BufferCore()
    for i in range(200):
        buffer.set_transform(transform("map", f"f{i}", 1), "test")
    path = tmp_path / "buffer.mcap"
    path.write_text(BEFORE)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(OSError, match="File too large") as refused:
            buffer.save(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert refused.value.filename == str(path)
    assert (path.read_text(), os.listdir(tmp_path)) == (BEFORE, ["buffer.mcap"])


# Standard output.


def tf2_which(stdout):
    """Run it to its end: exit status and errors."""
    command = [sys.executable, "-m", "tf2_ros_cython"]
    done = subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True, timeout=DEADLINE_S)
    return done.returncode, done.stderr


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no device that is always full")
class TestOutput:
    def test_of_tf2_which(self):
        with open("/dev/full", "w") as full:
            status, err = tf2_which(full)
        assert (status, err) == (1, "tf2_which: No space left on device\n")

    @pytest.mark.parametrize(
        ("name", "arguments"),
        [("tf2_echo", ["map", "camera"]), ("tf2_check", ["-t", "1"]), ("tf2_monitor", [])],
    )
    def test_of_programs_that_listen(self, name, arguments):
        with broadcasting(), open("/dev/full", "w") as full:
            status, _, err = ended(name, arguments, None, stdout=full)
        assert (status, err.splitlines()[-1]) == (1, f"{name}: No space left on device")
        assert "Traceback" not in err


def test_a_reader_who_leaves_ends_tf2_which_without_a_word():
    reading, writing = os.pipe()
    os.close(reading)
    try:
        status, err = tf2_which(writing)
    finally:
        os.close(writing)
    assert (status, err) == (128 + signal.SIGPIPE, "")
