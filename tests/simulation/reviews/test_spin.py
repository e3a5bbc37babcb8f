"""Bodies without geometric stiffness that spin: what the review tells, against bodies that have it."""

import re
import warnings

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
import scipy.linalg
from oracles import box, ground

import exudyn_partition as ep

LENGTH, HUB = 0.5, [1, 1, 1, 1, 1, 0]


@pytest.fixture(scope="module")
def model():
    """A bar along x with an interface at one end."""
    shape = box(LENGTH, 0.010, 0.008)
    shape.faces.Min(occ.X).name = "root"
    fem = ep.fe_model(shape, ep.STEEL, maxh=25e-3)
    return fem, ep.Partition.interface(fem, "root", "root")


@pytest.fixture(scope="module")
def bodies(model):
    """Without and with geometric stiffness."""
    return [ep.reduce(*model, f_cut=1e3, geometric_stiffness=stiffening) for stiffening in (False, True)]


def lowest(body, spin, *, held):
    """Lowest frequency of the bar, clamped at the axis of rotation or free, with its geometric stiffness [rad/s]."""
    root = body.interface_rows("root")
    motion = scipy.linalg.null_space(root) if held else np.eye(body.n_dofs)[:, 6:]
    stiffness = body.stiffness.toarray()
    if spin:
        load = body.centrifugal_load([0, 0, spin])
        if held:
            load = load - root[0] * body.total_mass * spin**2 * LENGTH / 2
        stiffness = stiffness + body.geometric_stiffness(load)
    values = scipy.linalg.eigh(motion.T @ stiffness @ motion, motion.T @ body.mass @ motion, eigvals_only=True)
    return np.sqrt(values[0])


def turning(body, spin, along, *, held):
    """Model of the bar, free or on a hub, that turns with `spin` [rad/s] along an axis."""
    mbs = exu.SystemContainer().AddSystem()
    rate = spin * np.array(along)
    item = ep.CreatePartitionBody(
        mbs, body, name="bar", frame="floating", referencePosition=[LENGTH / 2, 0, 0],
        initialVelocity=np.cross(rate, [LENGTH / 2, 0, 0]) if held else [0, 0, 0], initialAngularVelocity=rate,
    )  # fmt: skip
    if held:
        hub = [ground(mbs, np.array([0, 0, 0.004])), item.CreateInterfaceMarker(mbs, "root")]
        mbs.AddObject(items.GenericJoint(markerNumbers=hub, constrainedAxes=HUB))
    mbs.Assemble()
    return mbs


def spun(body, spin, *, held, along=(0, 0, 1.0), end=0.04):
    """Texts of warnings of a run in which the bar rotates with `spin` [rad/s]."""
    mbs = turning(body, spin, along, held=held)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ep.solve_dynamic(mbs, end_time=end, step=5e-4, method="implicit")
    return [str(warning.message) for warning in caught if "geometric_stiffness" in str(warning.message)]


@pytest.mark.parametrize("held", [True, False])
def test_the_share_that_is_told_is_that_of_geometric_stiffness(bodies, held):
    """By a factor of two; nothing is told of a third of that speed, nor of a body that has it."""
    at_rest = lowest(bodies[1], 0.0, held=held)
    spin = (0.5 if held else 0.3) * at_rest
    (text,) = spun(bodies[0], spin, held=held)
    told = re.search(r"'bar' rotates with ([\d.]+) rad/s, .* at ([\d.]+) Hz, .* by about ([\d.]+) of", text)
    assert float(told[1]) == pytest.approx(spin, rel=0.05)
    assert 2 * np.pi * float(told[2]) == pytest.approx(at_rest, rel=0.02)
    share = (lowest(bodies[1], spin, held=held) / at_rest) ** 2 - 1
    assert 0.5 < float(told[3]) / share < 2
    assert not spun(bodies[0], spin / 3, held=held)
    assert not spun(bodies[1], spin, held=held)


def test_a_shaft_that_turns_about_itself_is_not_pulled(bodies):
    assert not spun(bodies[0], 2 * lowest(bodies[1], 0.0, held=False), held=False, along=(1.0, 0, 0), end=0.01)


def test_a_short_turn_does_not_bend(bodies):
    """The bar turns fast, but the run is over within a tenth of a period of bending."""
    at_rest = lowest(bodies[1], 0.0, held=False)
    assert not spun(bodies[0], 0.3 * at_rest, held=False, end=0.2 * np.pi / at_rest)


def test_the_state_after_a_run_that_blew_up_is_no_state_of_joints(bodies):
    """Of such a run the result keeps the start; the model is left with numbers that are none."""
    mbs = turning(bodies[0], 100.0, (0, 0, 1.0), held=True)
    ep.solve_dynamic(mbs, end_time=1e-3, step=1e-4, method="implicit")
    mbs.systemData.SetODE2Coordinates(np.full(mbs.systemData.ODE2Size(), np.nan))
    assert ep.collect(mbs).bodies


def test_a_basis_that_keeps_nodes_is_told_too(model):
    part = model[1] | ep.Partition.ball(model[0], (LENGTH / 2, 0, 0.004), 0.01)
    body = ep.reduce(model[0], part, f_cut=1e3, basis="free")
    assert len(body.basis.nodal)
    (text,) = spun(body, 60.0, held=True)
    assert "geometric_stiffness=True" in text
