# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Check that the versions of a release fit each other: `python -m release.version_check [TAG]`.

The tag is `v` and the version of tf2-ros-cython. tf2-ros-tools and the messages have versions of their own,
which the requirements of the others must include.
"""

import re
import sys
from pathlib import Path

from packaging.requirements import Requirement

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parent.parent


def contradictions(root=ROOT, tag=None):
    """What does not fit, one line each."""
    core, tools = (project_of(root / folder) for folder in (".", "tools"))
    messages = _manifest_version(root / "messages" / "src" / "tf2_msgs")
    found = []
    if tag is not None:
        if tag != f"v{core['version']}":
            found.append(f"the tag is {tag}, and pyproject.toml says {core['version']}")
        for project, folder in ((core, root), (tools, root / "tools")):
            if f"\n## {project['version']}" not in (folder / "CHANGELOG.md").read_text(encoding="utf-8"):
                found.append(f"{project['name']}: CHANGELOG.md has no heading for {project['version']}")
    for project, folder in ((core, root), (tools, root / "tools")):
        if _manifest_version(folder) != project["version"]:
            found.append(
                f"{project['name']}: pyproject.toml says {project['version']}, and package.xml "
                f"{_manifest_version(folder)}"
            )
    versions = {core["name"]: core["version"], tools["name"]: tools["version"]}
    for requirement in map(Requirement, _requirements(core) + _requirements(tools)):
        is_message = requirement.name.startswith("tf2-ros-cython-msgs-")
        version = messages if is_message else versions.get(requirement.name)
        if version is not None and version not in requirement.specifier:
            found.append(f"{requirement} does not include {requirement.name} {version}")
    return found


def project_of(folder):
    return tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def _requirements(project):
    return [
        *project["dependencies"],
        *(one for extra in project["optional-dependencies"].values() for one in extra),
    ]


def _manifest_version(folder):
    return re.search(r"<version>([\d.]+)</version>", (folder / "package.xml").read_text(encoding="utf-8"))[1]


def main(arguments=None):
    tag = (sys.argv[1:] if arguments is None else arguments)[:1]
    found = contradictions(ROOT, *tag)
    print(*found or ["the versions fit each other"], sep="\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
