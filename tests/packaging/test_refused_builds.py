# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Builds that are refused, and a checkout that is not built: what to install or do instead."""

import os
import sys

import pytest
import setuptools
from installing import OURS, backend_at, checkout_copy
from paths import ROOT
from processes import run
from setuptools._distutils.core import run_setup
from setuptools.command.develop import develop

# By its place and not by the path: that must not make the checkout's packages importable.
environment = backend_at(ROOT / "build_backend", "build_backend").required_tools


@pytest.fixture(autouse=True)
def nothing_sourced(monkeypatch):
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)


def test_a_missing_compiler_is_named_with_what_to_install(tmp_path):
    with pytest.raises(SystemExit, match="no C compiler .*install gcc"):
        environment.refuse_incomplete({"PATH": str(tmp_path)})


def install_cython(monkeypatch, folder, version):
    if version:
        (folder / "Cython.py").write_text(f"__version__ = {version!r}")
    monkeypatch.setattr(sys, "path", [str(folder)])
    monkeypatch.setitem(sys.modules, "Cython", None)  # so that what is imported now is not there afterwards
    monkeypatch.delitem(sys.modules, "Cython")


@pytest.mark.parametrize("installed", ["0.29.32", "3.0.7", "3.3.0", "3.3.0a1", "4.0", None])
def test_another_cython_is_refused_with_what_to_install(monkeypatch, tmp_path, installed):
    install_cython(monkeypatch, tmp_path, installed)
    said = f"has {installed or 'none'}: with that Python, pip install 'Cython>=3.0.8,<3.3', or"
    with pytest.raises(SystemExit, match=said):
        environment.refuse_other_cython()


# Of Ubuntu 24.04, Debian 13 and PyPI.
@pytest.mark.parametrize("installed", ["3.0.8", "3.0.11", "3.0.11+dfsg", "3.1.6", "3.2.0b1", "3.2.9"])
def test_the_cythons_of_distributions_may_build(monkeypatch, tmp_path, installed):
    install_cython(monkeypatch, tmp_path, installed)
    environment.refuse_other_cython()


def test_an_old_python_is_refused_before_setuptools_is_asked(monkeypatch):
    monkeypatch.setattr(sys, "version_info", (3, 9, 18, "final", 0))
    monkeypatch.setitem(sys.modules, "setuptools", None)
    with pytest.raises(SystemExit, match="needs Python 3.10 or newer, and this is 3.9"):
        backend_at(ROOT / "build_backend", "build_backend_of_an_old_python")


def test_the_setuptools_of_ubuntu_22_is_refused_as_colcon_runs_it(monkeypatch):
    monkeypatch.setattr(setuptools, "__version__", "59.6.0")
    monkeypatch.setitem(sys.modules, "setuptools.config.pyprojecttoml", None)
    with pytest.raises(RuntimeError, match="setuptools 59.6.0, .*: run pip install in a virtual environment"):
        run_setup(ROOT / "setup.py", stop_after="config")


def test_links_that_setuptools_cannot_make_are_refused_as_colcon_asks_for_them(monkeypatch):
    """By a colcon-core before 0.21, which does not know setuptools 80 and newer."""
    monkeypatch.setattr(develop, "user_options", [("no-deps", "N", "")])
    with pytest.raises(RuntimeError, match="--symlink-install does not work .*: update colcon-core to 0.21"):
        run_setup(ROOT / "setup.py", ["develop", "--editable", "--no-deps"], stop_after="config")


def without_editables(folder):
    """An environment in which no extensions of this checkout are found for another one."""
    kept = "[one for one in sys.meta_path if 'editable' not in getattr(one, '__module__', '')]"
    (folder / "sitecustomize.py").write_text(f"import sys\nsys.meta_path[:] = {kept}\n")
    return {**os.environ, "PYTHONPATH": str(folder)}


@pytest.mark.parametrize("package", OURS)
def test_a_checkout_that_is_not_built_says_what_to_do(tmp_path, package):
    project = checkout_copy(tmp_path / "project")
    ended = run(sys.executable, "-c", f"import {package}", cwd=project, env=without_editables(tmp_path))
    assert ended.returncode == 1
    [error] = [line for line in ended.stderr.splitlines() if line.startswith("ModuleNotFoundError: tf2_py.")]
    version = "{}.{}".format(*sys.version_info)
    assert f" is missing: {project} has no compiled modules for Python {version}. " in error
    assert "change to another directory or run `make build`" in error
    assert error.endswith(f"reinstall with {sys.executable}")
    assert "During handling" not in ended.stderr
