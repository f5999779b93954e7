# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Write the owner's facts, which are in owner.toml beside this file, into the files that need them.

`python -m release.owner`; running it again changes nothing.
"""

import re
import subprocess
import sys
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parent.parent
PLACEHOLDER = "example.org"
# PyPI shows these, so their links must be absolute.
SHOWN_BY_PYPI = ("README.md", "tools/README.md", "messages/README.md")
# To a file beside the page, or to one of a repository whose address has changed.
LINK = re.compile(
    r"(?P<image>!?)(?P<text>\[[^\]]*\])\("
    r"(?:https://[^)\s]+/(?:blob|raw|tree)/main/(?P<of_root>[^)\s#]+)|(?![a-z]+:|#)(?P<path>[^)\s#]+))"
    r"(?P<anchor>#[^)\s]*)?\)"
)


def owner_facts(root=ROOT):
    """The values of owner.toml."""
    return tomllib.loads((root / "release" / "owner.toml").read_text(encoding="utf-8"))


def placeholders(facts):
    """What the owner has not filled in, one line each."""
    return [
        f"release/owner.toml: {name} = {value!r}"
        for name, value in facts.items()
        if PLACEHOLDER in str(value)
    ]


def stale(root=ROOT):
    """The files that do not contain the owner's facts, with the texts that do."""
    facts = owner_facts(root)
    found = {}
    for name in tracked_files(root):
        if (changes := _changes(name, facts)) or name in SHOWN_BY_PYPI:
            text = (root / name).read_text(encoding="utf-8")
            written = text
            for pattern, replacement in changes:
                # A function, because a replacement text has escapes.
                written = re.sub(
                    pattern, lambda found, new=replacement: found[1] + new, written, flags=re.MULTILINE
                )
            if name in SHOWN_BY_PYPI and PLACEHOLDER not in facts["repository"]:
                written = _with_absolute_links(root, name, written, facts["repository"])
            if written != text:
                found[name] = written
    return found


def tracked_files(root):
    listed = subprocess.check_output(["git", "ls-files", "-z"], cwd=root, text=True)
    return [name for name in listed.split("\0") if name and _is_own_file(root / name)]


def _is_own_file(path):
    return path.is_file() and not path.is_symlink()


def _changes(name, facts):
    """What to replace in a file: patterns whose first group stays, and what follows it."""
    repository = facts["repository"]
    pages = f"{repository}/blob/main/{'tools/README' if name.startswith('tools/') else 'docs/index'}.md"
    issues = f"{repository}/issues"
    base = name.rpartition("/")[2]
    if name.startswith(("tests/", "tools/tests/")):
        return []
    if base == "package.xml":
        return [
            (r'(<maintainer email=")[^"]*(?=")', facts["contact"]),
            (r'(<maintainer email="[^"]*">)[^<]*', facts["maintainer"]),
            (r'(<url type="website">)[^<]*', pages),
            (r'(<url type="repository">)[^<]*', repository),
            (r'(<url type="bugtracker">)[^<]*', issues),
        ]
    if base == "pyproject.toml":
        return [
            (r'^(Documentation = ")[^"]*', pages),
            (r'^(Repository = ")[^"]*', repository),
            (r'^(Issues = ")[^"]*', issues),
        ]
    if base == "recipe.yaml":
        accounts = "".join(f"\n    - {account}" for account in facts["github_accounts"])
        return [
            (r"^(  url: )\S+(?=/archive/)", repository),
            (r"^(  homepage: ).*", repository),
            (r"^(  repository: ).*", repository),
            (r"^(  documentation: ).*", pages),
            (r"^(  recipe-maintainers:)(?:\n    - .*)+", accounts),
        ]
    if base.endswith(".md"):
        note = "  # a placeholder until the first release" if PLACEHOLDER in repository else ""
        return [
            (r"(git clone )https://[^\s`]+/tf2-ros-cython\.git", f"{repository}.git"),
            (r"^(git clone \S+\.git)  # a placeholder.*", note),
            (r"(or write to )\S+@[\w.-]+\w", facts["contact"]),
            (r"^(  url: )\S+\.git$", f"{repository}.git"),
        ]
    return []


def _with_absolute_links(root, name, text, repository):
    def absolute(found):
        path = root / found["of_root"] if found["of_root"] else (root / name).parent / found["path"]
        if not path.exists():
            return found[0]  # of another project
        target = path.resolve().relative_to(root.resolve()).as_posix()
        kind = "raw" if found["image"] else "tree" if path.is_dir() else "blob"
        return f"{found['image']}{found['text']}({repository}/{kind}/main/{target}{found['anchor'] or ''})"

    return LINK.sub(absolute, text)


def main():
    changed = stale()
    for name, text in changed.items():
        (ROOT / name).write_text(text, encoding="utf-8")
        print(f"wrote {name}")
    print(*placeholders(owner_facts()), sep="\n")


if __name__ == "__main__":
    main()
