"""Materials that are none."""

import numpy as np
import pytest

import exudyn_partition as ep
from exudyn_partition.errors import InputError


@pytest.mark.parametrize("values", [{"E": -1}, {"E": np.nan}, {"nu": 0.5}, {"rho": 0}])
def test_bad_material(values):
    with pytest.raises(InputError, match=next(iter(values))):
        ep.Material(**{"E": 1.0, "nu": 0.3, "rho": 1.0, **values})


def test_bad_materials():
    for field, value in (("rho", 0.0), ("E", -1.0), ("nu", 0.5)):
        with pytest.raises(InputError, match=f"{field}: expected"):
            ep.Material(**{"E": 1e9, "nu": 0.3, "rho": 1e3, field: value})
