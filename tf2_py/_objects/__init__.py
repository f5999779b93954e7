# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the engine leaves to Python: messages, errors, listings, explanations, log lines, parts of pickles."""
