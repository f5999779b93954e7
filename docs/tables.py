"""
Write the tables of the pages that are made of the sources: `python docs/tables.py`.

`tools/docs/options.py` does so for the pages of the tools. Tests compare the tables with the sources.
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


def types() -> list[list[str]]:
    """The types of arguments, with the comments that the reference shows."""
    found = re.findall(r"((?:^#: .*\n)+)^(\w+) =", TYPES.read_text(encoding="utf-8"), re.MULTILINE)
    rows = [
        [f"`{name}`", comment.replace("\n#: ", " ")[3:].strip().replace("``", "`")] for comment, name in found
    ]
    return [["type", "what it stands for"], *rows]


# A table is its head and its rows.
Table = list[list[str]]
TABLES: Mapping[str, Callable[[], Table]] = {"refusals": refusals, "types": types}


def with_tables(page: str, tables: Mapping[str, Callable[[], Table]] = TABLES) -> str:
    """The text of a page, with the tables that it names as the sources have them now."""

    def written(place: re.Match[str]) -> str:
        head, *rows = tables[place["name"]]()
        lines = [f"| {' | '.join(row)} |" for row in (head, *rows)]
        lines.insert(1, "|---" * len(head) + "|")
        return place["head"] + "\n" + "\n".join(lines) + "\n"

    return PLACE.sub(written, page)


if __name__ == "__main__":
    for path in DOCS.glob("*.md"):
        path.write_text(with_tables(path.read_text(encoding="utf-8")), encoding="utf-8")
