"""The program that writes types of ROS's messages: they say what the messages do, and mypy accepts them."""

import array
import builtins
import importlib
import importlib.util
import subprocess
import sys

import numpy as np
import pytest
from processes import DEADLINE_S

from tf2_ros.cli import message_stubs

pytestmark = pytest.mark.ours

INSTALLED = [
    name
    for name in (
        "action_msgs",
        "builtin_interfaces",
        "diagnostic_msgs",
        "geometry_msgs",
        "nav_msgs",
        "rcl_interfaces",
        "sensor_msgs",
        "shape_msgs",
        "std_msgs",
        "std_srvs",
        "tf2_msgs",
        "visualization_msgs",
    )
    if importlib.util.find_spec(name)
]
# By what the stubs call them.
CLASSES = {"builtins.list": list, "_array.array": array.array, "_npt.NDArray": np.ndarray}


def messages(package):
    return [
        message
        for kind in message_stubs.PARTS
        for cls in message_stubs._interfaces(package, kind)
        for message in message_stubs._messages(cls, kind).values()
    ]


def class_of(declared):
    name = declared.partition("[")[0]
    if name in CLASSES:
        return CLASSES[name]
    owner, _, name = name.rpartition(".")
    return getattr(builtins if owner == "builtins" else importlib.import_module(f"{owner[1:]}.msg"), name)


@pytest.mark.parametrize("package", INSTALLED)
def test_a_field_of_a_new_message_has_the_type_that_its_stub_declares(package):
    for message in (cls() for cls in messages(package)):
        for field, text in message.get_fields_and_field_types().items():
            declared, _ = message_stubs._types(text)
            assert isinstance(getattr(message, field), class_of(declared)), (message, field)


@pytest.mark.parametrize(
    ("text", "read", "assigned"),
    [
        ("double", "builtins.float", "builtins.float"),
        ("string<10>", "builtins.str", "builtins.str"),
        ("a_msgs/B", "_a_msgs.B", "_a_msgs.B"),
        ("sequence<float, 5>", "_array.array[builtins.float]", "_Iterable[builtins.float]"),
        ("sequence<string<5>, 3>", "builtins.list[builtins.str]", "_Sequence[builtins.str]"),
        ("sequence<boolean>", "builtins.list[builtins.bool]", "_Sequence[builtins.bool]"),
        ("a_msgs/B[2]", "builtins.list[_a_msgs.B]", "_Sequence[_a_msgs.B]"),
        ("uint8[16]", "_npt.NDArray[_np.uint8]", "_Sequence[builtins.int] | _npt.NDArray[_Any]"),
        ("float[3]", "_npt.NDArray[_np.float32]", "_Sequence[builtins.float] | _npt.NDArray[_Any]"),
    ],
)
def test_every_form_of_a_field_has_its_types(text, read, assigned):
    assert message_stubs._types(text) == (read, assigned)


def test_mypy_accepts_the_stubs_of_all_installed_messages(tmp_path):
    pytest.importorskip("mypy")
    assert message_stubs.main([str(tmp_path / "typings"), *INSTALLED]) == 0
    written = sorted(path.parent for path in tmp_path.glob("typings/*/__init__.pyi"))
    assert {path.name for path in written} >= set(INSTALLED)
    checked = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--cache-dir=cache", *map(str, written)],
        cwd=tmp_path,
        text=True,
        capture_output=True,
        timeout=15 * DEADLINE_S,
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_the_packages_of_contained_messages_are_written_too(tmp_path):
    assert message_stubs.main([str(tmp_path), "nav_msgs"]) == 0
    written = {path.name for path in tmp_path.iterdir()}
    assert written == {"nav_msgs", "geometry_msgs", "std_msgs", "builtin_interfaces"}


@pytest.mark.parametrize("package", ["absent_msgs", "tf2_ros"])
def test_a_package_without_messages_is_an_error_and_nothing_is_written(package, tmp_path, capsys):
    assert message_stubs.main([str(tmp_path / "typings"), "std_msgs", package]) == 1
    assert capsys.readouterr().err == f"no messages are installed of {package}\n"
    assert not (tmp_path / "typings").exists()


def test_a_package_with_types_of_its_own_is_left_out(tmp_path, monkeypatch, capsys):
    typed = tmp_path / "typed_msgs"
    (typed / "msg").mkdir(parents=True)
    (typed / "__init__.py").touch()
    (typed / "py.typed").touch()
    (typed / "msg" / "__init__.py").write_text("from std_msgs.msg import Empty as Nothing")
    monkeypatch.syspath_prepend(tmp_path)
    assert message_stubs.main([str(tmp_path / "typings"), "typed_msgs"]) == 0
    assert capsys.readouterr().out == "typed_msgs has types of its own\n"
    assert not (tmp_path / "typings").exists()


def test_the_folder_alone_is_required(capsys):
    with pytest.raises(SystemExit):
        message_stubs.main([])
    assert "the following arguments are required: folder\n" in capsys.readouterr().err
