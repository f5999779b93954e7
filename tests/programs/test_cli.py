"""The programs, as processes of their own."""

import importlib.util
import os
import re
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest
from making import S, at, translation
from paths import ROOT
from processes import DEADLINE_S, ended, running, until
from rclpy.duration import Duration

pytestmark = pytest.mark.ours

LONG = Duration(seconds=DEADLINE_S)
NONE = Duration()
DOMAIN = os.environ["ROS_DOMAIN_ID"]  # of only this test run
BY_DOMAIN = f"domain-{DOMAIN}"
PYPROJECT = ROOT / "pyproject.toml"


def scripts():
    """The programs that an installation brings, as (name, module, function)."""
    section = PYPROJECT.read_text().split("[project.scripts]\n")[1].split("\n[")[0]
    return re.findall(r'^(\w+) = "([\w.]+):(\w+)"$', section, re.MULTILINE)


def test_the_installation_names_a_function_of_each_program():
    programs = {path.stem for path in (PYPROJECT.parent / "tf2_ros_tools" / "programs").glob("[!_]*.py")}
    assert {name for name, _, _ in scripts()} == programs | {"tf2_which"}
    for name, module, function in scripts():
        # Not in tf2_ros, which imports ROS, and may be another project's.
        assert module == ("tf2_ros_cython.which" if name == "tf2_which" else f"tf2_ros_tools.programs.{name}")
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

    def test_the_buffer_size_is_a_parameter(self, client, peer, tf2_py):
        with running("tf2_buffer_server", "--ros-args", "-p", "buffer_size:=5.0"):
            talker = peer()
            talker.send(("map", "robot", S, 1.0))
            client.lookup_transform("map", "robot", at(1), LONG)
            talker.send(("map", "robot", 100 * S, 2.0), ("map", "robot", 101 * S, 2.0))
            client.lookup_transform("map", "robot", at(101), LONG)
            with pytest.raises(tf2_py.ExtrapolationException):
                client.lookup_transform("map", "robot", at(1))

    def test_killed_in_the_middle_of_a_goal_it_is_a_timeout(self, server, tf2_ros, tf2_py, node):
        client = tf2_ros.BufferClient(node, "tf2_buffer_server", timeout_padding=Duration(seconds=0.5))
        assert client.can_transform("map", "map", at(0), LONG)
        task = client.lookup_transform_async("map", "robot", at(1), timeout=Duration(seconds=1))
        task.send(None)
        (pending,) = client._tf2_goal_sender._pending
        until(lambda: client.action_client._pending_result_requests)
        server.kill()
        until(pending.done)
        with pytest.raises(tf2_py.TimeoutException, match="buffer server"):
            task.send(None)
        client.destroy()


def file_of(name):
    return Path(f"/dev/shm/tf2-ros-cython-{os.geteuid()}-{name}")


@contextmanager
def sharing(*arguments, **popen):
    """A tf2_shared_buffer for a `with` statement, and what it says when it has begun."""
    with running("tf2_shared_buffer", *arguments, **popen) as process:
        said = process.stderr.readline().rpartition("]: ")[2].rstrip()
        try:
            yield process, said
        finally:
            # Killed, it would leave its file.
            process.terminate()
            process.communicate(timeout=DEADLINE_S)


@pytest.mark.skipif(sys.platform != "linux", reason="buffers are shared only on Linux")
class TestSharedBuffer:
    @pytest.fixture
    def owner(self):
        with sharing() as (process, said):
            assert said == (
                f"Sharing /tf and /tf_static of ROS domain {DOMAIN} as '{BY_DOMAIN}': "
                f"process {process.pid}, keeps 10 s"
            )
            yield process

    def test_a_listener_that_wants_it_reads_it_and_subscribes_to_nothing(
        self, owner, tf2_ros, node, peer, monkeypatch
    ):
        monkeypatch.setenv("TF2_SHARED_BUFFER", "auto")
        buffer = tf2_ros.Buffer()
        with tf2_ros.TransformListener(buffer, node) as listener:
            talker = peer()
            talker.send(("map", "robot", S, 1.0))
            talker.send(("robot", "camera", 0, 2.0), static=True)
            found = buffer.lookup_transform("map", "camera", at(1), LONG)
            assert translation(found) == (3.0, 0.0, 0.0)
            shared = f"of the shared buffer '{BY_DOMAIN}' of process {owner.pid}>"
            assert repr(listener) == f"<tf2_ros.TransformListener {shared}"
            assert list(node.subscriptions) == []

    def test_name_cache_time_and_topics_are_those_asked_for(self, tf2_ros, tf2_py, peer):
        name = f"{BY_DOMAIN}-named"
        asked = ["--name", name, "--cache-time", "50.5", "--ros-args", "-r", "/tf_static:=/mounted"]
        with sharing(*asked) as (process, said):
            assert said == (
                f"Sharing /tf and /mounted of ROS domain {DOMAIN} as '{name}': "
                f"process {process.pid}, keeps 50.5 s"
            )
            buffer = tf2_ros.Buffer(attach=name)
            talker = peer()
            talker.send(*(("map", "robot", stamp * S, 1.0) for stamp in (1, 2, 51)))
            buffer.lookup_transform("map", "robot", at(51), LONG)
            assert buffer.can_transform("map", "robot", at(1))
            talker.send(*(("map", "robot", stamp * S, 1.0) for stamp in (60, 61)))
            buffer.lookup_transform("map", "robot", at(61), LONG)
            with pytest.raises(tf2_py.ExtrapolationException):
                buffer.lookup_transform("map", "robot", at(1))

    def test_what_its_own_environment_wants_is_without_effect(self, owner, peer):
        name = f"{BY_DOMAIN}-other"
        wanting = {**os.environ, "TF2_SHARED_BUFFER": "auto"}
        with sharing("--name", name, env=wanting) as (process, said):
            assert f" as '{name}': process {process.pid}, " in said
            peer().matched(2)

    def test_a_second_one_of_the_same_name_names_the_first(self, owner):
        said = f"tf2_shared_buffer: the shared buffer '{BY_DOMAIN}' is owned by process {owner.pid}\n"
        assert ended("tf2_shared_buffer") == (1, "", said)
        assert owner.poll() is None and file_of(BY_DOMAIN).exists()
