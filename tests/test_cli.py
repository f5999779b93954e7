"""The programs, as processes of their own."""

import importlib.util
import re
import signal
from pathlib import Path

import pytest
from making import S, at, translation
from processes import DEADLINE_S, running, until
from rclpy.action import ActionClient
from rclpy.duration import Duration

from tf2_msgs.action import LookupTransform

pytestmark = pytest.mark.ours

LONG = Duration(seconds=DEADLINE_S)
NONE = Duration()
PYPROJECT = Path(__file__).resolve().parent.parent / "pyproject.toml"


def scripts():
    """The programs that an installation brings, as (name, module, function)."""
    section = PYPROJECT.read_text().split("[project.scripts]\n")[1].split("\n[")[0]
    return re.findall(r'^(\w+) = "([\w.]+):(\w+)"$', section, re.MULTILINE)


def test_the_installation_names_a_function_of_each_program():
    programs = {path.stem for path in (PYPROJECT.parent / "tf2_ros_cython" / "cli").glob("[!_]*.py")}
    assert {name for name, _, _ in scripts()} == programs | {"tf2_which"}
    for name, module, function in scripts():
        # Not in tf2_ros, which imports ROS, and may be another project's.
        assert module == ("tf2_ros_cython.which" if name == "tf2_which" else f"tf2_ros_cython.cli.{name}")
        assert importlib.util.find_spec(module) is not None
        assert callable(getattr(importlib.import_module(module), function))


class TestBufferServer:
    @pytest.fixture
    def server(self):
        with running("tf2_buffer_server") as process:
            yield process

    @pytest.fixture
    def client(self, tf2_ros, node):
        client = tf2_ros.BufferClient(node, "tf2_buffer_server")
        yield client
        client.destroy()

    def test_it_answers_from_what_it_hears(self, server, client, peer, tf2_py):
        talker = peer()
        talker.send(("map", "robot", S, 1.0), ("map", "robot", 100 * S, 2.0), ("map", "robot", 120 * S, 3.0))
        assert translation(client.lookup_transform("map", "robot", at(1), LONG)) == (1.0, 0.0, 0.0)
        with pytest.raises(tf2_py.LookupException, match="does not exist"):
            client.lookup_transform("map", "nobody", at(1))
        can, reason = client.can_transform("map", "robot", at(121), NONE, True)
        assert can is False
        assert "extrapolation into the future" in reason

    def test_it_is_found_by_its_names(self, server, node):
        seen = ActionClient(node, LookupTransform, "/tf2_buffer_server")
        assert seen.wait_for_server(DEADLINE_S)
        seen.destroy()
        until(lambda: ("tf_buffer", "/") in node.get_node_names_and_namespaces())

    def test_the_buffer_size_is_a_parameter(self, client, peer, tf2_py):
        with running("tf2_buffer_server", "--ros-args", "-p", "buffer_size:=5.0"):
            talker = peer()
            talker.send(("map", "robot", S, 1.0))
            client.lookup_transform("map", "robot", at(1), LONG)
            talker.send(("map", "robot", 100 * S, 2.0), ("map", "robot", 101 * S, 2.0))
            client.lookup_transform("map", "robot", at(101), LONG)
            with pytest.raises(tf2_py.ExtrapolationException):
                client.lookup_transform("map", "robot", at(1))

    def test_a_negative_buffer_size_is_told(self):
        with running("tf2_buffer_server", "--ros-args", "-p", "buffer_size:=-1.0") as process:
            _, err = process.communicate(timeout=DEADLINE_S)
        assert process.returncode == 2
        assert "buffer_size must not be negative, it is -1.0 s" in err
        assert "Traceback" not in err

    @pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
    def test_a_signal_ends_it_without_a_trace(self, server, client, how):
        assert client.can_transform("map", "map", at(0), LONG)
        server.send_signal(how)
        out, err = server.communicate(timeout=DEADLINE_S)
        assert (server.returncode, out) == (0, "")
        assert "Traceback" not in err

    def test_killed_in_the_middle_of_a_goal_it_is_a_timeout(self, server, tf2_ros, tf2_py, node):
        client = tf2_ros.BufferClient(node, "tf2_buffer_server", timeout_padding=Duration(seconds=0.5))
        assert client.can_transform("map", "map", at(0), LONG)
        task = client.lookup_transform_async("map", "robot", at(1), timeout=Duration(seconds=1))
        task.send(None)
        (pending,) = client._goal_sender._pending
        until(lambda: pending.handle is not None)
        server.kill()
        until(pending.outcome.done)
        with pytest.raises(tf2_py.TimeoutException, match="buffer server"):
            task.send(None)
        client.destroy()
