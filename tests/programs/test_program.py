"""The manners that all programs share."""

import math
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from argparse import ArgumentTypeError
from importlib.util import find_spec
from pathlib import Path

import pexpect
import pytest
from paths import ROOT
from processes import DEADLINE_S, completed, ended, running, until

from tf2_ros_tools.program import (
    Parser,
    finite_number,
    is_negative_number,
    non_negative_number,
    number,
    positive_number,
)

pytestmark = pytest.mark.ours

PROGRAMS = sorted(path.stem for path in (ROOT / "tf2_ros_tools" / "programs").glob("[!_]*.py"))
every_program = pytest.mark.parametrize("name", PROGRAMS)
WITHOUT_NODE = {"tf2_bag"}
NODES = [name for name in PROGRAMS if name not in WITHOUT_NODE]

NUMBERS = """0 1 1. .5 1.5 1e3 1E3 1e+3 1e-3 1e-05 1.e5 .5e1 007 1e999 1e-999 0.1 inf Infinity nan""".split()
NO_NUMBERS = """- + -- . e5 .e5 1e 1e+ 0x1p3 1,5 1.5.5 infi in na nan(1) 1x --1 +-1 x --x""".split()

COLOUR = re.compile(r"\x1b\[\d*m")


def same(one, other):
    if math.isnan(one) or math.isnan(other):
        return math.isnan(one) and math.isnan(other)
    return one == other and math.copysign(1, one) == math.copysign(1, other)


class TestNumbers:
    @pytest.mark.parametrize("text", [sign + text for text in NUMBERS for sign in ("", "+", "-", " -")])
    def test_they_are_those_of_float(self, text):
        assert same(number(text), float(text))

    @pytest.mark.parametrize("text", NO_NUMBERS)
    def test_anything_else_is_refused(self, text):
        with pytest.raises(ArgumentTypeError, match="is not a number"):
            number(text)

    @pytest.mark.parametrize("text", [f"-{text}" for text in NUMBERS])
    def test_a_negative_one_is_a_value_in_every_place(self, text):
        parser = Parser("any", "", "")
        parser.add_argument("first", type=number)
        parser.add_argument("second", nargs="?", type=number)
        parser.add_argument("--x", type=number)
        for line in ([text, text, "--x", text], ["--x", text, text, text], [text, "--x=" + text, text]):
            read = parser.read(["any", *line])
            assert all(same(value, float(text)) for value in (read.first, read.second, read.x))

    def test_options_stay_options(self):
        assert not any(map(is_negative_number, ["-h", "-", "--", "--x", "-n", "-i", "-e5", "x-1", "1"]))

    @pytest.mark.parametrize(
        ("kind", "text", "said"),
        [
            (finite_number, "-inf", "must be finite, not -inf"),
            (finite_number, "nan", "must be finite, not nan"),
            (positive_number, "0", "must be above 0, not 0"),
            (positive_number, "-1e-05", "must be above 0, not -1e-05"),
            (non_negative_number, "-.5", "must not be negative, it is -.5"),
        ],
    )
    def test_what_is_out_of_range_is_told(self, kind, text, said):
        with pytest.raises(ArgumentTypeError, match=said):
            kind(text)

    def test_what_is_in_range_is_taken(self):
        assert (finite_number("-2"), positive_number("2"), non_negative_number("0")) == (-2.0, 2.0, 0.0)


def with_commands():
    parser = Parser("any", "What it does.", "  any one", node=False)
    one = parser.add_command("one", "does one thing", "What one does.", "  any one 1 -x 2")
    one.add_argument("first", type=number)
    one.add_argument("rest", nargs="*", type=number, default=[])
    one.add_argument("-x", type=number)
    parser.add_command("other", "does another thing", "What other does.", "  any other")
    return parser


