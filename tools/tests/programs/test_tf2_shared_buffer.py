"""The program tf2_shared_buffer, as a process of its own."""

import os
import sys
from contextlib import contextmanager

import pytest
from making_objects import S, at, translation
from rclpy.duration import Duration
from starting_programs import ended, running
from waiting import DEADLINE_S

pytestmark = pytest.mark.ours

LONG = Duration(seconds=DEADLINE_S)
DOMAIN = os.environ["ROS_DOMAIN_ID"]  # of only this test run
BY_DOMAIN = f"domain-{DOMAIN}"


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
    def test_listeners_that_want_it_read_it(self, tf2_ros, node, peer, monkeypatch):
        monkeypatch.setenv("TF2_SHARED_BUFFER", "auto")  # in the environment of the program, too
        with sharing() as (process, said):
            owner = f"process {process.pid}"
            assert said == (
                f"Sharing /tf and /tf_static of ROS domain {DOMAIN} as '{BY_DOMAIN}': {owner}, keeps 10 s"
            )
            buffer = tf2_ros.Buffer()
            with tf2_ros.TransformListener(buffer, node) as listener:
                peer().send(("map", "robot", S, 1.0))
                assert translation(buffer.lookup_transform("map", "robot", at(1), LONG)) == (1.0, 0.0, 0.0)
                assert f"of the shared buffer '{BY_DOMAIN}' of {owner}>" in repr(listener)
            # A name has one owner.
            refused = f"tf2_shared_buffer: the shared buffer '{BY_DOMAIN}' is owned by {owner}\n"
            assert ended("tf2_shared_buffer") == (1, "", refused)
            assert process.poll() is None

    def test_name_cache_time_and_topics_are_those_asked_for(self, tf2_ros):
        name = f"{BY_DOMAIN}-named"
        asked = ["--name", name, "--cache-time", "50.5", "--ros-args", "-r", "/tf_static:=/mounted"]
        with sharing(*asked) as (process, said):
            assert said == (
                f"Sharing /tf and /mounted of ROS domain {DOMAIN} as '{name}': "
                f"process {process.pid}, keeps 50.5 s"
            )
            assert tf2_ros.Buffer(attach=name).cache_time_ns == 50_500_000_000
