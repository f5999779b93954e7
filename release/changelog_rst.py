# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Write CHANGELOG.rst, which bloom and docs.ros.org read, from the released versions in CHANGELOG.md.

`python -m release.changelog_rst`. The form is REP 132's: a section for each version, without subsections.
"""

import re
import sys
from pathlib import Path

from release import owner

ROOT = Path(__file__).resolve().parent.parent
TITLE = "Changelog for package tf2_ros_cython"
VERSION = re.compile(r"^## (\d+\.\d+\.\d+), (\d{4}-\d{2}-\d{2})\n", re.MULTILINE)
LINK = re.compile(r"\[([^\]]*)\]\(([^)\s]+)\)")


def converted(text, repository):
    """The text of CHANGELOG.rst for that of CHANGELOG.md."""
    _, *sections = VERSION.split(text)
    parts = [_heading(TITLE, "^", over=True)]
    for version, date, body in zip(sections[::3], sections[1::3], sections[2::3], strict=True):
        parts += [_heading(f"{version} ({date})", "-"), _body(body, repository)]
    return "\n".join(parts)


def _heading(title, character, over=False):
    line = character * len(title) + "\n"
    return f"{line if over else ''}{title}\n{line}"


def _body(text, repository):
    # A heading such as Added becomes a paragraph, because sections may not have others in them.
    text = re.sub(r"^### (.*)$", r"\1:", text.strip(), flags=re.MULTILINE)
    spans = re.split(r"(`[^`]+`)", text)
    # Links may have code in their text, which reStructuredText does not allow.
    joined = "".join(f"`{span}`" if span.startswith("`") else span for span in spans)

    def link(found):
        label = " ".join(found[1].replace("`", "").split())
        target = found[2] if "://" in found[2] else f"{repository}/blob/main/{found[2]}"
        return f"`{label} <{target}>`__"

    return LINK.sub(link, joined) + "\n"


def expected(root=ROOT):
    text = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    return converted(text, owner.owner_facts(root)["repository"])


def main():
    (ROOT / "CHANGELOG.rst").write_text(expected(), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
