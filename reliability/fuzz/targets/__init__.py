# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
What is fuzzed: a module for each target, with ``run(data)``, ``seeds()`` and ``MOST_BYTES``, the size of the
largest input; none of them needs a fuzzer. The targets of the tools, and their corpus, are in
``tools/tests/fuzz``.

The corpus of a target is an archive: the smallest inputs that reach what the seeds do not, and, under names
that begin with ``crash``, those that once revealed a fault.
"""

import importlib
import zipfile
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[3]
_CORPUS, _CORPUS_OF_TOOLS = ROOT / "reliability" / "fuzz" / "corpus", ROOT / "tools" / "tests" / "fuzz"
__path__.append(str(_CORPUS_OF_TOOLS))  # modules of this package, too
_NO_TIME = (1980, 1, 1, 0, 0, 0)  # the oldest of an archive, which is then the same for the same inputs


def _corpora(folder: Path) -> set[str]:
    return {archive.stem for archive in folder.glob("*.zip")}


OF_TOOLS = _corpora(_CORPUS_OF_TOOLS)
NAMES = sorted(_corpora(_CORPUS) | OF_TOOLS)
# The Python packages whose branches guide the search; those of the extensions always do.
PACKAGES = ["tf2_py", "tf2_ros", "tf2_sensor_msgs", "tf2_ros_tools", "rosbags", "mcap"]

# In these Python does nearly all of the work.
IN_PYTHON = OF_TOOLS


def target(name: str) -> ModuleType:
    """The module of a target; none is imported before it is asked for, so that a fuzzer can instrument it."""
    return importlib.import_module(f"reliability.fuzz.targets.{name}")


def corpus(name: str) -> dict[str, bytes]:
    """The inputs of a target's corpus, by name."""
    with zipfile.ZipFile(_archive(name)) as archive:
        return {one: archive.read(one) for one in archive.namelist()}


def keep(name: str, inputs: dict[str, bytes]) -> None:
    """Replace the corpus of a target."""
    with zipfile.ZipFile(_archive(name), "w", zipfile.ZIP_DEFLATED) as archive:
        for one, data in sorted(inputs.items()):
            archive.writestr(zipfile.ZipInfo(one, _NO_TIME), data, zipfile.ZIP_DEFLATED)


def _archive(name: str) -> Path:
    return (_CORPUS_OF_TOOLS if name in OF_TOOLS else _CORPUS) / f"{name}.zip"
