# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
What Sphinx changes in the pages, for `make docs` and for docs.ros.org.

The pages are plain Markdown, for git hosts, too. The lists of docs/index.md become the table of contents.
"""

import re
from pathlib import Path

INDEX = "docs/index"
# On the site, but not in the table of contents; CONTRIBUTING.md lists them.
FOR_MAINTAINERS = tuple(
    f"docs/development/{one}" for one in ("distribution-packages", "first-release", "proofs")
)
LINK = re.compile(r"\[(?P<text>[^\]]*)\]\((?P<path>[^)\s#:]+)(?P<anchor>#[^)\s]*)?\)")
HEADING = re.compile(r"^## (?P<title>.*)$", re.MULTILINE)


def contents(text: str, is_on_site) -> str:
    """A hidden table of contents for each section of index.md: the pages that its list links to."""
    titles = list(HEADING.finditer(text))
    trees = []
    for title, following in zip(titles, [*titles[1:], None], strict=True):
        section = text[title.end() : following.start() if following else None]
        pages = [
            f"{found['text']} <{found['path'].rpartition('.')[0]}>"
            for found in LINK.finditer(section)
            if is_on_site(found["path"])
        ]
        options = f":hidden:\n:caption: {title['title']}\n"
        trees.append("\n".join(["```{toctree}", options, *pages, "```"]))
    return "\n\n".join(trees)


def read_page(app, name: str, source: list[str]) -> None:
    """Make links to folders, and to files that are not on the site, plain text; git hosts show these."""
    root = Path(app.srcdir)
    page = root / f"{name}.md"
    if not page.exists():
        return  # not Markdown

    def is_on_site(path: str) -> bool:
        target = Path(page.parent, path).resolve()
        if target.suffix not in (".md", ".rst"):
            return target.is_file()
        return target.relative_to(root.resolve()).with_suffix("").as_posix() in app.env.found_docs

    source[0] = LINK.sub(lambda found: found[0] if is_on_site(found["path"]) else found["text"], source[0])
    if name == INDEX:
        source[0] += "\n" + contents(source[0], is_on_site) + "\n"
    elif name in FOR_MAINTAINERS:
        source[0] = f"---\norphan: true\n---\n{source[0]}"  # otherwise, Sphinx warns
