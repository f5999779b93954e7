# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The message classes that this project registers, as its tables list them."""

import importlib.util

import pytest

PACKAGES = ("tf2_geometry_msgs", "tf2_sensor_msgs")
# The tf2 of ROS 2 has no tables. A package that fails to import is an error, and not skipped.
if not all(importlib.util.find_spec(f"{package}._type_table") for package in PACKAGES):
    pytest.skip("tf2's packages have no tables of types", allow_module_level=True)
TABLES = {package: importlib.import_module(f"{package}._type_table").TYPES for package in PACKAGES}
# The fuzz target `clouds` judges clouds, byte by byte.
ALL = [cls for table in TABLES.values() for cls in table if cls.__name__ != "PointCloud2"]
STAMPED = [cls for cls in ALL if hasattr(cls, "header")]
UNSTAMPED = [cls for cls in ALL if not hasattr(cls, "header")]
