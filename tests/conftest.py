# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fixtures and options are those of tests/support/suite_plugin.py, which the tools' tests share."""

pytest_plugins = ["suite_plugin"]
