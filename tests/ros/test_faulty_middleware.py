# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
What a middleware may lack is done without.

`interposed/faulty_middleware.c` takes it away from the one that the tests run with.
"""

from interposed_libraries import output_with_library


def test_where_arrivals_are_not_reported_executors_take_the_messages(tmp_path):
    fault = {"TF2_TEST_MIDDLEWARE": "no_arrivals"}
    printed = output_with_library(
        "faulty_middleware", tmp_path, program="uses_unknown_rclpy", **fault
    ).splitlines()
    assert (printed[0], printed[-1]) == ("without an executor: nothing", "threads of listeners")


def test_a_message_without_memory_delays_no_others(tmp_path):
    """Nothing reports those that waited behind it again, and no other message arrives."""
    fault = {"TF2_TEST_MIDDLEWARE": "no_memory_once"}
    printed = output_with_library("faulty_middleware", tmp_path, program="takes_after_failure", **fault)
    assert printed == "received: second third\n"


def test_what_is_reported_and_is_no_message_was_not_lost(tmp_path):
    """Not even after a queue has overflowed."""
    fault = {"TF2_TEST_MIDDLEWARE": "two_reports"}
    printed = output_with_library("faulty_middleware", tmp_path, program="takes_after_overflow", **fault)
    assert printed == "taken: 6, lost since the overflow: 0\n"
