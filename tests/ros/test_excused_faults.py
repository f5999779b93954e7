# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Which faults of rclpy and of the middleware tests go on after, and that they say so."""

import subprocess
import sys
import warnings

import pytest
from excused_faults import ATTEMPTS, KnownFault, accept, fault_in, tried

pytestmark = pytest.mark.ours

TRACEBACK = """\
Traceback (most recent call last):
  File "/home/me/example.py", line 3, in main
    rclpy.spin(node)
  File "{}", line 88, in {}
    something()
{}
"""
OURS, RCLPY = "/home/me/tf2_ros/buffer.py", "/opt/ros/lib/python3.12/site-packages/rclpy/executors.py"
STACK = """\
Timeout (0:00:30)!
Thread 0x00007f5c6cb4c740 (most recent call first):
  File "{}", line 1 in {}
  File "/home/me/forks.py", line 2 in child
"""
ENDS = "rmw_fastrtps_shared_cpp19destroy_participantEP21CustomParticipantInfo"
STACK_IN_C = """\
/lib/x86_64-linux-gnu/libc.so.6(+0x3c050)[0x7f88d3c5a050]
/opt/ros/lib/libfastrtps.so.2.14(_ZN8eprosima7fastdds3dds17DomainParticipant12{}+0x15)[0x7f88d2ae8efa]
/opt/ros/lib/librmw_fastrtps_shared_cpp.so(_ZN23{}+0x24)[0x7f88d302cc84]
/opt/ros/lib/librmw_fastrtps_cpp.so(rmw_destroy_node+0x107)[0x7f88d31cb0f7]
"""
INTERRUPT = TRACEBACK.format(OURS, "lookup_transform", "KeyboardInterrupt")
OF_RCLPY = TRACEBACK.format(RCLPY, "add_node", "RuntimeError: Unable to convert")
OF_OURS = TRACEBACK.format(OURS, "set_transform", "RuntimeError: broken")
DROPPED = "{}:9: RuntimeWarning: failed to send response (timeout): client will not receive it\n"


@pytest.mark.parametrize(
    "errors",
    [
        OF_RCLPY,
        f"{INTERRUPT}\nDuring handling of it:\n\n{OF_RCLPY}",
        STACK.format(RCLPY, "create_subscription"),
        STACK_IN_C.format("set_listenerEPNS1_25DomainParticipantListenerE", ENDS),
    ]
    + [DROPPED.format(RCLPY)],
)
def test_a_fault_is_known_by_whose_code_raised_or_hangs(errors):
    assert fault_in(errors)


@pytest.mark.parametrize(
    "errors",
    [
        "",
        "[ERROR] rclpy: broken\n",
        "Traceback (most recent call last):\nMemoryError\n",
        OF_OURS,
        INTERRUPT,
        OF_RCLPY + OF_OURS,
        OF_OURS + OF_RCLPY,
    ]
    + [
        STACK_IN_C.format("get_subscriberEv", ENDS),
        STACK_IN_C.format("set_listenerEPNS1_25DomainParticipantListenerE", "destroy_subscription"),
    ]
    + [STACK.format(OURS, "create_subscription"), STACK.format(RCLPY, "spin"), DROPPED.format(OURS)],
)
def test_what_this_project_raises_is_none(errors):
    assert fault_in(errors) is None


@pytest.mark.parametrize(("faults", "attempts"), [(0, 1), (1, 2), (ATTEMPTS + 1, ATTEMPTS)])
def test_an_attempt_is_repeated_only_after_a_fault_and_the_summary_says_so(faults, attempts):
    left = iter([OF_RCLPY] * faults + [OF_OURS])
    made = []

    def attempt():
        made.append(subprocess.CompletedProcess([], 1, stderr=next(left)))
        return made[-1]

    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        assert tried(attempt) is made[-1]
    assert len(made) == attempts
    assert [(one.category, str(one.message)) for one in said] == [
        (KnownFault, "raised in rclpy: RuntimeError: Unable to convert")
    ] * min(faults, ATTEMPTS)


def test_only_an_exception_of_rclpys_own_code_is_accepted(ros):
    node = ros.create_node("destroyed")
    node.destroy_node()
    with pytest.warns(KnownFault, match="^InvalidHandle raised in rclpy's "):
        try:
            node.get_node_names_and_namespaces()
        except ros.exceptions.InvalidHandle as error:
            accept(error)
    with pytest.raises(ZeroDivisionError):
        try:
            sys.exit(1 // 0)
        except ZeroDivisionError as error:
            accept(error)
