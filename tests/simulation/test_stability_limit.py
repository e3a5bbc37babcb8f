"""The stability limit against dense eigenvalues, and runs below and above it."""

import contextlib
import itertools
import re
import warnings

import exudyn as exu
import exudyn.itemInterface as items
import exudyn.utilities
import numpy as np
import pytest
import scipy.linalg
from oracles import MARBLE_RADIUS, SPHERE_RADIUS, TOP, add_force

import exudyn_partition as ep
from exudyn_partition.contact.normal_rows import NormalRows
from exudyn_partition.errors import ModelLimitWarning, PartitionWarning, StepSizeError, StoppedRunWarning
from exudyn_partition.simulation import item_limits, run_plan, stability

MASS, STIFF = 0.01, 1e12  # of masses in a line, and of springs between them [kg, N/m]


@pytest.fixture(scope="module")
def adapted(pair_of):
    """Ball and block with the contact-adapted basis, whose limit contact lowers."""
    return pair_of("contact-adapted")


# Stability limit.


def held_gap(gaps, q):
    """Gaps with the pairs and normals of the start, from where the nodes are."""
    shares = zip(gaps.stage.shares, gaps.sides.places(q), strict=True)
    way = sum(np.einsum("pk,pkd->pd", weights, x[nodes]) for (nodes, weights), x in shares)
    gap = np.einsum("pd,pd->p", way, gaps.stage.normals)
    return gaps.stage.rows.points.average(gap)


def closed_stiffness(law):
    """H' F^+ H with all rows of the start, H by differences of places; rows on few facets depend on each other."""
    gaps, rows = law.gaps, np.arange(len(law.gaps.row_nodes))
    H = np.array([held_gap(gaps, step) - held_gap(gaps, -step) for step in 1e-6 * np.eye(gaps.n)]).T / 2e-6
    layer = getattr(law.law, "layer", None)
    F = NormalRows(gaps).flexibility(rows) if layer is None else np.diag(1 / (layer * gaps.area))
    return H.T @ np.linalg.pinv(F, rcond=1e-10, hermitian=True) @ H


def dense_limit(contact):
    """2 / omega_max with all rows closed, of dense matrices."""
    bodies = [item.body for item, _ in contact.sides]
    floating = contact.sides[0][0].frame == "floating"
    K = scipy.linalg.block_diag(*(np.diag(body.basis.omega**2) for body in bodies))
    M = np.eye(len(K))
    if floating:
        M = scipy.linalg.block_diag(
            *(M for b in bodies for M in (b.total_mass * np.eye(3), b.inertia.tensor, np.eye(b.n_dofs - 6)))
        )
    K += closed_stiffness(contact.mechanics)
    return 2 / np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True)[-1])


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.ContactPatchWarning")  # unstable runs go anywhere
@pytest.mark.parametrize("frame", ["inertial", "floating"])
@pytest.mark.parametrize(
    ("surface", "options"),
    [
        (None, {}),
        (None, {"rows": "node-to-segment"}),
        (None, {"formulation": "penalty"}),
        (ep.RigidPlane(TOP), {}),
        (ep.RigidSphere([0, 0, 0.02], SPHERE_RADIUS), {}),
        (ep.RigidSphere([0, 0, 0.02], SPHERE_RADIUS), {"formulation": "penalty", "stiffness": 1e16}),
    ],
)
@pytest.mark.filterwarnings("ignore:the force rings")
@pytest.mark.filterwarnings("ignore:.* the bodies penetrate each other")
def test_stability_limit(adapted, surface, options, frame, monkeypatch):
    """Against dense eigenvalues, before and after a run; and runs below and above it."""
    mbs = exu.SystemContainer().AddSystem()
    place = np.add(TOP, [0, 0, 1e-6])
    striker = ep.CreatePartitionBody(mbs, adapted[0], referencePosition=place, initialVelocity=[0, 0, -1], frame=frame)
    master = surface or ep.CreatePartitionBody(mbs, adapted[1], frame=frame)
    contact = ep.CreatePartitionContact(mbs, striker, master, **options)
    add_force(mbs, striker, np.array([0, 0, -1e3]))
    mbs.Assemble()
    limit = ep.stability_limit(mbs)
    assert limit == pytest.approx(dense_limit(contact), rel=1e-3)
    result = ep.solve_dynamic(mbs, end_time=300 * limit, step=0.95 * limit)
    assert result.status == "finished"
    assert contact.force(result).max() > 100
    assert ep.stability_limit(mbs) == pytest.approx(limit, rel=1e-6)
    monkeypatch.setattr(run_plan, "chosen_step", lambda limits, step, method: step)  # without a check
    if options.get("stiffness") is None:  # in that case there is no row that is not closed
        with pytest.warns(StoppedRunWarning) as caught:
            result = ep.solve_dynamic(mbs, end_time=(300 if surface else 100) * limit, step=1.05 * limit)
        assert result.status == "unstable"
        assert not any(issubclass(warning.category, RuntimeWarning) for warning in caught)  # it ends before NaNs


