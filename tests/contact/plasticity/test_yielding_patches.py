"""Plastic zones beneath the patches of both bodies of a contact."""

from dataclasses import replace

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest

import exudyn_partition as ep

SOFT = ep.Material(E=70e9, nu=0.33, rho=2700.0, yield_stress=50e6, hardening=500e6)
HARD = replace(SOFT, yield_stress=5e9)
PRESSED = 1e-6  # the upper ball, by as much as makes the soft one flow and leaves the hard one elastic [m]


@pytest.fixture(scope="module", params=[0, 1])
def contact(request):
    """Two balls, of which one is soft."""
    mbs, items = exu.SystemContainer().AddSystem(), []
    for number, sign in enumerate((-1, 1)):
        ball = occ.Sphere(occ.Pnt(0, 0, -sign * 4e-3), 4e-3)
        fem = ep.fe_model(
            ball, SOFT if number == request.param else HARD, maxh=4e-3, refine=[ep.Refine((0, 0, 0), 4e-4, 3e-4)]
        )
        part = ep.Partition.ball(fem, (0, 0, 0), 6e-4, direction=(0, 0, sign), plastic_radius=8e-4)
        items.append(ep.CreatePartitionBody(mbs, ep.reduce(fem, part, f_cut=60e3)))
    return ep.CreatePartitionContact(mbs, *items).mechanics


def pressed(contact, depth):
    """Coordinates with the upper ball that much lower [m]."""
    q = np.zeros(contact.gaps.n)
    q[2] = -depth
    return q


def test_the_body_that_yields_does_so_at_once_beside_one_that_stays_elastic(contact):
    """In the first answer, from the virgin state: each zone knows the forces on its own patch."""
    roughly, closely = contact.for_run("explicit"), contact.for_run("implicit")  # in single and in double precision
    settled, exact = (run.at(pressed(run, PRESSED)).generalised for run in (roughly, closely))
    for number, plastic in roughly.evaluation.plastic.present.items():
        material = contact.gaps.sides[number].kinematics.body.material
        assert plastic.equivalent.any() == (material.yield_stress == SOFT.yield_stress)
    assert np.linalg.norm(settled - exact) < 5e-3 * np.linalg.norm(exact)  # in one answer, far beyond yield


@pytest.mark.parametrize("share", [0.25, 0.35, 0.5, 0.7])
def test_a_step_that_begins_again_knows_nothing_of_what_was_tried(contact, share):
    """What Newton's method has tried is a guess for its next answer, and changes that by what settling leaves."""
    run, depth = contact.for_run("implicit"), share * PRESSED
    first = run.at(pressed(run, depth)).generalised
    assert np.linalg.norm(run.at(pressed(run, 1.5 * depth)).generalised) > 1.2 * np.linalg.norm(first)
    guessed = run.at(pressed(run, depth)).generalised
    np.testing.assert_allclose(guessed, first, rtol=0, atol=1e-4 * abs(first).max())
    run.begin()
    again = run.at(pressed(run, depth)).generalised
    np.testing.assert_allclose(again, first, rtol=0, atol=1e-12 * abs(first).max())
