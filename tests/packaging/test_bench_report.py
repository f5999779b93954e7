# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The report of the benchmark, whose sections are measured and renewed one by one."""

import pytest

from bench import report
from bench.__main__ import SECTIONS
from bench.libraries import OURS, PROGRAMS, Library

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


@pytest.mark.parametrize("name", SECTIONS)
def test_what_measures_a_section_exists_and_the_report_has_a_title_for_it(name):
    module, function = SECTIONS[name].function.split(".")
    assert f"\ndef {function}(" in (PROGRAMS / f"{module}.py").read_text(encoding="utf-8")
    assert name in report.TITLES


def test_no_time_is_written_with_an_exponent():
    rows = [report.Row("lookups", OURS, "buffer", {"hops": hops}, "ns", [999_499 + hops]) for hops in (0, 1)]
    assert "| 0 hops | 999 |\n| 1 hop | 1000 |\n" in report.section("lookups", rows, LIBRARIES, [])
