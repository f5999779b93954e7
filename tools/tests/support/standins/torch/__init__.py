# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Stands in for torch, which has a gigabyte: the part that a page of the documentation uses."""
