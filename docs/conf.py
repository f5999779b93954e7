"""Settings of Sphinx for the site that `make docs` builds of these pages.

The pages are plain Markdown, for git hosts, too. What the site needs beyond that is made of them here: the
table of contents from the lists of index.md, and the pages from outside this folder. Those of the tools are
here through a link to their folder.
"""

import os
import re
import sys
from pathlib import Path

import tf2_ros
import tf2_ros_tools

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
for package in (tf2_ros, tf2_ros_tools):
    if not Path(package.__file__).is_relative_to(ROOT):
        sys.exit(f"The reference would be that of {package.__file__}, outside {ROOT}: use `make docs`.")

project = "tf2-ros-cython"
author = copyright = "tf2-ros-cython authors"
version = release = tf2_ros.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc"]
root_doc = "index"
myst_heading_anchors = 4  # as git hosts make them

html_theme = "furo"
html_title = project
html_copy_source = False
html_static_path = ["static"]
html_css_files = ["site.css"]

# The reference. The docstrings say what a function takes and returns; testing.md explains the types.
autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_inherit_docstrings = True
python_maximum_signature_line_length = 90

# A reference to a name that is not on the site is a warning.
nitpicky = True

# Pages outside this folder, and their places on the site.
PLACES = {
    ROOT / f"{name}.md": HERE / "site" / f"{name.lower()}.md"
    for name in ("README", "CHANGELOG", "CONTRIBUTING", "SECURITY")
}
TOOLS = ROOT / "tools"
PLACES |= {
    TOOLS / f"{name}.md": HERE / "site" / f"tools-{name.lower()}.md" for name in ("README", "CHANGELOG")
}
LINK = re.compile(r"\[(?P<text>[^\]]*)\]\((?P<path>[^)\s#:]+)(?P<anchor>#[^)\s]*)?\)")
HEADING = re.compile(r"^## (?P<title>.*)$", re.MULTILINE)


def contents(text: str) -> str:
    """A hidden table of contents for each section of index.md: the pages that its list links to."""
    titles = list(HEADING.finditer(text))
    trees = []
    for title, following in zip(titles, [*titles[1:], None], strict=True):
        section = text[title.end() : following.start() if following else None]
        pages = [f"{found['text']} <{found['path'].rpartition('.')[0]}>" for found in LINK.finditer(section)]
        options = f":hidden:\n:caption: {title['title']}\n"
        trees.append("\n".join(["```{toctree}", options, *pages, "```"]))
    return "\n\n".join(trees)


def place(target: Path) -> Path | None:
    """Where a file is on the site; None if it is not on it."""
    if target.is_relative_to(TOOLS / "docs"):
        return HERE / "tools" / target.relative_to(TOOLS / "docs")
    return PLACES.get(target, None if target.suffix == ".md" and not target.is_relative_to(HERE) else target)


def moved_links(text: str, source: Path, page: Path) -> str:
    """The text of a file with links that are right on its page; what is not on the site becomes text."""

    def moved(found: re.Match[str]) -> str:
        target = (source.resolve().parent / found["path"]).resolve()
        if not target.exists():
            return found[0]
        there = place(target)
        if there is None or target.is_dir():
            return found["text"]
        return f"[{found['text']}]({os.path.relpath(there, page.parent)}{found['anchor'] or ''})"

    return LINK.sub(moved, text)


def read_page(app, name: str, source: list[str]) -> None:
    page = HERE / f"{name}.md"
    origin = {place: outside for outside, place in PLACES.items()}.get(page, page)
    if not origin.exists():
        return  # not Markdown
    if origin != page:
        app.env.note_dependency(origin)
        source[0] = origin.read_text(encoding="utf-8")
    source[0] = moved_links(source[0], origin, page)
    if name == root_doc:
        source[0] += "\n" + contents(source[0]) + "\n"


def setup(app) -> None:
    app.connect("source-read", read_page)
