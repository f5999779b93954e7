"""Find the programs of a sourced workspace that another Python starts, and that import another tf2_ros."""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

from tf2_ros_cython import _installation

_ORIGIN = "import importlib.util as u; found = u.find_spec('tf2_ros'); print(found.origin if found else '')"


def strays() -> dict[str, tuple[str, list[Path]]]:
    """By the Python that starts them: what is said of its tf2_ros, and the programs."""
    spec = importlib.util.find_spec("tf2_ros")
    ours = None if spec is None else spec.origin
    by_python: dict[str, list[Path]] = {}
    for program in _programs():
        python = _python_of(program)
        if python is not None and not _is_in_the_same_folder(python, sys.executable):
            by_python.setdefault(python, []).append(program)
    found = {python: _tf2_ros_of(python) for python in by_python}
    return {python: (said, by_python[python]) for python, (origin, said) in found.items() if origin != ours}


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


def _tf2_ros_of(python: str) -> tuple[str, str]:
    """Where it is, and a clause about it."""
    done = subprocess.run([python, "-c", _ORIGIN], capture_output=True, text=True, check=False)
    origin, error = done.stdout.strip(), done.stderr.strip()[-200:]
    if origin:
        return origin, f"its tf2_ros is {origin}"
    return "", f"it has no tf2_ros ({error})" if error else "it has no tf2_ros"
