"""
Give the public stubs the docstrings of the compiled modules, for editors.

`python -m build_backend.stub_docstrings` writes them; with `--check`, for `make lint`, it only says which
stubs would change.
"""

import ast
import subprocess
import sys
import tempfile
from pathlib import Path

STUBS = (
    "tf2_py/_tf2_py.pyi",
    "tf2_ros/_wait/pending.pyi",
    "tf2_ros/records.pyi",
    "tf2_ros/serialization.pyi",
    "tf2_geometry_msgs/_geometry.pyi",
    "tf2_geometry_msgs/_nav.pyi",
    "tf2_sensor_msgs/_cloud.pyi",
    "tf2_sensor_msgs/_imu_and_magnetometer.pyi",
)


def without_docstrings(text):
    """The text of a stub without them; where nothing else is in a body, with `...` instead."""
    lines = text.splitlines(keepends=True)
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, documented) and ast.get_docstring(node) is not None:
            docstring = node.body[0]
            instead = " " * docstring.col_offset + "...\n" if len(node.body) == 1 else ""
            for number in range(docstring.lineno, docstring.end_lineno + 1):
                lines[number - 1] = ""
            lines[docstring.lineno - 1] = instead
    return "".join(lines)


def with_docstrings(stubs):
    """The texts of stubs as they should be, by their paths."""
    with tempfile.TemporaryDirectory() as folder:
        for stub in stubs:
            copy = Path(folder, stub)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_text(without_docstrings(Path(stub).read_text(encoding="utf-8")), encoding="utf-8")
        for command in (
            ("docify", "--quiet", "--workers", "1", "--in-place", folder),
            # A body that is a docstring needs no `...`.
            ("ruff", "check", "--quiet", "--isolated", "--select", "PIE790", "--fix", folder),
            ("ruff", "format", "--quiet", "--config", "pyproject.toml", folder),
        ):
            subprocess.run([sys.executable, "-m", *command], check=True)
        return {stub: Path(folder, stub).read_text(encoding="utf-8") for stub in stubs}


def main(arguments):
    changed = []
    for stub, text in with_docstrings(STUBS).items():
        if Path(stub).read_text(encoding="utf-8") != text:
            changed.append(stub)
            if arguments != ["--check"]:
                Path(stub).write_text(text, encoding="utf-8")
    if changed and arguments == ["--check"]:
        print(f"{', '.join(changed)}: run make stubs, because docstrings have changed")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