class TestCommands:
    def test_the_first_argument_says_who_reads_the_others(self):
        read = with_commands().read(["any", "one", "-1", "-x", "-2", "3", "-4"])
        assert (read.command, read.first, read.x, read.rest) == ("one", -1.0, -2.0, [3.0, -4.0])
        assert with_commands().read(["any", "other"]).command == "other"

    @pytest.mark.parametrize(
        ("line", "said"),
        [
            ([], "any: the following arguments are required: COMMAND (see any --help)"),
            (["two"], "any: argument COMMAND: invalid choice: 'two'"),
            (["-x"], "any: the following arguments are required: COMMAND (see any --help)"),
            (["one"], "any one: the following arguments are required: first (see any one --help)"),
            (["one", "x"], "any one: argument first: 'x' is not a number (see any one --help)"),
            (["other", "x"], "any other: unrecognized arguments: x (see any other --help)"),
        ],
    )
    def test_wrong_usage_is_one_line_of_the_command_and_status_2(self, line, said, capsys):
        with pytest.raises(SystemExit) as ended:
            with_commands().read(["any", *line])
        out, err = capsys.readouterr()
        assert (ended.value.code, out, err.count("\n")) == (2, "", 1)
        assert err.startswith(said)

    @pytest.mark.parametrize(
        ("line", "said"),
        [
            (["-h"], ("usage: any [-h] COMMAND", "one       does one thing", "example:\n  any one\n")),
            (["one", "-h"], ("usage: any one [-h]", "What one does.", "example:\n  any one 1 -x 2\n")),
        ],
    )
    def test_each_has_a_help(self, line, said, capsys):
        with pytest.raises(SystemExit) as ended:
            with_commands().read(["any", *line])
        out, err = capsys.readouterr()
        assert (ended.value.code, err) == (0, "")
        assert all(part in out for part in said), out

    def test_what_the_work_refuses_names_the_command(self, tmp_path):
        (tmp_path / "its_work.py").write_text(
            "from tf2_ros_tools.program import UsageError\n"
            "def work(options):\n    raise UsageError('never so')\n"
        )
        code = (
            f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import its_work\n"
            "from tf2_ros_tools.program import Parser, run\n"
            "parser = Parser('any', '', '')\n"
            "parser.add_command('one', '', '', '')\n"
            "sys.exit(run(parser, its_work.work, ['any', 'one']))"
        )
        done = subprocess.run([sys.executable, "-c", code], text=True, capture_output=True)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr == "any one: never so (see any one --help)\n"


DEFERS = """
import os, signal
from tf2_ros_tools.program import deferred_signals, interruptible, sleep

def work(options):
    with deferred_signals():
        os.kill(os.getpid(), signal.SIGTERM)
        print("set up")
        try:
            with interruptible():
                print("interrupted too late")
        finally:
            sleep(0.0)
            print("cleaned up")
"""

WRITES = """
import os, signal
from tf2_ros_tools.program import deferred_signals, sleep

def work(options):
    with deferred_signals():
        os.kill(os.getpid(), signal.SIGTERM)
        print("written")
    sleep(0.0)
    print("went on")
"""

HANGS = """
import os, signal, threading
from tf2_ros_tools import program

def work(options):
    program.FAREWELL_S = -1.0
    with program.deferred_signals():
        os.kill(os.getpid(), signal.SIGINT)
        print("set up")
        os.kill(os.getpid(), signal.SIGINT)
        threading.Event().wait()
"""


class TestSignals:
    @pytest.mark.parametrize(
        ("work", "status", "printed"),
        [
            (DEFERS, 128 + signal.SIGTERM, "set up\ncleaned up\n"),
            (WRITES, 128 + signal.SIGTERM, "written\n"),
            (HANGS, -signal.SIGINT, "set up\n"),
        ],
        ids=[
            "one waits until it may interrupt",
            "or until the program waits",
            "a second one ends what hangs",
        ],
    )
    def test_while_it_is_set_up(self, tmp_path, work, status, printed):
        (tmp_path / "its_work.py").write_text(work)
        code = (
            f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import its_work\n"
            "from tf2_ros_tools.program import Parser, run\n"
            "sys.exit(run(Parser('any', '', ''), its_work.work, ['any']))"
        )
        done = subprocess.run(
            [sys.executable, "-c", code], text=True, capture_output=True, timeout=DEADLINE_S
        )
        assert (done.returncode, done.stdout, done.stderr) == (status, printed, "")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no device that is always full")
def test_output_that_cannot_be_written_is_one_line_and_status_1(tmp_path):
    (tmp_path / "its_work.py").write_text("def work(options):\n    print('result')\n    return 0\n")
    code = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import its_work\n"
        "from tf2_ros_tools.program import Parser, run\n"
        "sys.exit(run(Parser('any', '', ''), its_work.work, ['any']))"
    )
    with open("/dev/full", "w") as full:
        done = subprocess.run([sys.executable, "-c", code], text=True, stdout=full, stderr=subprocess.PIPE)
    assert (done.returncode, done.stderr) == (1, "any: No space left on device\n")


