"""Bodies with what functions of one order more change of them: nearer to bodies of that order."""

import functools

import netgen.occ as occ
import numpy as np
import pytest
from oracles import SPHERE_MATERIAL

import exudyn_partition as ep
from exudyn_partition.accuracy.correction import Finer
from exudyn_partition.errors import InputError
from exudyn_partition.fe.quadrature import facet_forces
from exudyn_partition.reduction.inertia import InertiaIntegrals

CUT = 100e3


@functools.cache
def bar():
    shape = occ.Box(occ.Pnt(-4e-3, -3e-3, 0), occ.Pnt(4e-3, 3e-3, 30e-3))
    shape.faces.Max(occ.Z).name = "back"
    mesh = ep.generate_mesh(shape, maxh=8e-3, refine=[ep.Refine((0, 0, 0), 1e-3, 1.5e-3)], grading=0.8)
    return {order: ep.fe_model(mesh, SPHERE_MATERIAL, order=order) for order in (2, 3)}


@functools.cache
def bars(kind=None, axes="normal"):
    """A bar on one mesh of orders 2 and 3, with a patch in the middle of its lower end and an interface at its back."""
    found = []
    for fem in bar().values():
        part = ep.Partition.ball(fem, (0, 0, 0), 2.2e-3, direction=(0, 0, -1), axes=axes)
        if kind:
            part |= ep.Partition.interface(fem, "back", "back", kind=kind)
        found.append((fem, ep.reduce(fem, part, basis="residual", f_cut=CUT)))
    return found


def compliance(fem, body, direction):
    """Displacement under an even traction on the patch, modes and static answer together, against it [m/Pa]."""
    patch = body.partition.patches[0]
    forces, index = np.zeros((len(patch.nodes), 3)), np.searchsorted(patch.nodes, patch.facets)
    np.add.at(forces, index, facet_forces(fem.points, patch.facets, np.array(direction)))
    moving = body.basis.omega > 0
    of_modes = (body.rows(patch.nodes)[:, moving].T @ forces.ravel()) / body.basis.omega[moving]
    load = forces @ patch.direction if patch.axes == "normal" else forces.ravel()
    return load @ body.flexibility(0) @ load + of_modes @ of_modes


@pytest.mark.parametrize("kind", [None, "averaged", "rigid"])
def test_frequencies_are_nearly_those_of_the_next_order(kind):
    """Of modes well below the truncation frequency. On a rigid interface the functions of the next order are held."""
    (fem, old), (_, cubic) = bars(kind)
    new = Finer(fem, old).corrected(0)
    kept = np.flatnonzero((cubic.basis.omega > 0) & (cubic.basis.omega < 0.9 * 2 * np.pi * CUT))
    exact = cubic.basis.omega[kept]
    before, after = (body.basis.omega[kept] / exact - 1 for body in (old, new))
    assert len(kept) >= 5
    assert before.max() > 0.05
    assert abs(after).max() < 0.25 * before.max()
    assert (after > -1e-3).all()
    assert new.stiffness.diagonal() == pytest.approx(new.basis.omega**2)


@pytest.mark.parametrize(("axes", "direction"), [("normal", (0, 0, -1)), ("xyz", (1, 0, 0))])
def test_the_answer_to_an_even_traction_is_nearly_that_of_the_next_order(axes, direction):
    (fem, old), finer = bars("rigid", axes)
    new = Finer(fem, old).corrected(0)
    exact = compliance(*finer, direction)
    before, after = (compliance(fem, body, direction) / exact - 1 for body in (old, new))
    assert before < -0.04
    assert abs(after) < 0.3 * abs(before)


def test_a_bar_that_is_pushed_from_behind_yields_by_a_third_of_what_a_held_one_does():
    """L / 3 E A: the normal force falls along the bar as its inertia asks for. Linear elements cannot follow that."""
    length, width = 40e-3, 8e-3
    shape = occ.Box(occ.Pnt(-width / 2, -width / 2, 0), occ.Pnt(width / 2, width / 2, length))
    fem = ep.fe_model(shape, ep.Material(E=210e9, nu=0.0, rho=7850.0), maxh=12e-3, order=1)
    old = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), width, direction=(0, 0, -1)), f_cut=20e3)
    exact = length / (3 * fem.material.E) * width**2  # under a unit traction
    before, after = (compliance(fem, body, (0, 0, -1)) / exact - 1 for body in (old, Finer(fem, old).corrected(0)))
    assert before < -0.01
    assert abs(after) < 0.1 * abs(before)


def test_a_corrected_body_is_sound():
    """Rigid motion, mass and the place of the body stay; integrals of inertia are those of the turned shapes."""
    (fem, old), _ = bars()
    new = Finer(fem, old).corrected(0)
    assert (new.mass != old.mass).nnz == 0
    assert new.rigid == pytest.approx(old.rigid)
    patch = new.partition.patches[0].nodes
    away = np.setdiff1d(np.arange(fem.n_nodes), patch)
    for nodes in (away, patch):  # rigid shapes are the same; at the patch alone, elastic ones move in addition
        assert new.rows(nodes)[:, :6] == pytest.approx(old.rows(nodes)[:, :6])
    turn = np.linalg.lstsq(old.rows(away)[:, 6:], new.rows(away)[:, 6:], rcond=None)[0]
    assert turn.T @ turn == pytest.approx(np.eye(len(turn)), abs=1e-9)
    of_turned = InertiaIntegrals.of(fem, old.basis.shapes[:, 6:] @ turn)
    assert new.inertia.inertia == pytest.approx(of_turned.inertia, abs=1e-9 * abs(of_turned.inertia).max())
    added = new.basis.flexibility - old.basis.flexibility
    assert np.linalg.eigvalsh((added + added.T) / 2)[0] > -1e-6 * np.linalg.norm(added)


def test_a_plastic_zone_is_refused():
    material = ep.Material(E=210e9, nu=0.3, rho=7850.0, yield_stress=3e8, hardening=1e9)
    fem = ep.fe_model(occ.Box(occ.Pnt(-4e-3, -3e-3, 0), occ.Pnt(4e-3, 3e-3, 10e-3)), material, maxh=8e-3)
    part = ep.Partition.ball(fem, (0, 0, 0), 4e-3, direction=(0, 0, -1), plastic_radius=6e-3)
    body = ep.reduce(fem, part, f_cut=CUT)
    with pytest.raises(InputError, match="correct: expected elastic bodies"):
        Finer(fem, body).corrected(0)
