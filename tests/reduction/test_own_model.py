"""What takes an FE model beside a body takes that body's own: mesh, place, mass, stiffness and plastic flow."""

from dataclasses import replace

import exudyn as exu
import numpy as np
import pytest
import scipy.sparse as sp
from oracles import box

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.present.output import write_paraview
from exudyn_partition.reduction import recovery
from exudyn_partition.reduction.recovery import StaticAnswer

SIZE = (6e-3, 6e-3, 24e-3)
TOP_POINT = (0, 0, 24e-3)


def made(material=ep.STEEL, **options):
    return ep.fe_model(box(*SIZE), material, maxh=4e-3, **options)


@pytest.fixture(scope="module")
def fem():
    return made()


@pytest.fixture(scope="module")
def body(fem):
    return ep.reduce(fem, ep.Partition.ball(fem, TOP_POINT, 4.3e-3, direction=(0, 0, 1)), f_cut=150e3)


def softer_in_one_element(fem):
    """The same material, but for 1 % of the modulus in one element."""
    moduli = np.full(len(fem.cells), ep.STEEL.E)
    moduli[3] *= 0.99
    return made(modulus=lambda places: moduli)


OTHERS = {
    "material": (lambda fem: made(ep.ALUMINIUM), "another mass and stiffness: .* E=7e[+]10, nu=0.33, rho=2700"),
    "modulus": (lambda fem: made(replace(ep.STEEL, E=206e9)), "another stiffness"),
    "Poisson's ratio": (lambda fem: made(replace(ep.STEEL, nu=0.29)), "another stiffness"),
    "density": (lambda fem: made(replace(ep.STEEL, rho=7850.0)), "another mass:"),
    "modulus by place": (lambda fem: made(modulus=lambda x: 210e9 + 1e12 * x[:, 2]), "another stiffness"),
    "modulus in one element": (softer_in_one_element, "another stiffness"),
    "order": (lambda fem: made(order=1), "made for another mesh"),
    "mesh": (lambda fem: ep.fe_model(box(*SIZE), ep.STEEL, maxh=3e-3), "made for another mesh"),
    "place": (lambda fem: replace(fem, points=fem.points + 1e-3), "moved or stretched by up to 0.001 m"),
}


@pytest.mark.parametrize("name", OTHERS)
def test_another_model_is_refused(fem, body, name):
    make, message = OTHERS[name]
    other = make(fem)
    with pytest.raises(InputError, match=f"fem: expected the (body's own|FE model that the body) .*{message}"):
        body.check_fem(other)
    body.check_fem(fem)


def test_the_same_model_made_anew_is_taken(fem, body):
    assert made() is not fem
    body.check_fem(made())
    rounded = [sp.csr_matrix(matrix * (1 + 1e-12)) for matrix in (fem.mass, fem.stiffness)]
    body.check_fem(replace(fem, mass=rounded[0], stiffness=rounded[1]))


@pytest.mark.parametrize("inside", [True, False])
def test_a_body_of_before_is_compared_by_what_it_has(fem, body, tmp_path, inside):
    """Its file has no fingerprint of the matrices: mass and, where the shapes are known, their energy are compared."""
    replace(body, fingerprint=None).save(tmp_path / "old.npz", inside=inside)
    old = ep.load_body(tmp_path / "old.npz")
    assert old.fingerprint is None
    old.check_fem(fem)
    for name in ("material", "modulus", "Poisson's ratio", "density", "order"):
        with pytest.raises(InputError, match="fem: expected the"):
            old.check_fem(OTHERS[name][0](fem))
    with pytest.raises(InputError, match="another mass"):
        replace(old, material=None).check_fem(made(ep.ALUMINIUM))


@pytest.fixture(scope="module")
def run(body):
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, 1.0])
    contact = ep.CreatePartitionContact(mbs, item, PLANE)
    mbs.Assemble()
    return item, contact, ep.solve_dynamic(mbs, end_time=3e-6)


PLANE = ep.RigidPlane(TOP_POINT, (0, 0, -1))
INSIDE = (0, 0, 21e-3)
ASKED = {
    "displacement": lambda run, body, fem, path: run[0].displacement(run[2], INSIDE, fem=fem),
    "velocity": lambda run, body, fem, path: run[0].velocity(run[2], INSIDE, fem=fem),
    "velocity of one sample": lambda run, body, fem, path: run[0].velocity(run[2].at(1), INSIDE, fem=fem),
    "recover": lambda run, body, fem, path: run[0].recover(
        run[2], recovery.displacement_rows(made(), [INSIDE]), fem=fem
    ),
    "stress": lambda run, body, fem, path: run[0].stress(run[2], [INSIDE], fem),
    "history": lambda run, body, fem, path: run[2].history(run[1], {"P": (run[0], INSIDE, fem)}),
    "StaticAnswer": lambda run, body, fem, path: StaticAnswer(fem, body),
    "static_correction": lambda run, body, fem, path: recovery.static_correction(fem, body),
    "mesh_error": lambda run, body, fem, path: ep.mesh_error(
        (fem, body), ep.RigidPlane(TOP_POINT, (0, 0, -1)), speed=1.0
    ),
    "write_paraview": lambda run, body, fem, path: write_paraview(path, run[2], bodies=[(run[0], fem)]),
}


@pytest.mark.parametrize("name", ASKED)
def test_nothing_takes_a_model_of_another_material(run, body, tmp_path, name):
    with pytest.raises(InputError, match="expected the FE model that the body was reduced from"):
        ASKED[name](run, body, made(ep.ALUMINIUM), tmp_path)


def test_it_is_refused_too_where_nothing_would_be_added(body):
    """Without a contact there is no static answer, and the model went unseen."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, 1.0])
    mbs.Assemble()
    result = ep.solve_dynamic(mbs, end_time=3e-6)
    with pytest.raises(InputError, match="another mass and stiffness"):
        item.displacement(result, INSIDE, fem=made(ep.ALUMINIUM))


def test_a_body_that_may_yield_knows_its_flow():
    soft = replace(ep.STEEL, hardening=1e9)
    fem = made(soft)
    body = ep.reduce(fem, ep.Partition.ball(fem, TOP_POINT, 4.3e-3, direction=(0, 0, 1)), f_cut=150e3)
    body.check_fem(fem)
    for other in (replace(soft, hardening=2e9), replace(soft, yield_stress=200e6), ep.STEEL):
        with pytest.raises(InputError, match="another plastic flow"):
            body.check_fem(replace(fem, material=other))
    with pytest.raises(InputError, match="another stiffness"):
        body.check_fem(made(replace(soft, E=206e9)))
