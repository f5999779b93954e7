# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Write the tables of options and of exit statuses on the pages of the tools.

Run: python tools/docs/option_tables.py

They are the help texts of the commands; a test compares them.
"""

import importlib
import sys
from argparse import SUPPRESS, Action
from functools import partial
from pathlib import Path

DOCS = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS.parent.parent / "docs"))

import source_tables  # noqa: E402

from tf2_ros_tools.common.program import STATUSES  # noqa: E402

PAGES = [*DOCS.glob("*.md"), *(DOCS / "programs").glob("*.md")]
COMMANDS = [path.stem for path in (DOCS.parent / "tf2_ros_tools" / "programs").glob("[!_]*.py")]
# Explained once, on the page about all commands.
COMMON = {"help", "namespace", "live"}


def named(action: Action) -> str:
    """An option with its values, or an argument."""
    values = action.metavar or (f"{{{','.join(map(str, action.choices))}}}" if action.choices else "")
    values = " ".join(values) if isinstance(values, tuple) else values
    values += " ..." if action.nargs in ("*", "+") else ""
    return ", ".join(f"`{f'{option} {values}'.strip()}`" for option in action.option_strings) or f"`{values}`"


def options_of(command: str) -> source_tables.Table:
    """The arguments of a command, with the texts of its help."""
    parser = importlib.import_module(f"tf2_ros_tools.programs.{command}").PARSER
    own = [one for one in parser._actions if one.dest not in COMMON and one.help != SUPPRESS]
    return [["option", "meaning"], *([named(one), str(one.help)] for one in own)]


def statuses() -> source_tables.Table:
    """What the exit statuses of all commands mean."""
    return [["exit status", "meaning"], *([str(status), meaning] for status, meaning in STATUSES.items())]


def renewed(page: Path) -> str:
    """The text of a page with its tables as the commands have them now."""
    made = {f"{command}_options": partial(options_of, command) for command in COMMANDS}
    return source_tables.with_tables(page.read_text(encoding="utf-8"), made | {"statuses": statuses})


if __name__ == "__main__":
    for path in PAGES:
        path.write_text(renewed(path), encoding="utf-8")
