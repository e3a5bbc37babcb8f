"""Plastic zones beneath the patches of both bodies of a contact."""

from dataclasses import replace

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest

import exudyn_partition as ep

SOFT = ep.Material(E=70e9, nu=0.33, rho=2700.0, yield_stress=50e6, hardening=500e6)
HARD = replace(SOFT, yield_stress=5e9)


@pytest.mark.parametrize("yielding", [0, 1])
def test_the_body_that_yields_does_so_at_once_beside_one_that_stays_elastic(yielding):
    """In the first answer, from the virgin state: each zone knows the forces on its own patch."""
    mbs, items = exu.SystemContainer().AddSystem(), []
    for number, sign in enumerate((-1, 1)):
        ball = occ.Sphere(occ.Pnt(0, 0, -sign * 4e-3), 4e-3)
        fem = ep.fe_model(
            ball, SOFT if number == yielding else HARD, maxh=4e-3, refine=[ep.Refine((0, 0, 0), 4e-4, 3e-4)]
        )
        part = ep.Partition.ball(fem, (0, 0, 0), 6e-4, direction=(0, 0, sign), plastic_radius=8e-4)
        items.append(ep.CreatePartitionBody(mbs, ep.reduce(fem, part, f_cut=60e3)))
    contact = ep.CreatePartitionContact(mbs, *items).mechanics.for_run("explicit")
    q = np.zeros(contact.gaps.n)
    q[2] = -1e-6  # the upper ball, by as much as makes the soft one flow and leaves the hard one elastic
    settled = contact.force(q)
    for number, plastic in contact.yielded.present.items():
        material = contact.gaps.sides[number].kinematics.body.material
        assert plastic.equivalent.any() == (material.yield_stress == SOFT.yield_stress)
    closely = contact.for_run("implicit").force(q)  # settles closely, in double precision
    assert np.linalg.norm(settled - closely) < 5e-3 * np.linalg.norm(closely)  # in one answer, far beyond yield
