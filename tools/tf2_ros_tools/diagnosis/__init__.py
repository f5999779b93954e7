# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compute rates, delays and problems of received transforms, without a node, and describe them as text."""

__all__: list[str] = []
