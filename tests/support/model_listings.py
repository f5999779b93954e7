# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Listings of the model."""

from model_terms import RESERVED, S, seconds


class Listings:
    """Of a model, which has `names`, `frames`, `authorities`, `taken` and `refused`."""

    def _newest_parent(self, name):
        return self.frames[name].newest_parent() if name in self.frames else None

    def statistics(self):
        return {
            "taken": self.taken,
            "refused": {reason: count for reason, count in self.refused.items() if count},
            "frames": len(self.names),
            "samples": sum(len(frame.samples) for frame in self.frames.values()),
            "displaced": self.displaced,
        }

    def infos(self):
        """By name, as `frames()` lists them: parent, static, number of samples, oldest and newest stamp."""
        listed = {}
        for name in self.names:
            frame = self.frames.get(name)
            if frame is None or not frame.samples:
                listed[name] = (None, False, 0, None, None)
            elif frame.static:
                listed[name] = (frame.newest_parent(), True, 1, None, None)
            else:
                stamps = (frame.oldest_ns(), frame.newest_ns())
                listed[name] = (frame.newest_parent(), False, len(frame.samples), *stamps)
        return listed

    def string(self):
        children = [name for name in self.names if name in self.frames]
        return "".join(
            f"Frame {name} exists with parent {self._newest_parent(name) or RESERVED}.\n" for name in children
        )

    def yaml(self):
        """As a dict of dicts; numbers as rounded in the text."""
        listed = {}
        for name in self.names:
            frame = self.frames.get(name)
            if frame is None or not frame.samples:
                continue
            span = frame.newest_ns() - frame.oldest_ns()
            listed[name] = {
                "parent": frame.newest_parent(),
                "broadcaster": self.authorities[name],
                "rate": round(len(frame.samples) * 1e9 / max(span, 100_000), 3),
                "most_recent_transform": round(frame.newest_ns() / S, 6),
                "oldest_transform": round(frame.oldest_ns() / S, 6),
                "buffer_length": round(span / S, 3),
            }
        return listed

    def edges(self):
        """Of the graph: sorted pairs of parent and child."""
        return sorted((facts["parent"], name) for name, facts in self.yaml().items())

    def tree(self):
        if not self.names:
            return "no frames"
        lines, shown = [], set()
        parents = {name: self._newest_parent(name) for name in self.names}

        def show(name, depth, end):
            mark = " (loop)" if name == end else ""
            lines.append("  " * depth + name + self._facts(name) + mark)
            if name == end and depth > 0:
                return
            shown.add(name)
            for child in sorted(child for child in self.names if parents[child] == name):
                show(child, depth + 1, end)

        for name in sorted(name for name in self.names if parents[name] is None):
            show(name, 0, None)
        for name in sorted(self.names):
            if name not in shown:
                above = self._ancestors(name, parents)
                first = min(frame for frame in above if frame in self._ancestors(frame, parents))
                show(first, 0, first)
        return "\n".join(lines)

    def _ancestors(self, name, parents):
        above = []
        while (name := parents[name]) is not None and name not in above:
            above.append(name)
        return above

    def _facts(self, name):
        frame = self.frames.get(name)
        if frame is None or not frame.samples:
            return ""
        if frame.static:
            return " (static)"
        newest, count = frame.newest_ns(), len(frame.samples)
        if count == 1:
            return f" (1 sample, at {seconds(newest)})"
        span = (newest - frame.oldest_ns()) / S
        return f" ({count} samples over {span:.3f} s, newest at {seconds(newest)})"
