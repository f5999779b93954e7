"""Write the .pth file of the wheels, which puts our packages before those of a sourced ROS 2."""

import base64
import hashlib
import zipfile
from pathlib import Path

NAME = "tf2_ros_cython.pth"

# Python runs this line whenever it starts. Without a sourced ROS 2, it loads nothing. It must not fail if the
# checkout of an editable installation has been deleted.
LINE = (
    'import os; os.environ.get("AMENT_PREFIX_PATH") and os.environ.get("TF2_ROS_CYTHON") != "0" and exec('
    '"try:\\n from tf2_ros_cython import _finder\\nexcept ImportError: pass\\nelse: _finder.install()")\n'
)


def add_to(wheel):
    """
    Add the file to a wheel, and to the wheel's list of files.

    setuptools does not support .pth files, and adds no files of the project to the wheel of an editable
    installation.
    """
    wheel = Path(wheel)
    made = wheel.with_suffix(".new")
    with zipfile.ZipFile(wheel) as old, zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as new:
        for item in old.infolist():
            data = old.read(item)
            if item.filename.endswith(".dist-info/RECORD"):
                data += _record_line()
            new.writestr(item, data)
        new.writestr(_entry(), LINE)
    made.replace(wheel)


def _entry():
    # Without a date, so that two builds of the same sources give the same file.
    entry = zipfile.ZipInfo(NAME)
    entry.compress_type = zipfile.ZIP_DEFLATED
    entry.external_attr = 0o644 << 16
    return entry


def _record_line():
    digest = base64.urlsafe_b64encode(hashlib.sha256(LINE.encode()).digest()).rstrip(b"=").decode()
    return f"{NAME},sha256={digest},{len(LINE)}\n".encode()
