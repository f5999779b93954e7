# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Measure one section of one library, and write its rows to a file.

Run: measure_section.py LIBRARY MODULE.FUNCTION SIZES OUT [VARIANT...]
"""

import importlib
import json
import sys
import types

import numpy as np

# Module and class of each library.
CLASSES = {
    "ours": ("our_library", "Ours"),
    "ros2": ("tf2_ros_library", "Tf2"),
    "tf2_cpp": ("tf2_cpp_library", "Tf2"),
    "tf_tree": ("transform_tree_library", "TfTree"),
}
QUANTILES = np.linspace(0, 1, 201)  # of the values of a row that are kept


class Rows(list):
    """What a process has measured."""

    def add(self, way, labels, values, unit="ns", failed=0):
        """
        Add a row.

        :param labels: what was measured: texts, and numbers by their units.
        :param failed: how many calls failed; `values` are those of the others.
        """
        values = np.asarray(values, float)
        if len(values) > len(QUANTILES):
            values = np.quantile(values, QUANTILES)
        if len(values):
            row = {"way": way, "labels": labels, "unit": unit, "failed": failed}
            self.append({**row, "values": values.tolist()})

    def time_lookups(self, library, way, labels, queries, sizes, per=1, budget_s=None):
        """
        Add the row of lookups.

        :param per: transforms that one call looks up.
        """
        function, calls = library.calls(way, queries)
        budget_s = budget_s or sizes.budget_s
        library.time(function, calls, sizes.warm_up if per == 1 else 2, budget_s)
        times, failed = library.time(function, calls, max(len(calls), sizes.calls // per), budget_s)
        self.add(way, labels, times / per, failed=failed)


def main(name, section, sizes, out, *variant):
    module, function = section.split(".")
    library_module, library = CLASSES[name]
    make = getattr(importlib.import_module(library_module), library)
    rows = Rows()
    sizes = types.SimpleNamespace(**json.loads(sizes))
    getattr(importlib.import_module(module), function)(rows, sizes, make(), *variant)
    with open(out, "w") as file:
        json.dump(rows, file)


if __name__ == "__main__":
    main(*sys.argv[1:])
