# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The benchmark: what this project costs beside other libraries, measured in one run (`python -m bench`)."""
