"""Settings of Sphinx for the site that `make docs` builds of these pages.

The pages are plain Markdown, for git hosts, too. What the site needs beyond that is made of them here: the
table of contents from the lists of index.md, and the two pages from outside this folder.
"""

import re
import sys
from pathlib import Path

import tf2_ros

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
if not Path(tf2_ros.__file__).is_relative_to(ROOT):
    sys.exit(f"The reference would be that of {tf2_ros.__file__}, which is outside {ROOT}: use `make docs`.")

project = "tf2-ros-cython"
author = copyright = "tf2-ros-cython authors"
version = release = tf2_ros.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc"]
root_doc = "index"
myst_heading_anchors = 4  # as git hosts make them

html_theme = "furo"
html_title = project
html_copy_source = False

# The reference. The docstrings say what a function takes and returns; types.md explains the types.
autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_inherit_docstrings = False
python_maximum_signature_line_length = 90

# A reference to a name that is not on the site is a warning.
nitpicky = True

# Pages outside this folder, and their places on the site.
OUTSIDE = {"CONTRIBUTING.md": "site/contributing.md", "SECURITY.md": "site/security.md"}
LINK_LINE = re.compile(r"^- \[[^\]]*\]\((?P<path>[^)#]+)\)", re.MULTILINE)
HEADING = re.compile(r"^## (?P<title>.*)$", re.MULTILINE)


def contents(text: str) -> str:
    """A hidden table of contents for each section of index.md: the pages that its list links to."""
    titles = list(HEADING.finditer(text))
    trees = []
    for title, following in zip(titles, [*titles[1:], None], strict=True):
        section = text[title.end() : following.start() if following else None]
        pages = [OUTSIDE.get(path.removeprefix("../"), path) for path in LINK_LINE.findall(section)]
        if pages:
            options = f":hidden:\n:caption: {title['title']}\n"
            trees.append(
                "\n".join(["```{toctree}", options, *(page.rpartition(".")[0] for page in pages), "```"])
            )
    return "\n\n".join(trees)


def read_page(app, page: str, source: list[str]) -> None:
    if page == root_doc:
        source[0] += "\n" + contents(source[0]) + "\n"
    for outside, inside in OUTSIDE.items():
        source[0] = source[0].replace(f"](../{outside}", f"]({inside}")
        if inside.removesuffix(".md") == page:
            app.env.note_dependency(ROOT / outside)
            source[0] = (ROOT / outside).read_text(encoding="utf-8").replace("](docs/", "](../")


def setup(app) -> None:
    app.connect("source-read", read_page)
