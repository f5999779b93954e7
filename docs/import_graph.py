# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Print the packages by layer, and what each imports and cimports."""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests" / "support"))

from project_sources import PACKAGES, imports, modules  # noqa: E402

CIMPORTS, IMPORTS = "══►", "──►"


def table() -> list[str]:
    """The packages of the table in internals.md, without tests, measurements and the build."""
    page = (ROOT / "docs" / "development" / "internals.md").read_text(encoding="utf-8")
    rows: list[str] = re.findall(r"^\| `([\w.]+)` \|", page.partition("\n## Packages\n")[2], re.MULTILINE)
    return [name for name in rows if name.startswith(PACKAGES)]


def chapters(name: str) -> list[str]:
    """What an extension includes, in that order: first headers without code; empty if it has no chapters."""
    headers, included = (
        re.findall(r'^include "(.+?)(?:_header)?\.pxi"$', path.read_text(encoding="utf-8"), re.MULTILINE)
        if path.exists()
        else []
        for path in (ROOT / f"{name.replace('.', '/')}.{suffix}" for suffix in ("pxd", "pyx"))
    )
    return [one for one in headers if one not in included] + included


def edges() -> dict[str, dict[str, bool]]:
    """Which packages each package uses, and whether it also cimports them."""
    packages = table()
    extension_of = {
        f"{name.partition('.')[0]}.{chapter.partition('/')[0]}": name
        for name in packages
        for chapter in chapters(name)
    }

    def package_of(module: str) -> str:
        parts = [name for name in packages if f"{module}.".startswith(f"{name}.")]
        longest = max(parts, key=len, default="")
        return extension_of.get(longest, longest)

    found: dict[str, dict[str, bool]] = {name: {} for name in packages if name not in extension_of}
    for module, paths in modules().items():
        user = package_of(module)
        for one in (one for path in paths for one in imports(path)) if user else ():
            used = package_of(one.module)
            if used and used != user:
                found[user][used] = found[user].get(used, False) or one.is_cimport
    return found


def layers(found: dict[str, dict[str, bool]]) -> list[list[str]]:
    """The packages from the lowest layer up; those that use each other share a layer."""
    below = {name: set(used) for name, used in found.items()}
    for name in below:
        for one in below:
            if name in below[one]:
                below[one] |= below[name]
    placed: list[list[str]] = []
    rest = list(found)
    while rest:
        placed.append([one for one in rest if all(one in below[used] for used in below[one] & set(rest))])
        rest = [one for one in rest if one not in placed[-1]]
    return placed


def drawing() -> str:
    """The packages by layer, the highest first; those with the same arrows share a line."""
    found = edges()
    placed = layers(found)
    lines: dict[tuple[int, str], list[str]] = {}
    for number in range(len(placed), 0, -1):
        for name in placed[number - 1]:
            parts = [
                f"{arrow} {', '.join(used)}"
                for arrow, is_cimported in ((CIMPORTS, True), (IMPORTS, False))
                if (used := [one for one in reversed(found) if found[name].get(one) == is_cimported])
            ]
            if included := [chapter.partition("/") for chapter in chapters(name)]:
                parts.append(f"= {included[0][0]}: {', '.join(chapter for _, _, chapter in included)}")
            lines.setdefault((number, "  ".join(parts)), []).append(name)
    return "\n".join(
        f"{number} {', '.join(names):18} {parts}".rstrip() for (number, parts), names in lines.items()
    )


if __name__ == "__main__":
    print(drawing())
