"""Find the programs of a sourced workspace that another Python starts, and that import another tf2_ros."""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

from tf2_ros_cython import _installation

_ORIGIN = "import importlib.util as u; found = u.find_spec('tf2_ros'); print(found and found.origin)"


def strays() -> dict[str, tuple[str, list[Path]]]:
    """By the Python that starts them: the tf2_ros that they import instead, and the programs."""
    spec = importlib.util.find_spec("tf2_ros")
    ours = None if spec is None else spec.origin
    by_python: dict[str, list[Path]] = {}
    for program in _programs():
        python = _python_of(program)
        if python is not None and not _is_in_the_same_folder(python, sys.executable):
            by_python.setdefault(python, []).append(program)
    others = {python: _tf2_ros_of(python) for python in by_python}
    return {python: (others[python], by_python[python]) for python in by_python if others[python] != ours}


def _programs() -> list[Path]:
    """Where colcon puts those of the workspaces, which are all prefixes but the distribution's."""
    distribution = _installation.distribution_prefix()
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    folders = [Path(prefix, "lib") for prefix in prefixes if prefix]
    of_workspaces = [folder for folder in folders if not _installation.lies_in(str(folder), distribution)]
    return [path for folder in of_workspaces for path in sorted(folder.glob("*/*")) if path.is_file()]


def _python_of(program: Path) -> str | None:
    """The Python that the program's first line names, or None."""
    try:
        with open(program, "rb") as file:
            line = file.readline(300)
    except OSError:
        return None
    words = line[2:].decode(errors="replace").split() if line.startswith(b"#!") else []
    if words and Path(words[0]).name == "env":
        words = words[1:]
    if not words or not Path(words[0]).name.startswith("python"):
        return None
    return shutil.which(words[0])


def _is_in_the_same_folder(one: str, other: str) -> bool:
    # Not the programs themselves: that of an environment is a link to the system's.
    return os.path.realpath(os.path.dirname(one)) == os.path.realpath(os.path.dirname(other))


def _tf2_ros_of(python: str) -> str:
    done = subprocess.run([python, "-c", _ORIGIN], capture_output=True, text=True, check=False)
    return done.stdout.strip() or f"none ({done.stderr.strip()[-200:]})"