@every_program
class TestEveryProgram:
    def test_help_has_an_example_of_itself(self, name):
        status, out, err = ended(name, "--help")
        assert (status, err) == (0, "")
        assert out.startswith(f"usage: {name} ")
        assert f"\nexample:\n  {name} " in out
        assert ("--ros-args" in out) == (name in NODES)
        assert max(map(len, out.splitlines())) <= 110

    def test_help_imports_no_ros(self, name):
        code = (
            f"import sys; from tf2_ros_tools.programs.{name} import main\n"
            f"try: main(['{name}', '-h'])\n"
            "finally: print({'rclpy', 'numpy', 'tf2_ros', 'textual'} & {*sys.modules}, file=sys.stderr)"
        )
        done = subprocess.run([sys.executable, "-c", code], text=True, capture_output=True, check=True)
        assert done.stdout.startswith(f"usage: {name} ")
        assert done.stderr == "set()\n"

    def test_an_unknown_option_is_one_line_and_status_2(self, name):
        status, out, err = ended(name, "--no-such-option")
        assert (status, out) == (2, "")
        assert err.startswith(f"{name}: ") and err.endswith(f"(see {name} --help)\n")
        assert err.count("\n") == 1

    def test_a_reader_who_leaves_ends_it_without_a_word(self, name):
        reading, writing = os.pipe()
        os.close(reading)
        try:
            status, _, err = ended(name, "-h", stdout=writing)
        finally:
            os.close(writing)
        assert (status, err) == (0, "") or (status, err) == (141, "")

    def test_a_shell_gets_its_options(self, name, tmp_path):
        assert completed(f"{name} --hel", tmp_path) == "--help"

    def test_the_shell_finds_that_it_completes(self, name):
        # argcomplete looks for this in the first 1024 bytes.
        source = (ROOT / "tf2_ros_tools" / "programs" / f"{name}.py").read_text(encoding="utf-8")
        assert "PYTHON_ARGCOMPLETE_OK" in source[:1024]

    def test_where_tf2_ros_is_another_ones_it_says_so_in_one_line(self, name, tmp_path):
        (tmp_path / "tf2_ros.py").touch()
        code = (
            f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n"
            f"from tf2_ros_tools.programs.{name} import main\n"
            f"sys.exit(main({[name, *VALID.get(name, [])]}))"
        )
        done = subprocess.run([sys.executable, "-c", code], text=True, capture_output=True)
        assert (done.returncode, done.stdout) == (1, "")
        assert re.match(rf"{name}( info)?: No module named 'tf2_ros\.", done.stderr), done.stderr
        assert done.stderr.endswith("; tf2_which shows which tf2_ros is imported\n")
        assert done.stderr.count("\n") == 1

    @pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
    def test_a_signal_while_it_still_imports_leaves_no_trace(self, name, how, tmp_path):
        (tmp_path / "tf2_ros.py").write_text("import time; print('importing'); time.sleep(100)\n")
        code = (
            f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n"
            f"from tf2_ros_tools.programs.{name} import main\n"
            f"sys.exit(main({[name, *VALID.get(name, [])]}))"
        )
        with subprocess.Popen(
            [sys.executable, "-c", code], text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        ) as process:
            assert process.stdout.readline() == "importing\n"
            process.send_signal(how)
            _, err = process.communicate(timeout=DEADLINE_S)
        assert (process.returncode, err) == (128 + how, "")


def skip_without_its_library(name):
    if name == "tf2_view" and find_spec("rerun") is None:
        pytest.skip("rerun is not installed")


def check_wrong_ros_arguments(name, *given):
    status, out, err = ended(name, "--ros-args", *given)
    assert (status, out) == (2, "")
    assert err.startswith(f"{name}: --ros-args: ")
    assert err.count("\n") == 1


# One program is enough: all of them start their node by the same code.
@pytest.mark.parametrize("given", [["-p", "x"], ["-r", "__node:=a-b"]])
def test_wrong_values_for_ros_are_one_line_and_status_2(given):
    check_wrong_ros_arguments("tf2_echo", *given)


