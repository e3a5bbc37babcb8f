"""Linear bodies far beyond what materials bear: runs go on, and say so."""

import re
import warnings

import netgen.occ as occ
import numpy as np
import pytest

import exudyn_partition as ep
from exudyn_partition.errors import ModelLimitWarning, PartitionWarning


def test_a_bar_that_strains_by_a_third_bounces_as_linear_theory_says(mbs):
    """Doyen, Ern and Piperno (2011): it falls for 1, touches for 2/3 of a second, and leaves as fast as it came.

    `validation/contact/bouncing_bar.py` has three impacts of a finer bar.
    """
    material = ep.Material(E=900.0, nu=0.0, rho=1.0)
    bar = occ.Box(occ.Pnt(-0.5, -0.5, 0), occ.Pnt(0.5, 0.5, 10))
    fem = ep.fe_model(bar, material, maxh=0.7)
    part = ep.Partition.ball(fem, (0, 0, 0), 0.9)
    body = ep.reduce(fem, part, f_cut=6.0)
    item = ep.CreatePartitionBody(mbs, body, referencePosition=[0, 0, 5], gravity=[0, 0, -10], name="bar")
    contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane())
    mbs.Assemble()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", PartitionWarning)
        result = ep.solve_dynamic(mbs, end_time=2.5)
    said = " ".join(str(warning.message) for warning in caught)
    assert re.search(r"body 'bar': its contact patch has deformed by 0\.\d+ of the body's size", said)
    assert re.search(r"the force rings near or above f_cut, .* where the bases end", said)
    assert {warning.category for warning in caught} == {ModelLimitWarning}
    assert result.status == "finished"
    assert result.t[-1] == pytest.approx(2.5)
    closed = result.t[contact.force(result) > 0]
    assert closed[0] == pytest.approx(1.0, abs=0.03)
    assert closed[-1] - closed[0] == pytest.approx(2 / 3, rel=0.06)
    impulse = np.trapezoid(contact.force(result), result.t)
    assert impulse == pytest.approx(body.total_mass * (2 * 10 + 10 * 2 / 3), rel=0.03)
    height = item.rigid_motion(item.coordinates(result))[:, 2] + 5
    energy = item.energy(result) + contact.energy(result) + body.total_mass * 10 * height
    assert abs(energy / energy[0] - 1).max() < 0.02
