# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Write the results of `make prove` into pages: a page of all of them, and the places that other pages mark.

All of it follows from the steps and `release/proofs.json`, on every machine; a test compares the pages with
them.
"""

import re
import shlex
from pathlib import Path

PAGE = Path("docs", "development", "proofs.md")
MARKED_PAGES = ("docs/development/reliability.md", "QUALITY_DECLARATION.md")
PLACE = re.compile(r"(<!-- proved: (\w+), by make prove -->).*?(<!-- end -->)", re.DOTALL)
PAGE_HEAD = """# Proofs

What was run, on which commit, and with which result? `make prove` writes this page. It runs each step whose
files have changed since it passed; `make prove OPTIONS=--list` names these steps. A step without tests counts
as one.

"""
COUNTS = ("passed", "failed", "skipped")
# The version of rclpy, its release, and where it is from.
RELEASES = {
    "rclpy-3.3.21-on-jazzy": ("3.3.21", "Humble", "its published source, with Jazzy's other packages"),
    "wheels of jazzy": ("7.1.5", "Jazzy", "PyPI (the wheel `ros-rclpy` 7.1.6)"),
    "rclpy-7.1.11-jazzy": ("7.1.11", "Jazzy", "its published source, with PyPI's other packages"),
    "wheels of kilted": ("9.1.2", "Kilted", "PyPI"),
    "rclpy-9.1.5-kilted": ("9.1.5", "Kilted", "its published source, with PyPI's other packages"),
    "rclpy-10.0.10-on-kilted": ("10.0.10", "Lyrical", "its published source, with Kilted's other packages"),
    "rclpy-11.0.0-on-kilted": ("11.0.0", "Rolling", "its published source, with Kilted's other packages"),
}


def page(found, kept):
    """The page with a row for each step."""
    more = ("minutes", "commit", "date", "machine")
    rows = [(one.name, f"`{shlex.join(one.command)}`", *_cells(kept.get(one.name), *more)) for one in found]
    return f"{PAGE_HEAD}{_table(('step', 'command', *COUNTS, *more), rows)}"


def with_proofs(text, kept):
    """The text of a page, with what the results say where it marks that."""
    return PLACE.sub(lambda place: place[1] + PROVED[place[2]](kept) + place[3], text)


def without_proofs(text):
    """The text of a page that does not depend on results."""
    return PLACE.sub(r"\1\3", text)


def _nodes(kept):
    steps = {f"tests of nodes, {name}": facts for name, facts in RELEASES.items()}
    steps["tests of nodes, Cyclone DDS"] = ("7.1.5", "Jazzy", "PyPI, with Cyclone DDS")
    more = ("commit", "date")
    head = ("rclpy", "release", "from", *COUNTS, *more)
    rows = [(*facts, *_cells(kept.get(name), *more)) for name, facts in steps.items()]
    return f"\n\n{_table(head, rows)}\n"


def _coverage(kept):
    result = kept.get("coverage", {})
    if "covered" not in result:
        return "not run"
    cython, python = (result["covered"][kind] for kind in ("Cython", "Python"))
    return (
        f"the short tests of `tests/core` and `tests/ros` ran {cython}, of Cython in all processes, "
        f"and {python}, of Python in their own process (commit {result['commit']}, {result['date']})"
    )


PROVED = {"nodes": _nodes, "coverage": _coverage}


def _cells(result, *more):
    """What a row says of a result; None: there is none."""
    keys = (*COUNTS, *more)
    if result is None or "lacks" in result:
        said = "not run" if result is None else f"not had: {result['lacks']}"
        return [said, *[""] * (len(keys) - 1)]
    return [value if isinstance(value := result[key], str) else f"{value:,}" for key in keys]


def _table(head, rows):
    lines = [f"| {' | '.join(row)} |" for row in (head, *rows)]
    lines.insert(1, "|---" * len(head) + "|")
    return "\n".join(lines) + "\n"
