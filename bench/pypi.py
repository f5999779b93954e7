"""Owns fetching libraries from PyPI into an environment of their own."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from bench.processes import CONTESTANTS, Failure, Library, clean_environment

WANTED_PYTHON = (3, 12)  # schiebung's wheels begin there
COMMAND_S = 300

# package -> key, ways of a single lookup, what to know of it
LIBRARIES = {
    "schiebung": (
        "schiebung",
        ("core",),
        "Rust; returns an object of its own; keeps 120 s; 'latest' takes each link's own newest sample",
    ),
    "transforms-py": (
        "transforms",
        ("core",),
        "Rust; returns a tuple; knows no 'latest': asked for the newest common stamp",
    ),
    "pytransform3d": (
        "pytransform3d",
        ("core",),
        "NumPy; returns a 4x4 array; histories are given whole; interpolates along screws",
    ),
    "scipy": (
        "scipy",
        (),
        "Slerp and interp of each link, composed; no tree, no inserting; many times only",
    ),
}


def libraries(folder: Path) -> list[Library | tuple[str, str]]:
    """Each library, or its name and why it cannot be had."""
    python = folder / "bin" / "python"
    if not python.exists():
        _run(_python(), "-m", "venv", str(folder))
    found: list[Library | tuple[str, str]] = []
    for package, (key, ways, note) in LIBRARIES.items():
        try:
            if not (folder / f"{package}.installed").exists():
                # A source package may want a compiler of another language, and a network of its own.
                _run(
                    str(python), "-m", "pip", "install", "--quiet", "--only-binary", ":all:", "numpy", package
                )
                (folder / f"{package}.installed").touch()
        except Failure as failure:
            found.append((package, str(failure)))
            continue
        # schiebung writes a configuration into its user's home.
        environment = {"HOME": str(folder), "XDG_CONFIG_HOME": str(folder / "config"), "PYTHONPATH": ""}
        found.append(
            Library(
                key,
                package,
                [str(python), str(CONTESTANTS / "from_pypi.py"), package],
                ways,
                environment,
                note=note,
            )
        )
    return found


def _python() -> str:
    """The oldest Python that all of them can be had for; where there is none, this one."""
    candidates = {shutil.which(f"python3.{minor}") for minor in range(12, 16)} | {sys.executable}
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    candidates |= {str(path) for path in pyenv.glob("versions/*/bin/python3")}
    good = []
    for candidate in filter(None, candidates):
        try:
            version = subprocess.run(
                [candidate, "-c", "import ensurepip, sys; print(*sys.version_info[:3])"],
                check=True,
                capture_output=True,
                text=True,
                timeout=20,
                env=clean_environment(),
            ).stdout.split()
        except (OSError, subprocess.SubprocessError):
            continue
        if tuple(map(int, version)) >= WANTED_PYTHON:
            good.append((tuple(map(int, version)), candidate))
    return min(good)[1] if good else sys.executable


def _run(*command: str) -> None:
    try:
        subprocess.run(
            command, check=True, capture_output=True, text=True, timeout=COMMAND_S, env=clean_environment()
        )
    except subprocess.CalledProcessError as error:
        lines = re.findall(r"^ERROR: (.*)$", error.stderr, re.MULTILINE) or [
            error.stderr.strip() or "no word"
        ]
        raise Failure(f"pip: {lines[-1]}") from None
    except subprocess.TimeoutExpired:
        raise Failure(f"pip took longer than {COMMAND_S} s") from None
