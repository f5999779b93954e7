# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A DataLoader that makes batches as torch's does, but of arrays instead of tensors."""

import numpy as np


class DataLoader:
    def __init__(self, dataset, batch_size=1, shuffle=False):
        self._dataset, self._size, self._shuffle = dataset, batch_size, shuffle

    def __iter__(self):
        places = np.arange(len(self._dataset))
        if self._shuffle:
            np.random.default_rng(0).shuffle(places)
        for begin in range(0, len(places), self._size):
            # torch passes integers of Python.
            rows = [self._dataset[int(place)] for place in places[begin : begin + self._size]]
            yield {name: np.stack([row[name] for row in rows]) for name in rows[0]}
