# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Write the copyright and the license into the sources that lack them: two lines of SPDX at the top.

`python -m release.license_headers`, or with `--check`, which only names the files. Running it again changes
nothing. Pages, data and what has no comments are in REUSE.toml; `reuse lint` reads both.
"""

import argparse
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# REUSE-IgnoreStart
FACTS = ("SPDX-FileCopyrightText: tf2-ros-cython contributors", "SPDX-License-Identifier: BSD-3-Clause")
# REUSE-IgnoreEnd

HASH, SLASHES, XML = "# {}", "// {}", "<!-- {} -->"
STYLES = {
    **dict.fromkeys(
        (".py", ".pyx", ".pxd", ".pxi", ".pyi", ".sh", ".mk", ".toml", ".yaml", ".yml", ".cfg"), HASH
    ),
    **dict.fromkeys((".c", ".h", ".cpp", ".hpp"), SLASHES),
    ".xml": XML,
}
STYLES_BY_NAME = {"Makefile": HASH, ".ci/run": HASH}
# What must stay in front: a line for the shell, Python's encoding, XML's declaration and its schema.
FIRST = {
    HASH: re.compile(r"(?:#!.*\n)?(?:#.*coding[:=].*\n)?"),
    SLASHES: re.compile(""),
    XML: re.compile(r"(?:<\?.*\?>\n)*"),
}

# What rosbag2 has written.
DATA = ("tools/docs/samples/",)


def header(style):
    """The two lines, as comments of a style."""
    return "".join(f"{style.format(fact)}\n" for fact in FACTS)


def style_of(name):
    """How a file writes comments, by its name; None: it has no place for them, or REUSE.toml has it."""
    return STYLES_BY_NAME.get(name) or STYLES_BY_NAME.get(Path(name).name) or STYLES.get(Path(name).suffix)


def with_header(text, style):
    """A source with its two lines; an empty one has nothing to protect, and stays empty."""
    lines = header(style)
    first = FIRST[style].match(text)[0]
    if not text or text.startswith(first + lines):
        return text
    rest = text[len(first) :]
    # A comment that follows would seem to belong to the two lines.
    between = "\n" if rest.startswith(("#", "//", "/*", "<!--")) else ""
    return f"{first}{lines}{between}{rest}"


def without_header(text, style):
    """The source without what `with_header` adds."""
    lines = header(style)
    first = FIRST[style].match(text)[0]
    if not text.startswith(first + lines):
        return text
    return first + text[len(first + lines) :].removeprefix("\n")


def sources(root=ROOT):
    """The tracked files that have a header, with how they write comments."""
    listed = subprocess.check_output(["git", "ls-files", "-z"], cwd=root, text=True)
    for name in filter(None, listed.split("\0")):
        path, style = root / name, style_of(name)
        if style is not None and path.is_file() and not path.is_symlink() and not name.startswith(DATA):
            yield path, style


def main(arguments=None):
    parser = argparse.ArgumentParser(prog="python -m release.license_headers", description=__doc__)
    parser.add_argument(
        "--check", action="store_true", help="change nothing, and name the files without a header"
    )
    options = parser.parse_args(arguments)
    found = []
    for path, style in sources():
        text = path.read_text(encoding="utf-8")
        if (written := with_header(text, style)) != text:
            found.append(path)
            if not options.check:
                path.write_text(written, encoding="utf-8")
    print(*(path.relative_to(ROOT) for path in found), sep="\n", end="\n" if found else "")
    return 1 if found and options.check else 0


if __name__ == "__main__":
    sys.exit(main())
