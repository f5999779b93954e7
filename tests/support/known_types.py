"""The message classes that this project registers, as its tables list them."""

import pytest

# The tf2 of ROS 2 has no tables; what needs them is skipped there.
TABLES = {
    package: pytest.importorskip(f"{package}._types").TYPES
    for package in ("tf2_geometry_msgs", "tf2_sensor_msgs")
}
# Clouds have tests of their own, byte by byte.
ALL = [cls for table in TABLES.values() for cls in table if cls.__name__ != "PointCloud2"]
STAMPED = [cls for cls in ALL if hasattr(cls, "header")]
UNSTAMPED = [cls for cls in ALL if not hasattr(cls, "header")]