@pytest.mark.parametrize("name", NODES)
class TestEveryProgramWithANode:
    def test_wrong_arguments_for_ros_are_one_line_and_status_2(self, name):
        check_wrong_ros_arguments(name, "--no-such-option")

    def test_a_namespace_is_that_of_its_node_and_topics(self, name, node):
        skip_without_its_library(name)
        line = [*VALID.get(name, []), "--namespace", "robot_1", "--ros-args", "-r", "__node:=spaced"]
        with running(name, *line) as process:
            until(lambda: ("spaced", "/robot_1") in node.get_node_names_and_namespaces())

            def users(topic):
                ends = [
                    *node.get_publishers_info_by_topic(topic),
                    *node.get_subscriptions_info_by_topic(topic),
                ]
                return [one for one in ends if (one.node_name, one.node_namespace) == ("spaced", "/robot_1")]

            until(lambda: users("/robot_1/tf_static"))
            assert not users("/tf_static")
            process.send_signal(signal.SIGTERM)
            _, err = process.communicate(timeout=DEADLINE_S)
        assert "Traceback" not in err

    def test_what_is_not_a_namespace_is_wrong_usage(self, name):
        status, out, err = ended(name, *VALID.get(name, []), "--namespace", "robot-1")
        said = "argument --namespace: 'robot-1' is not a namespace such as robot1"
        assert (status, out, err) == (2, "", f"{name}: {said} (see {name} --help)\n")

    def test_control_c_in_a_terminal_leaves_no_trace(self, name, node):
        skip_without_its_library(name)
        module = f"tf2_ros_tools.programs.{name}"
        command = ["-m", module, *VALID.get(name, []), "--ros-args", "-r", "__node:=ended"]
        with pexpect.spawn(sys.executable, command, timeout=DEADLINE_S, encoding="utf-8") as terminal:
            until(lambda: "ended" in node.get_node_names())
            if name in SAYS:
                terminal.expect(SAYS[name])
            terminal.sendintr()
            terminal.expect(pexpect.EOF)
            terminal.wait()
        assert terminal.exitstatus == ENDS_WITH.get(name, 0)
        printed = COLOUR.sub("", terminal.before)
        assert "Traceback" not in printed
        assert name in DRAW or re.fullmatch(r"(\[INFO\] .*\r\n(\w.*\r\n)*)*\^C", printed), printed
        # Not by the names of nodes, among which the middleware may keep that of a node that has ended.
        until(lambda: "ended" not in [one.node_name for one in node.get_publishers_info_by_topic("/rosout")])


FOLDER = tempfile.TemporaryDirectory()  # removed when the tests end
# A command line of each program that needs arguments, and the status of one that Ctrl-C ends.
VALID = {
    "static_transform_publisher": ["--frame-id", "map", "--child-frame-id", "robot"],
    "tf2_bag": ["info", "recording.mcap"],
    "tf2_echo": ["map", "robot"],
    "tf2_relay": [os.path.join(FOLDER.name, "relay.yaml")],
    "tf2_state_publisher": [os.path.join(FOLDER.name, "robot.urdf")],
    "tf2_view": ["-o", os.path.join(FOLDER.name, "live.rrd")],
}
Path(*VALID["tf2_relay"]).write_text("- {to: [/relay/tf, /relay/tf_static]}")
Path(*VALID["tf2_state_publisher"]).write_text("<robot name='robot'><link name='base'/></robot>")
# These write more than lines of the log: a table, or what they have counted.
DRAW = {"tf2_monitor", "tf2_relay"}
# The end of what one logs after its node is seen, which must not come after the terminal's ^C.
SAYS = {
    "static_transform_publisher": r"from 'map' to 'robot'[^\n]*\n",
    "tf2_relay": r"Relaying [^\n]*\n",
    "tf2_state_publisher": r"Robot initialized[^\n]*\n",
    "tf2_shared_buffer": r"Sharing [^\n]*\n",
    "tf2_view": r"until interrupted[^\n]*\n",
}
ENDS_WITH = {"tf2_check": 130, "tf2_echo": 130, "tf2_plot": 130, "view_frames": 130}


@pytest.mark.parametrize("name", NODES)
def test_an_argument_that_is_not_utf8_is_one_line(name):
    arguments = [*VALID.get(name, []), "--ros-args", "-r", b"__node:=\xff"]
    command = [sys.executable, "-m", f"tf2_ros_tools.programs.{name}", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE_S)
    said = f"{name}: an argument is not UTF-8: __node:=\\udcff (see {name} --help)\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", said)


# All handle signals by the same function; these two differ in how they usually end.
ENDING = ("static_transform_publisher", "tf2_echo")


@pytest.mark.parametrize(
    "name", [*ENDING, *(pytest.param(name, marks=pytest.mark.long) for name in NODES if name not in ENDING)]
)
def test_a_control_c_that_comes_twice_is_one(name, node):
    skip_without_its_library(name)
    with running(name, *VALID.get(name, []), "--ros-args", "-r", "__node:=ended") as process:
        until(lambda: "ended" in node.get_node_names())
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGTERM)
        # Also while the interpreter ends; after a second one more would kill it.
        begin = time.monotonic()
        while process.poll() is None and time.monotonic() - begin < 0.7:
            process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=DEADLINE_S)
    assert process.returncode in (ENDS_WITH.get(name, 0), 128 + signal.SIGTERM)
    assert "Traceback" not in err
