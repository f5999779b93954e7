# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The manners that all programs share: help, wrong usage, Ctrl-C, readers who leave, disks that are full."""

import json
import os
import re
import resource
import select
import signal
import subprocess
import sys
import threading
import time

import pytest
from making_bags import Sent, Tf, drive, write_mcap
from processes import run
from starting_programs import ROBOT, broadcasting, ended, heard, needs_dot, running
from times_and_transforms import S
from tool_paths import TOOLS
from tool_project import PYPROJECT
from waiting import DEADLINE_S, until, until_told

from tf2_ros import Buffer

# By program: a valid command line, the exit status after Ctrl-C, and what it writes before it waits.
PROGRAMS = {
    "static_transform_publisher": ("--frame-id map --child-frame-id robot", 0),
    "tf2_bag": ("info drive.mcap", 130),
    "tf2_buffer_server": ("", 0),
    "tf2_check": ("-t 3600", 130),
    "tf2_echo": ("map robot", 130),
    "tf2_monitor": ("", 0),
    "tf2_plot": ("-t 3600", 130),
    "view_frames": ("-t 3600 --text", 130),
}
NODES = [name for name in PROGRAMS if name != "tf2_bag"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current folder, with the files that the command lines name."""
    monkeypatch.chdir(tmp_path)
    write_mcap(tmp_path / "drive.mcap", drive(100))
    return tmp_path


def test_all_programs_have_manners_and_are_installed():
    assert {path.stem for path in (TOOLS / "tf2_ros_tools" / "programs").glob("[!_]*.py")} == {*PROGRAMS}
    # Not from tf2_ros, which imports ROS, and may be another project's.
    scripts = {name: f"tf2_ros_tools.programs.{name}:main" for name in PROGRAMS}
    assert PYPROJECT["project"]["scripts"] == scripts


@pytest.mark.parametrize("name", PROGRAMS)
class TestEveryProgram:
    def test_help_has_an_example_and_imports_no_ros(self, name):
        code = (
            f"import sys; from tf2_ros_tools.programs.{name} import main\n"
            f"try: main(['{name}', '-h'])\n"
            "finally: print({'rclpy', 'numpy', 'tf2_ros', 'textual'} & {*sys.modules}, file=sys.stderr)"
        )
        done = run(sys.executable, "-c", code)
        assert (done.returncode, done.stderr) == (0, "set()\n")
        assert done.stdout.startswith(f"usage: {name} ") and f"\nexample:\n  {name} " in done.stdout
        assert ("--ros-args" in done.stdout) == (name in NODES)
        assert max(map(len, done.stdout.splitlines())) <= 110
        # It says all that it needs: who installed with pip has no folder docs.
        assert "docs/" not in done.stdout and ".md" not in done.stdout

    def test_wrong_usage_is_one_line_and_status_2(self, name):
        status, out, err = ended(name, "--no-such-option")
        assert (status, out, err.count("\n")) == (2, "", 1)
        assert err.startswith(f"{name}: ") and err.endswith(f"(see {name} --help)\n")

    def test_a_reader_who_leaves_ends_it_without_a_word(self, name, monkeypatch):
        monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)
        reading, writing = os.pipe()
        os.close(reading)
        try:
            status, _, err = ended(name, "-h", stdout=writing)
        finally:
            os.close(writing)
        assert err == "" and status in (0, 1)

    def test_ctrl_c_while_it_still_imports_leaves_no_trace(self, name, folder):
        (folder / "tf2_ros.py").write_text(
            "import time\nprint('importing')\nfor _ in range(1000): time.sleep(0.1)\n"
        )
        line = [name, *PROGRAMS[name][0].split()]
        code = (
            f"import sys; sys.path.insert(0, {str(folder)!r})\n"
            f"from tf2_ros_tools.programs.{name} import main\nsys.exit(main({line}))"
        )
        with subprocess.Popen(
            [sys.executable, "-c", code], text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        ) as process:
            assert process.stdout.readline() == "importing\n"
            process.send_signal(signal.SIGINT)
            _, err = process.communicate(timeout=DEADLINE_S)
        assert process.returncode in (130, PROGRAMS[name][1]) and err == ""


@pytest.mark.parametrize("other", ["RuntimeError('Unable to convert')", "ImportError('library')"])
def test_ctrl_c_ends_it_also_where_rclpy_makes_another_error_of_it(other):
    code = (
        "import signal, sys\nfrom tf2_ros_tools.common.program import Parser, run\n"
        "def work(options):\n    try:\n        signal.raise_signal(signal.SIGINT)\n"
        f"    except KeyboardInterrupt:\n        raise {other}\n"
        "sys.exit(run(Parser('program', '', ''), work, ['program'], interrupted=7))"
    )
    done = subprocess.run([sys.executable, "-c", code], text=True, capture_output=True)
    assert (done.returncode, done.stderr) == (7, "")


def test_ctrl_c_ends_it_also_where_python_drops_an_exception():
    code = (
        "import signal, sys\nfrom tf2_ros_tools.common.program import Parser, run\n"
        "class Thing:\n    def __del__(self):\n        signal.raise_signal(signal.SIGINT)\n"
        "def work(options):\n    Thing()\n    while True:\n        sum(range(1000))\n"
        "sys.exit(run(Parser('program', '', ''), work, ['program'], interrupted=7))"
    )
    done = subprocess.run([sys.executable, "-c", code], text=True, capture_output=True, timeout=DEADLINE_S)
    assert (done.returncode, done.stderr) == (7, "")


@pytest.mark.parametrize("name", NODES)
def test_ctrl_c_ends_a_node_once_however_often_it_comes(name, node, folder):
    line, status = PROGRAMS[name]
    options = ["--namespace", "robot_1", "--ros-args", "-r", "__node:=ended"]
    with running(name, *line.split(), *options) as process:

        def users(topic):
            ends = [*node.get_publishers_info_by_topic(topic), *node.get_subscriptions_info_by_topic(topic)]
            return [one.node_name for one in ends]

        until(lambda: users("/robot_1/tf_static"))
        until_told(lambda: "ended" in users("/robot_1/tf_static"))
        assert ("ended", "/robot_1") in node.get_node_names_and_namespaces()
        assert "ended" not in users("/tf_static")
        stop_for_a_while(process)
        for _ in range(3):
            process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == status, err
    assert "Traceback" not in err and "Error" not in err
    until(lambda: "ended" not in [one.node_name for one in node.get_publishers_info_by_topic("/rosout")])


# Stalls: the programs go on, and leave out what they have missed.

STALL_S = 0.3
# For those that print repeatedly, a command line for a rate that cannot be kept, and where they print a time.
FAST = {
    "tf2_echo map base_link 100000": rb"At time (\d+\.\d+)",
    "tf2_monitor --interval 1e-5 --json": rb'{"time": (\d+\.\d+)',
}


def stop_for_a_while(process):
    """Stop a process and let it go on, as Ctrl-Z and `fg` do."""
    process.send_signal(signal.SIGSTOP)
    os.waitid(os.P_PID, process.pid, os.WSTOPPED | os.WNOWAIT)
    threading.Event().wait(STALL_S)
    process.send_signal(signal.SIGCONT)


@pytest.mark.parametrize("line", FAST)
def test_a_program_goes_on_after_it_was_stopped(line):
    reading, writing = os.pipe()
    name, *arguments = line.split()
    printed = bytearray()

    def last_time():
        assert process.poll() is None
        if select.select([reading], [], [], 1.0)[0]:
            printed.extend(os.read(reading, 100_000))
        times = re.findall(FAST[line], printed)
        del printed[:-10_000]
        return float(times[-1]) if times else 0.0

    with broadcasting(), running(name, *arguments, stdout=writing) as process:
        until(last_time)
        stop_for_a_while(process)
        end_s = time.time()
        until(lambda: last_time() > end_s)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=DEADLINE_S)
    for one in (reading, writing):
        os.close(one)
    assert (process.returncode, "Traceback" in err) == (0, False), err


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("tf2_echo --ros-args -p x", "--ros-args: "),
        ("tf2_echo a b --ros-args -r __node:=a-b", "--ros-args: "),
        (
            "tf2_echo a b --namespace x-1",
            "argument --namespace: expected a namespace such as robot1, got 'x-1'",
        ),
        ("tf2_bag", "the following arguments are required: COMMAND (see tf2_bag --help)"),
        ("tf2_bag twice", "argument COMMAND: invalid choice: 'twice'"),
    ],
)
def test_what_is_wrong_is_said(line, said):
    name, *arguments = line.split()
    status, out, err = ended(name, *arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert err.startswith(f"{name}: {said}")


def test_another_tf2_ros_is_named(folder):
    (folder / "tf2_ros.py").write_text("")
    code = "from tf2_ros_tools.programs.tf2_echo import main; raise SystemExit(main(['tf2_echo', 'a', 'b']))"
    done = run(sys.executable, "-c", code, cwd=folder)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (1, "", 1)
    assert done.stderr.startswith("tf2_echo: No module named 'tf2_ros.")
    assert done.stderr.endswith("; tf2_which shows which tf2_ros is imported\n")


def test_another_tf2_py_is_named(folder):
    (folder / "tf2_py.py").write_text("")
    done = run(sys.executable, "-c", "import tf2_ros_tools.programs.tf2_echo", cwd=folder)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (1, "", 1)
    missing = "No module named 'tf2_py.printable'; 'tf2_py' is not a package"
    assert done.stderr.startswith(f"{missing}; tf2_which shows")


def test_a_command_without_the_core_says_in_one_line_that_it_is_missing():
    code = "import sys; sys.modules['tf2_ros_cython'] = None; import tf2_ros_tools.programs.tf2_bag"
    done = run(sys.executable, "-c", code)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == (
        "tf2-ros-tools needs tf2-ros-cython, which this Python does not have: in a clone of tf2-ros-cython, "
        "pip install .\n"
    )


# Names: they cannot steer the terminal, nor pretend to be a line of the program.

HOSTILE = "x\x1b[2J\x7f\x9b1m\u202e\nno problems"
OTHER = os.fsdecode(b"gr\xfcn")  # as Python gets bytes that are not UTF-8
ESCAPED = r"x\x1b[2J\x7f\x9b1m\u202e\nno problems"


def has_no_control_characters(text):
    return all(line.isprintable() for line in text.split("\n"))


@pytest.mark.parametrize("name", ["tf2_bag", "tf2_check"])  # with commands, and without
def test_wrong_arguments_are_shown_without_control_characters(name):
    status, out, err = ended(name, *PROGRAMS[name][0].split(), f"--{HOSTILE.replace(' ', '')}")
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert has_no_control_characters(err) and ESCAPED.partition(r"\n")[0] in err


@pytest.mark.parametrize(
    "line",
    [
        ["tf2_bag", "info", HOSTILE],
        ["tf2_bag", "plot", "drive.mcap", "-o", f"{HOSTILE}.png"],
        ["tf2_bag", "lookup", "drive.mcap", "map", HOSTILE],
        ["tf2_check", "-t", "0.1", "--expect", f"{HOSTILE}.yaml"],
        ["tf2_echo", HOSTILE, "robot", "--wait", "0"],
        ["view_frames", "-t", "0.1", "--tf_topic", HOSTILE],
        ["static_transform_publisher", "0", "0", "0", "0", "0", HOSTILE, "a", "b"],
    ],
    ids=lambda line: " ".join(line[:2]).replace(HOSTILE, "..."),
)
def test_names_on_the_command_line_are_shown_without_control_characters(line, folder):
    (folder / f"{HOSTILE}.yaml").write_text(
        f"frames: {{camera: {{parent: {ascii(HOSTILE)[1:-1]!r}, no: 1}}}}"
    )
    _, out, err = ended(*line)
    assert has_no_control_characters(out + err), out + err
    assert "Traceback" not in err and out + err


def test_the_name_of_a_recording_need_not_be_utf_8(folder):
    os.rename("drive.mcap", f"{OTHER}.mcap")
    status, out, _ = ended("tf2_bag", "info", f"{OTHER}.mcap")
    assert (status, out.partition(":")[0]) == (0, rf"{ascii(OTHER)[1:-1]}.mcap")


@pytest.mark.parametrize(
    ("line", "escaped"),
    [
        ("static_transform_publisher --x 1 --frame-id map --qx 1 --child-frame-id", "'{}'"),
        ("static_transform_publisher 0 0 0 0 0 0 map", "to '{}'"),
        ("tf2_monitor --interval 0.1 map", "RESULTS: for map to {}"),
        ("tf2_echo map", "Waiting for transform map ->  {}: "),
    ],
)
def test_a_name_in_a_log_is_escaped(line, escaped):
    name, *arguments = line.split()
    with running(name, *arguments, HOSTILE, stderr=subprocess.STDOUT) as process:
        lines = [process.stdout.readline()]
        until(lambda: escaped.format(ESCAPED) in lines[-1] or lines.append(process.stdout.readline()))
    assert has_no_control_characters("".join(lines))


@pytest.mark.parametrize(
    "line", ["tf2_check", "tf2_check --json", "view_frames --text", "tf2_echo map a --once"]
)
def test_names_in_messages_are_shown_without_control_characters(line, peer):
    name, *arguments = line.split()
    frames = (HOSTILE, "b", S, 1.0), ("map", HOSTILE, S, 1.0), (HOSTILE, "a", S, 1.0)
    peer().send_without_subscriber(*frames, static=True)
    _, out, err = ended(name, *arguments, hears=heard("a", "b", HOSTILE))
    assert has_no_control_characters(out + err) and out
    if "--json" in line:
        assert HOSTILE in {stream["frame"] for stream in json.loads(out)["streams"]}


# Full disks: what was there before stays.

FILES = {
    "way.csv": "tf2_bag lookup drive.mcap map base --rate 1000 -o {}",
    "way.parquet": "tf2_bag lookup drive.mcap map base --rate 1000 -o {}",
    "tree.gv": "tf2_bag tree drive.mcap -o {}",
    "plot.png": "tf2_bag plot drive.mcap -o {}",
    "frames.gv": "view_frames -o frames.pdf",
    "live.png": "tf2_plot -o {}",
}


@needs_dot
@pytest.mark.parametrize("name", FILES)
def test_a_file_that_cannot_be_written_is_one_line_and_nothing_changes(name, folder):
    if name.endswith(".parquet"):
        pytest.importorskip("pyarrow")
    (folder / name).write_text("before")
    left = sorted(os.listdir(folder))
    line = FILES[name].format(name).split()

    def limit():  # unlike a small file system, it needs no rights
        resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))

    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    with broadcasting():
        status, _, err = ended(*line, hears=ROBOT, preexec_fn=limit, env=environment)
    lines = [one for one in err.splitlines() if "[INFO]" not in one]
    assert (status, len(lines)) == (1, 1), err
    assert name in lines[0] and lines[0].endswith(": File too large"), err
    assert (folder / name).read_text() == "before"
    assert sorted(os.listdir(folder)) == left


def test_a_name_that_the_output_cannot_encode_is_escaped(folder):
    write_mcap(folder / "named.mcap", [Sent(1, "/tf_static", [Tf("wörld", "base", 0)])])
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    status, out, err = ended("tf2_bag", "info", "named.mcap", env=environment)
    assert (status, err) == (0, "") and r"w\xf6rld" in out


def test_a_program_works_without_standard_output(folder):
    status, _, err = ended("tf2_bag", "freeze", "drive.mcap", "-o", "a.tf2", preexec_fn=lambda: os.close(1))
    assert (status, err) == (0, "")
    assert Buffer.open(folder / "a.tf2").can_transform("odom", "base", 0)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no device that is always full")
@pytest.mark.parametrize(
    "line", ["tf2_bag info drive.mcap", "tf2_echo map camera", "tf2_check -t 1", "tf2_monitor"]
)
def test_output_that_cannot_be_written_is_one_line_and_status_1(line, folder):
    name, *arguments = line.split()
    with broadcasting(), open("/dev/full", "w") as full:
        status, _, err = ended(name, *arguments, stdout=full)
    assert (status, err.splitlines()[-1].partition(": ")[2]) == (1, "No space left on device")
    assert "Traceback" not in err
