# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The report of the benchmark, whose sections are measured and renewed one by one."""

from bench import report
from bench.libraries import OURS, Library

LIBRARIES = {OURS: Library(OURS, "tf2-ros-cython", "ours")}
HEAD = report.head(LIBRARIES, ["a machine"], {})


def section(name, ns, remark):
    row = report.Row(name, OURS, "buffer", {"hops": 4}, "ns", [ns])
    return report.section(name, [row], LIBRARIES, [remark])


def test_a_section_replaces_the_one_of_its_title_and_leaves_the_others():
    once = report.with_section(
        report.with_section(HEAD, section("memory", 1000, "a")), section("lookups", 1000, "b")
    )
    again = report.with_section(once, section("lookups", 2000, "c"))
    assert report.head_of(again) == HEAD
    assert [line for line in again.splitlines() if line.startswith(("## ", "- ", "| 4"))] == [
        "- a machine",
        "- tf2-ros-cython: ours",
        f"## {report.TITLES['lookups']}",
        "- c",
        "| 4 hops | 2 |",
        f"## {report.TITLES['memory']}",
        "- a",
        "| 4 hops | 1 |",
    ]