@pytest.mark.parametrize("ratio", [0.0, 0.4])
def test_damping_lowers_the_limit(mbs, marble, ratio, monkeypatch):
    """A damped body vibrates on below the limit and explodes above it: h^2 omega^2 + 4 zeta h omega = 4."""
    item = ep.CreatePartitionBody(mbs, marble, damping=ratio or None)
    add_force(mbs, item, np.array([0, 0, 1.0]))
    mbs.AddObject(
        items.ObjectGenericODE2(nodeNumbers=item.nodes, forceVector=np.where(np.arange(marble.n_dofs) > 5, 1e3, 0.0))
    )
    mbs.Assemble()
    limit, omega = ep.stability_limit(mbs), marble.basis.omega.max()
    assert limit == pytest.approx(2 * (np.hypot(ratio, 1) - ratio) / omega, rel=1e-3)
    monkeypatch.setattr(run_plan, "chosen_step", lambda limits, step, method: step)  # without a check
    strong = pytest.warns(ModelLimitWarning, match="modes with ratios of 0.2") if ratio else contextlib.nullcontext()
    with strong:
        result = ep.solve_dynamic(mbs, end_time=300 * limit, step=0.98 * limit)
    assert result.status == "finished"
    with pytest.warns(StoppedRunWarning, match="beyond all bounds"):
        ep.solve_dynamic(mbs, end_time=300 * limit, step=1.03 * limit)


@pytest.mark.parametrize(("stiffness", "rate"), [(1e13, 0.0), (0.0, 3e6), (4e12, 2e6), (0.0, 1e2)])
def test_springs_and_dampers_lower_the_limit(mbs, marble, frame, stiffness, rate, monkeypatch):
    """A spring and a damper on a free translation: h^2 k / m + 2 h d / m = 4; and a run below and above."""
    item = ep.CreatePartitionBody(mbs, marble, frame=frame, initialVelocity=[0.1, 0, 0])
    free, mass = ep.stability_limit(mbs), marble.total_mass if frame == "floating" else 1.0
    wall = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(items.NodePointGround()), coordinate=0))
    at = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=item.nodes[0], coordinate=0))
    options = {"stiffness": stiffness * mass, "damping": rate * mass}
    mbs.AddObject(items.CoordinateSpringDamper(name="wall", markerNumbers=[wall, at], **options))
    mbs.Assemble()
    limit = ep.stability_limit(mbs)
    expected = 4 / (rate + np.hypot(rate, 2 * np.sqrt(stiffness)))
    assert limit == pytest.approx(min(expected, free), rel=1e-2)
    if expected > free:
        return
    with pytest.raises(StepSizeError, match=r"wall \(ConnectorCoordinateSpringDamper\) causes it"):
        ep.solve_dynamic(mbs, end_time=300 * limit, step=1.04 * limit)
    stable = ep.solve_dynamic(mbs, end_time=300 * limit, step=0.97 * limit)
    monkeypatch.setattr(run_plan, "chosen_step", lambda limits, step, method: step)  # without a check
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PartitionWarning)
        grown = ep.solve_dynamic(mbs, end_time=600 * limit, step=1.04 * limit)
    assert abs(item.coordinates(grown)[:, 0]).max() > 1e3 * abs(item.coordinates(stable)[:, 0]).max()


@pytest.mark.parametrize("basis", ["contact-adapted", "craig-bampton"])
def test_dampers_of_an_interface_lower_the_limit(mbs, arm, frame, basis, kept, monkeypatch):
    """Between the body and a rigid one, on a marker of six rows: a run below the limit, and one above it.

    Where the basis keeps nodes in an inertial frame, joints tie a small mass to the interface, which limits nothing.
    """
    body = ep.reduce(*arm, f_cut=60e3, basis=basis, cache=kept)
    item = ep.CreatePartitionBody(mbs, body, frame=frame, initialVelocity=[0.1, 0.05, 0])
    free = ep.stability_limit(mbs)
    inertia = exudyn.utilities.InertiaCuboid(7850, [0.01, 0.02, 0.03])
    by_vector = exu.NodeType.RotationRotationVector
    other = mbs.CreateRigidBody(inertia=inertia, nodeType=by_vector)
    damping = np.diag([1e4] * 3 + [1.0] * 3)
    ends = [mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=other)), item.CreateInterfaceMarker(mbs, "foot")]
    mbs.AddObject(items.RigidBodySpringDamper(markerNumbers=ends, damping=damping))
    mbs.Assemble()
    limit = ep.stability_limit(mbs)
    assert 1e-3 * free < limit < 0.9 * free
    assert ep.solve_dynamic(mbs, end_time=300 * limit, step=0.97 * limit).status == "finished"
    monkeypatch.setattr(run_plan, "chosen_step", lambda limits, step, method: step)  # without a check
    with pytest.warns(PartitionWarning):
        assert ep.solve_dynamic(mbs, end_time=900 * limit, step=1.04 * limit).status == "unstable"


