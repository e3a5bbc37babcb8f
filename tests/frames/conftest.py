"""A plank, reduced, for runs and forces in a floating frame."""

import netgen.occ as occ
import pytest

import exudyn_partition as ep


@pytest.fixture(scope="session")
def plank():
    """A steel plank, 200 x 30 x 20 mm: no two moments of inertia are equal."""
    fem = ep.fe_model(occ.Box(occ.Pnt(0, 0, 0), occ.Pnt(0.2, 0.03, 0.02)), ep.STEEL, maxh=0.015)
    return fem, ep.Partition.ball(fem, (0.2, 0.015, 0.01), 8e-3)


@pytest.fixture(scope="module", params=["residual", "free"])
def body(request, plank, kept):
    """Of shapes alone, and with nodal columns."""
    return ep.reduce(*plank, basis=request.param, f_cut=20e3, cache=kept)


@pytest.fixture(scope="session")
def of_shapes(plank, kept):
    """Of shapes alone."""
    return ep.reduce(*plank, basis="residual", f_cut=20e3, cache=kept)
