# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The command line of a process with hidden nodes renames only its own node, as launch does."""

import re
import subprocess
from contextlib import contextmanager

import pytest
from processes import start
from waiting import DEADLINE_S, until, until_told

HIDDEN = ["_buffer_client_impl", "transform_listener_impl", "transform_listener_impl"]


@contextmanager
def running(*rules):
    arguments = [argument for rule in rules for argument in ("-r", rule)]
    process = start("makes_hidden_nodes.py", "--ros-args", *arguments, stdin=subprocess.PIPE)
    try:
        yield
        process.stdin.close()
        process.wait(DEADLINE_S)
    finally:
        process.kill()
        process.wait()


def nodes(node, namespace):
    """The names of the others in a namespace; of hidden ones without their numbers."""
    found = [name for name, at in node.get_node_names_and_namespaces() if at == namespace]
    return sorted(re.sub("_impl_[0-9a-f]{10,}$", "_impl", name) for name in found if name != node.get_name())


def listening(node, topic):
    """The names of the nodes that subscribe to a topic; of hidden ones without their numbers."""
    found = [info.node_name for info in node.get_subscriptions_info_by_topic(topic)]
    return sorted(re.sub("_impl_[0-9a-f]{10,}$", "_impl", name) for name in found)


@pytest.mark.parametrize("rule", ["__node:=robot", "__name:=robot", "driver:__node:=robot"])
def test_only_the_nodes_of_the_program_get_the_name(node, rule):
    with running(rule):
        until(lambda: node.count_subscribers("/tf") == 2)
        until_told(lambda: nodes(node, "/") == sorted([*HIDDEN, "robot"]))


def test_no_rule_for_names_is_needed(node):
    with running("/elsewhere:=/nowhere"):
        until(lambda: node.count_subscribers("/tf") == 2)
        until_told(lambda: nodes(node, "/") == sorted([*HIDDEN, "driver"]))


def test_rules_for_namespaces_and_topics_apply(node):
    with running("__node:=robot", "__ns:=/arm", "/tf:=tf"):
        until(lambda: node.count_subscribers("/arm/tf") == 2)
        until_told(lambda: nodes(node, "/arm") == sorted([*HIDDEN, "robot"]))
        until_told(lambda: listening(node, "/arm/tf") == ["transform_listener_impl"] * 2)
        assert nodes(node, "/") == [] and listening(node, "/tf") == []


def test_a_rule_for_a_topic_of_one_node_leaves_hidden_ones_alone(node):
    with running("__node:=robot", "robot:/tf:=/other"):
        until(lambda: node.count_subscribers("/tf") == 2)
        until_told(lambda: listening(node, "/tf") == ["transform_listener_impl"] * 2)
        assert listening(node, "/other") == []
