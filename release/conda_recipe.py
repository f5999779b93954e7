# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Write into the recipe for conda the version, and the checksum of the archive of the release's tag.

`python -m release.conda_recipe ARCHIVE`, with the file that the recipe's url leads to.
"""

import argparse
import hashlib
import re
import sys
from pathlib import Path

from release import version_check

ROOT = Path(__file__).resolve().parent.parent
RECIPE = ROOT / "release" / "conda" / "recipe.yaml"


def with_source(text, version, archive):
    """The text of the recipe for an archive of this version."""
    checksum = hashlib.sha256(archive).hexdigest()
    text = re.sub(r'^(  version: )"[\d.]+"', rf'\1"{version}"', text, flags=re.MULTILINE)
    return re.sub(r'^(  sha256: )"[0-9a-f]*"', rf'\1"{checksum}"', text, flags=re.MULTILINE)


def main(arguments=None):
    parser = argparse.ArgumentParser(prog="python -m release.conda_recipe", description=__doc__)
    parser.add_argument("archive", type=Path)
    archive = parser.parse_args(arguments).archive.read_bytes()
    version = version_check.project_of(ROOT)["version"]
    RECIPE.write_text(with_source(RECIPE.read_text(encoding="utf-8"), version, archive), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
