# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Write the tables of the pages that are made of the sources: `python docs/tables_from_sources.py`.

Tests compare the tables with the sources.
"""

import re
from collections.abc import Callable, Mapping
from pathlib import Path

from tf2_py._objects.log import REFUSALS

DOCS = Path(__file__).resolve().parent
TYPES = DOCS.parent / "tf2_py" / "typing.py"
# A table follows the comment that names it.
PLACE = re.compile(
    r"(?P<head><!-- The table of (?P<name>\w+), by \S+\.py -->\n)(\n\|.*?\n(?=\n|\Z))?", re.DOTALL
)


def refusals() -> list[list[str]]:
    """The reasons for which a buffer refuses a transform."""
    head = ["in the log", "the transform is refused because", 'key in `statistics()["refused"]`']
    return [head, *([f"`{tag}`", reason, f"`{key}`"] for tag, key, reason in REFUSALS)]


def described_types() -> dict[str, str]:
    """The types of arguments, with the comments above them."""
    found = re.findall(r"((?:^#: .*\n)+)^(\w+) =", TYPES.read_text(encoding="utf-8"), re.MULTILINE)
    return {name: comment.replace("\n#: ", "\n").removeprefix("#: ").strip() for comment, name in found}


def with_types(reference: str) -> str:
    """The text of the reference, with the types as the sources have them now."""

    def written(place: re.Match[str]) -> str:
        texts = ((name, text.replace("\n", "\n   ")) for name, text in described_types().items())
        return place["head"] + "".join(f"\n.. py:data:: {name}\n\n   {text}\n" for name, text in texts) + "\n"

    place = r"(?P<head>\.\. The types, by docs/tables_from_sources\.py\n).*?(?=\.\. autoclass)"
    return re.sub(place, written, reference, flags=re.DOTALL)


# A table is its head and its rows.
Table = list[list[str]]
TABLES: Mapping[str, Callable[[], Table]] = {"refusals": refusals}


def with_tables(page: str) -> str:
    """The text of a page, with the tables that it names as the sources have them now."""

    def written(place: re.Match[str]) -> str:
        head, *rows = TABLES[place["name"]]()
        lines = [f"| {' | '.join(row)} |" for row in (head, *rows)]
        lines.insert(1, "|---" * len(head) + "|")
        return place["head"] + "\n" + "\n".join(lines) + "\n"

    return PLACE.sub(written, page)


REFERENCE = DOCS / "api" / "tf2_py.rst"

if __name__ == "__main__":
    REFERENCE.write_text(with_types(REFERENCE.read_text(encoding="utf-8")), encoding="utf-8")
    for path in DOCS.rglob("*.md"):
        path.write_text(with_tables(path.read_text(encoding="utf-8")), encoding="utf-8")