@pytest.mark.parametrize("factor", [1.1, 1.3])
def test_an_unstable_run_tells_it_in_our_words_alone(mbs, marble, factor, monkeypatch):
    """Energies overflow before gaps do. Between two planes rows are closed when the run ends, whatever its phase."""
    item = ep.CreatePartitionBody(mbs, marble, referencePosition=[0, 0, MARBLE_RADIUS], initialVelocity=[0, 0, -0.1])
    above = ep.RigidPlane([0, 0, 2 * MARBLE_RADIUS], [0, 0, -1])
    for patch, plane in (("south", ep.RigidPlane()), ("north", above)):
        ep.CreatePartitionContact(mbs, item, plane, slavePatch=patch)
    mbs.Assemble()
    step = factor * ep.stability_limit(mbs)
    monkeypatch.setattr(run_plan, "chosen_step", lambda limits, step, method: step)  # without a check
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        result = ep.solve_dynamic(mbs, end_time=5000 * step, step=step)
    assert result.status == "unstable"
    assert "not finite" in result.message
    assert not [str(each.message) for each in said if not issubclass(each.category, PartitionWarning)]


@pytest.fixture
def line_of_masses(mbs, marble):
    """Model of a marble and a line of 60 free masses with equal springs between them."""
    ep.CreatePartitionBody(mbs, marble, initialVelocity=[0.1, 0, 0])
    masses = [mbs.CreateMassPoint(referencePosition=[1.0 + i, 0, 0], mass=MASS) for i in range(60)]
    at = [mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=number)) for number in masses]
    for i, ends in enumerate(itertools.pairwise(at)):
        spring = items.CartesianSpringDamper(name=f"spring {i}", markerNumbers=[*ends], stiffness=[STIFF] * 3)
        mbs.AddObject(spring)
    mbs.Assemble()
    return mbs


def test_springs_between_free_masses_lower_the_limit(line_of_masses):
    """Of many coordinates: none of these springs has a force against equal motions of all, in the whole or alone."""
    limit = ep.stability_limit(line_of_masses)
    assert limit == pytest.approx(np.sqrt(MASS / STIFF) / np.cos(np.pi / 120), rel=1e-4)  # 2 sqrt(k / m) cos(pi / 2n)
    alone = f"Take at most {limit:.3g} s"  # one alone allows steps that are longer by the root of two
    with pytest.raises(StepSizeError, match=re.escape(alone)):
        ep.solve_dynamic(line_of_masses, end_time=10 * limit, step=1.01 * limit)


def test_items_are_asked_once_before_an_adaptive_run(line_of_masses, monkeypatch):
    """The limits of steps in contact and in flight differ by contacts alone."""
    asked, ask = [], item_limits.tangents
    monkeypatch.setattr(item_limits, "tangents", lambda mbs: asked.append(mbs) or ask(mbs))
    ep.solve_dynamic(line_of_masses, end_time=1e-6, adaptive=True)
    assert len(asked) == 1


@pytest.mark.parametrize("most", [stability.DENSE, 0])
def test_the_limit_of_a_model_is_that_of_its_stiffest_group(marble, bodies, most, monkeypatch):
    """Of bodies that contacts join; by all frequencies or by Lanczos, whichever is quicker."""
    monkeypatch.setattr(stability, "DENSE", most)

    def model(chain, pair):
        mbs = exu.SystemContainer().AddSystem()
        if chain:
            balls = [
                ep.CreatePartitionBody(mbs, marble, referencePosition=[0, 0, 2.001 * MARBLE_RADIUS * i])
                for i in range(3)
            ]
            for lower, upper in itertools.pairwise(balls):
                ep.CreatePartitionContact(mbs, lower, upper, slavePatch="north", masterPatch="south")
        if pair:
            first = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=np.add(TOP, [0.1, 0, 1e-6]))
            second = ep.CreatePartitionBody(mbs, bodies[1], referencePosition=[0.1, 0, 0])
            ep.CreatePartitionContact(mbs, first, second)
        mbs.Assemble()
        return ep.stability_limit(mbs)

    alone = model(True, False), model(False, True)
    assert model(True, True) == pytest.approx(min(alone), rel=1e-4)
    monkeypatch.setattr(stability, "DENSE", 10**6)
    assert min(alone) == pytest.approx(model(True, True), rel=1e-4)


def test_a_damper_that_acts_later_is_named_as_the_cause(mbs, marble):
    """Nothing knew it before the run, and the body seemed to rotate too far."""
    item = ep.CreatePartitionBody(mbs, marble, initialVelocity=[0.1, 0, 0])
    wall = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(items.NodePointGround()), coordinate=0))
    at = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=item.nodes[0], coordinate=3))
    dashpot = items.CoordinateSpringDamper(name="dashpot", markerNumbers=[wall, at], damping=1e8, activeConnector=False)
    number = mbs.AddObject(dashpot)
    mbs.SetNodeParameter(item.nodes[0], "initialCoordinates_t", np.full(marble.n_dofs, 1e-3))

    def switch(mbs, t):
        mbs.SetObjectParameter(number, "activeConnector", t > 2e-6)
        return True

    mbs.SetPreStepUserFunction(switch)
    mbs.Assemble()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        ep.solve_dynamic(mbs, end_time=20e-6)
    said = [str(each.message) for each in said]
    assert any(re.search(r"above the stability limit.* dashpot .* causes it", text) for text in said), said
