# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Copy docstrings to where editors look for them: `python -m release.docstrings [--check]`.

Editors read sources. So the stubs repeat the docstrings of the compiled modules, and the methods of `Buffer`
and `BufferClient` those of the bases that they override. With `--check`, prints the files that would change.
"""

import ast
import inspect
import shutil
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path

import tf2_ros

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("tf2_py", "tf2_ros", "tf2_geometry_msgs", "tf2_sensor_msgs")
WITH_OVERRIDES = {"tf2_ros/buffer.py": tf2_ros.Buffer, "tf2_ros/buffer_client.py": tf2_ros.BufferClient}


def main():
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder)
        for package in PACKAGES:
            shutil.copytree(
                ROOT / package, made / package, ignore=shutil.ignore_patterns("__pycache__", "*.so")
            )
        stubs = sorted(made.rglob("*.pyi"))
        for stub in stubs:
            stub.write_text(_without_docstrings(stub.read_text(encoding="utf-8")), encoding="utf-8")
        for name, cls in WITH_OVERRIDES.items():
            text = (made / name).read_text(encoding="utf-8")
            (made / name).write_text(_with_docstrings_of_bases(text, cls), encoding="utf-8")
        run = [sys.executable, "-m"]
        subprocess.run([*run, "docify", "--quiet", "--workers=1", "--in-place", made], cwd=ROOT, check=True)
        settings = ["--quiet", f"--config={ROOT / 'pyproject.toml'}"]
        subprocess.run([*run, "ruff", "check", "--fix", *settings, *stubs], cwd=made, check=True)
        subprocess.run([*run, "ruff", "format", *settings, *stubs, *WITH_OVERRIDES], cwd=made, check=True)
        names = [*(str(stub.relative_to(made)) for stub in stubs), *WITH_OVERRIDES]
        changed = [name for name in names if (made / name).read_bytes() != (ROOT / name).read_bytes()]
        for name in changed if "--check" not in sys.argv else ():
            shutil.copyfile(made / name, ROOT / name)
    for name in changed:
        print(f"{name}: {'run python -m release.docstrings' if '--check' in sys.argv else 'written'}")
    return int("--check" in sys.argv and bool(changed))


def _docstring(node):
    first = node.body[0] if node.body else None
    is_text = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant)
    return first if is_text and isinstance(first.value.value, str) else None


def _without_docstrings(text):
    lines = text.splitlines(keepends=True)
    nodes = [node for node in ast.walk(ast.parse(text)) if isinstance(getattr(node, "body", None), list)]
    for node in sorted(filter(_docstring, nodes), key=lambda node: -node.body[0].lineno):
        found = node.body[0]
        dots = [" " * found.col_offset + "...\n"] if len(node.body) == 1 else []
        lines[found.lineno - 1 : found.end_lineno] = dots
    return "".join(lines)


def _with_docstrings_of_bases(text, cls):
    lines = text.splitlines(keepends=True)
    [tree] = [one for one in ast.parse(text).body if getattr(one, "name", "") == cls.__name__]
    # Also in a branch of an `if`.
    members = [one for of in tree.body for one in ([of, *of.body] if isinstance(of, ast.If) else [of])]
    for node in reversed([one for one in members if isinstance(one, ast.FunctionDef | ast.AsyncFunctionDef)]):
        of_bases = [getattr(base, node.name).__doc__ for base in cls.__mro__[1:] if hasattr(base, node.name)]
        if node.name.startswith("_") or not (texts := [*filter(None, of_bases)]):
            continue
        old, begin = _docstring(node), node.body[0].lineno - 1
        body = textwrap.indent(f'"""\n{inspect.cleandoc(texts[0])}\n"""\n', " " * node.body[0].col_offset)
        lines[begin : old.end_lineno if old else begin] = [body]
    return "".join(lines)


if __name__ == "__main__":
    sys.exit(main())
