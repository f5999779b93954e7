# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Check that a release can be published, by `make release-check`: `python -m release.release_check [TAG]`.

Checks the owner's facts, the versions, the changelogs, the proofs, and what would be uploaded: wheels built
only from the source distributions, for this Python. Prints everything that is wrong.
"""

import argparse
import re
import subprocess
import sys
import zipfile
from pathlib import Path

from packaging.utils import parse_wheel_filename

from release import changelog_rst, owner, prove, version_check, wheels
from release.proved_commit import changed_since, is_known

ROOT = Path(__file__).resolve().parent.parent
LEFT_TO_FILL_IN = re.compile(rf"https://{owner.PLACEHOLDER}/tf2|tf2-ros-cython@{owner.PLACEHOLDER}")
# Of CPython on Linux and macOS: the version and ABI that an extension is for.
EXTENSION = re.compile(r"\.cpython-(\d+t?)-[\w-]+\.so$")


def not_filled_in(root=ROOT):
    """What waits for the owner, and files that do not have the owner's facts, one line each."""
    found = owner.placeholders(owner.owner_facts(root))
    found += [f"{name}: run python -m release.owner" for name in owner.stale(root)]
    for name in owner.tracked_files(root):
        if name.startswith(("tests/", "tools/tests/", "release/owner")):
            continue
        if LEFT_TO_FILL_IN.search((root / name).read_bytes().decode("utf-8", "replace")):
            found.append(f"{name} contains a placeholder of owner.toml")
    return found


def wrong_extensions(wheel):
    """The compiled modules of a wheel that are for another Python than its name says, one line each."""
    *_, tags = parse_wheel_filename(wheel.name)
    versions = {tag.abi.removeprefix("cp") for tag in tags}
    with zipfile.ZipFile(wheel) as opened:
        compiled = [name for name in opened.namelist() if name.endswith(".so") and ".libs/" not in name]
    found = [(name, EXTENSION.search(name)) for name in compiled]
    return [f"{wheel.name}: {name}" for name, match in found if match and match[1] not in versions]


def wrong_distributions(folder):
    """What PyPI would refuse or users would miss in the files of a folder, one line each."""
    files = sorted([*folder.glob("*.whl"), *folder.glob("*.tar.gz")])
    built = [path for path in files if path.suffix == ".whl"]
    found = [line for wheel in built for line in wrong_extensions(wheel)]
    for command, paths in ((["twine", "check", "--strict"], files), (["check_wheel_contents"], built)):
        ended = subprocess.run(
            [sys.executable, "-m", *command, *paths], cwd=ROOT, capture_output=True, text=True
        )
        if ended.returncode or not paths:
            found += [f"{command[0]}: {line}" for line in (ended.stdout + ended.stderr).splitlines()]
    return found


def unproved(steps, root):
    """What the page of proofs does not show of a release, one line each."""
    commit, lines = prove.read_page(root)
    if commit is None or not is_known(commit, root):
        return [f"{prove.PAGE} names no commit of this repository: run make prove"]
    found = [f"{name} has changed since {commit} was proved" for name in changed_since(commit, root)]
    notes = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    for name in (step.name for step in steps):
        line = lines.get(name)
        if line is None:
            found.append(f"not proved: {name}; run make prove")
        elif line["notes"].startswith(prove.NOT_RUN):
            if (said := f"{name}: {line['notes']}") not in notes:
                found.append(f"CHANGELOG.md does not say: {said}")
        elif line["failed"] != "0":
            found.append(f"failed: {name}")
    return found


def main(arguments=None):
    parser = argparse.ArgumentParser(prog="python -m release.release_check", description=__doc__)
    parser.add_argument("tag", nargs="?", help="the tag of the release, such as v0.1.0")
    parser.add_argument("--built", type=Path, help="check what is in this folder, and build nothing")
    options = parser.parse_args(arguments)
    found = not_filled_in() + version_check.contradictions(ROOT, options.tag)
    if (ROOT / "CHANGELOG.rst").read_text(encoding="utf-8") != changelog_rst.expected():
        found.append("CHANGELOG.rst: run python -m release.changelog_rst")
    found += unproved(prove.steps(), ROOT)
    if options.tag and subprocess.check_output(["git", "status", "--porcelain"], cwd=ROOT):
        found.append("git status shows changes")
    if options.built is None:
        wheels.main(["--untested"])
    found += wrong_distributions(options.built or wheels.DIST)
    print(*found or ["nothing is wrong"], sep="\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
