"""PyInstaller bundles the compiled modules, and what they import."""

import os

import installing
import pytest
from processes import run
from project_sources import PACKAGES, imports, modules

from tf2_ros_cython import _pyinstaller

pytestmark = pytest.mark.ours

PROGRAM = """
import sys
from tf2_ros import Buffer, TransformException
from tf2_ros._message_classes import TransformStamped
import tf2_ros.numpy, tf2_ros.records, tf2_ros.serialization
transform = TransformStamped()
transform.header.frame_id, transform.child_frame_id = "map", "robot"
transform.transform.translation.x, transform.transform.rotation.w = 2.0, 1.0
buffer = Buffer()
buffer.set_transform_static(transform, "me")
print(buffer.lookup_transform("map", "robot", 0).transform.translation.x, hasattr(sys, "_MEIPASS"))
print(buffer.lookup_transforms("map", "robot", [1, 2])[0].tolist())
try:
    buffer.lookup_transform("map", "robt", 0)
except TransformException as error:
    print(error)
"""


def test_the_hooks_name_what_the_compiled_modules_import():
    paths = [
        path for all_of in modules(packages=PACKAGES).values() for path in all_of if path.suffix == ".pyx"
    ]
    found = {one.module for path in paths for one in imports(path) if not one.is_cimport}
    others = {name for name in found if name.partition(".")[0] not in PACKAGES}
    assert others <= {*_pyinstaller.IMPORTED}, others - {*_pyinstaller.IMPORTED}


def test_a_bundle_has_the_types_that_a_buffer_imports_by_name():
    pytest.importorskip("PyInstaller")
    assert {"tf2_geometry_msgs._nav", "tf2_sensor_msgs._cloud"} <= {*_pyinstaller.hidden_imports()}


@pytest.mark.long("builds a wheel and a bundle")
def test_a_bundled_program_looks_transforms_up(tmp_path):
    pytest.importorskip("PyInstaller")
    checkout = installing.checkout_copy(tmp_path / "checkout")
    installing.reuse_builds(checkout)
    quickly = installing.unoptimised(tmp_path, installing.unsourced())
    wheel = installing.build("build_backend.build_wheel", checkout, tmp_path / "wheel", None, quickly)
    python = installing.new_venv(tmp_path / "venv", wheel)
    libraries = installing.link_libraries(tmp_path / "libraries", "pyinstaller", "numpy")
    (tmp_path / "program.py").write_text(PROGRAM)
    environment = {**installing.unsourced(), "PYTHONPATH": str(libraries)}
    bundling = run(python, "-m", "PyInstaller", "--noconfirm", "program.py", cwd=tmp_path, env=environment)
    assert bundling.returncode == 0, bundling.stderr
    # Without any Python, or a library, of this machine.
    bundled = run(tmp_path / "dist" / "program" / "program", cwd=tmp_path, env={"PATH": os.defpath})
    assert (bundled.stdout.splitlines()[:2], bundled.stderr) == (
        ["2.0 True", "[[2.0, 0.0, 0.0], [2.0, 0.0, 0.0]]"],
        "",
    )
    assert "Did you mean [robot]?" in bundled.stdout
