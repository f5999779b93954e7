"""The benchmark of transformed types: it runs, and both sides do the same arithmetic."""

import numpy as np
import pytest
from carrying import numbers
from numpy.testing import assert_allclose

from bench import types

pytestmark = pytest.mark.ours


def test_it_measures_every_type_beside_numpy(monkeypatch):
    monkeypatch.setattr(types, "POINTS", 50)
    rows = types.measure(1, 0.0)
    measured = {(row["labels"]["type"], row["who"]) for row in rows}
    names = {name for name, _ in measured}
    assert len(names) == 5 + len(types.CLOUDS) + 2
    assert {(name, who) for name in names for who in ("ours", "numpy")} <= measured
    assert len(types.table(rows).splitlines()) == len(names)


def test_numpy_comes_to_the_same_messages():
    for mine, numpys in types._messages(types._transform()).values():
        assert_allclose(numbers(mine()), numbers(numpys()), rtol=1e-12)


@pytest.mark.parametrize(("step", "kind"), types.CLOUDS.values())
def test_numpy_comes_to_the_same_clouds(monkeypatch, step, kind):
    monkeypatch.setattr(types, "POINTS", 50)
    cloud, t = types._cloud(step, kind), types._transform()
    size = int(kind[1])
    x, y = (
        np.ndarray((50, 3), kind, data, 0, (step, size))
        for data in (types.do_transform_cloud(cloud, t).data, types._cloud_by_numpy(cloud, t, kind))
    )
    assert_allclose(x, y, rtol=2e-7 if kind == "f4" else 1e-12, atol=1e-5 if kind == "f4" else 1e-12)
