# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Nodes, of a program and hidden: how they end, who spins them, and who publishes a topic."""
