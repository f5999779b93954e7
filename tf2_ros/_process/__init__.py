# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
The threads of this process, and what a fork leaves of them and of objects.

| thread | started by | woken by |
|---|---|---|
| receiver | the first inbox | arrivals, see ``inbox.pyx`` |
| background | the same, a timeout, a regular check | inboxes with something to report, an earlier timeout |
| callbacks | the first callback that no executor runs | another one |

All are daemons, so that the interpreter does not wait for them before it runs the exit handlers, which end
them. No thread begins after that, see ``threads.py``. A forked child has none of them, and starts its own at
their first use; what its parent's inboxes were doing is lost there. The threads that spin nodes are in
``tf2_ros._nodes.spinner``.
"""
