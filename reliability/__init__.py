# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Long searches for faults, each started by a make target: see docs/development/reliability.md."""
