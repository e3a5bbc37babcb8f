"""Bodies saved without their inside: smaller, equal in every bit where they know something, and silent nowhere."""

import re

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
import pytest
from oracles import TOP
from samples import assert_same

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.present.output import write_paraview
from exudyn_partition.reduction import recovery

LACKS = "needs the shapes inside the body, which was saved without them .inside=False.. Load it from a file"
FAR = (0, 0, 0.02)  # the ball's other pole, in its own coordinates


@pytest.fixture(scope="module")
def whole(ball, block, top):
    joint = ep.Partition.interface(block, "base", nodes=np.flatnonzero(block.points[:, 2] < 1e-9))
    return ep.reduce(*ball, f_cut=150e3), ep.reduce(block, top | joint, f_cut=80e3)


@pytest.fixture(scope="module")
def light(whole, tmp_path_factory):
    folder = tmp_path_factory.mktemp("bodies")
    for i, body in enumerate(whole):
        body.save(folder / f"{i}.npz", inside=False)
    return tuple(ep.load_body(folder / f"{i}.npz") for i in range(len(whole)))


def strike(bodies, frame="inertial"):
    """The ball on the block, which a spring holds at its interface; result, bodies, contact, a sensor there, model."""
    mbs = exu.SystemContainer().AddSystem()
    options = {"frame": frame}
    striker = ep.CreatePartitionBody(mbs, bodies[0], referencePosition=TOP, initialVelocity=[0, 0, -0.5], **options)
    target = ep.CreatePartitionBody(mbs, bodies[1], name="block", **options)
    contact = ep.CreatePartitionContact(mbs, striker, target)
    ground = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.CreateGround()))
    marker = target.CreateInterfaceMarker(mbs, "base")
    mbs.AddObject(
        items.ObjectConnectorRigidBodySpringDamper(
            markerNumbers=[ground, marker], stiffness=np.diag([1e6] * 3 + [1e2] * 3)
        )
    )
    kind = exu.OutputVariableType.Displacement
    sensor = mbs.AddSensor(items.SensorMarker(markerNumber=marker, outputVariableType=kind, storeInternal=True))
    mbs.Assemble()
    return ep.solve_dynamic(mbs, end_time=10e-6, step=0.25e-6, method="implicit"), striker, target, contact, sensor, mbs


@pytest.fixture(scope="module")
def runs(whole, light):
    return strike(whole), strike(light)


def inner_node(fem):
    return int(np.setdiff1d(np.arange(fem.n_nodes), fem.facets)[0])


def test_the_file_holds_what_runs_need(whole, light, tmp_path):
    for body, part in zip(whole, light, strict=True):
        kept = part.basis.shape_nodes
        assert {*part.facets.ravel(), *part.partition.patch_nodes} <= {*kept}
        assert len(kept) < 0.75 * len(body.points)
        assert_same(part, body.without_inside())
        assert part.without_inside() is part
        np.testing.assert_array_equal(part.rows(kept), body.rows(kept))
        np.testing.assert_array_equal(part.points, body.points)
        assert (part.fe_dofs, part.table()) == (body.fe_dofs, body.table())
        assert "without its inside" in repr(part)
        assert {*part.left_out} > {*body.left_out}
        sizes = []
        for name, inside in (("whole", True), ("light", False)):
            body.save(tmp_path / name, inside=inside)
            sizes.append((tmp_path / name).stat().st_size)
        saved = body.basis.shapes.nbytes - part.basis.shapes.nbytes
        assert sizes[0] - sizes[1] > 0.6 * saved  # what compression leaves of it
        part.save(tmp_path / "again")
        assert_same(ep.load_body(tmp_path / "again"), part)


@pytest.mark.parametrize("frame", ["inertial", "floating"])
def test_a_run_is_the_same_to_the_last_bit(whole, light, runs, frame):
    (one, *_, of_one, s, _), (other, *_, of_other, _, _) = (
        runs if frame == "inertial" else (strike(bodies, frame) for bodies in (whole, light))
    )
    assert of_one.force(one).max() > 10
    np.testing.assert_array_equal(of_other.force(other), of_one.force(one))
    np.testing.assert_array_equal(other.sensor(s), one.sensor(s))
    assert abs(one.sensor(s)).max() > 0
    for a, b in zip(one.bodies, other.bodies, strict=True):
        np.testing.assert_array_equal(b.coordinates_t(other), a.coordinates_t(one))
        np.testing.assert_array_equal(b.energy(other), a.energy(one))


def test_results_on_the_surface_are_the_same(runs, ball, block):
    """With the static answer of the FE model too; pictures likewise."""
    corner = (0.005, 0.01, 0.0)
    rows = recovery.displacement_rows(block, np.array([corner]))
    told = [
        [
            striker.velocity(result, FAR, fem=ball[0]),
            target.displacement(result, corner, fem=block),
            target.recover(result, rows),
            target.recover(result, rows, fem=block),
        ]
        for result, striker, target, *_ in runs
    ]
    for one, other in zip(*told, strict=True):
        assert abs(one).max() > 0
        np.testing.assert_array_equal(other, one)
    drawn = [ep.view.picture(result, 5e-6, size=(80, 60)) for result, *_ in runs]
    np.testing.assert_array_equal(*drawn)


def test_files_of_the_surface_are_the_same(runs, ball, tmp_path):
    for i, (result, striker, target, *_) in enumerate(runs):
        fields = ("displacement", "deformation", "velocity", "contact_pressure")
        write_paraview(tmp_path / str(i), result, [(striker, ball[0]), target], times=2, fields=fields)
    names = [path.name for path in (tmp_path / "0").iterdir()]
    assert len(names) == 5
    for name in names:
        assert (tmp_path / "0" / name).read_bytes() == (tmp_path / "1" / name).read_bytes()


def test_what_lies_inside_is_refused_by_name(runs, light, ball, block, tmp_path):
    result, striker, target, *_ = runs[1]
    body, node = light[1], inner_node(block)
    place = block.points[node]
    for ask in (
        lambda: body.rows(np.array([0, node])),
        lambda: body.displacement(np.zeros(body.n_dofs)),
        lambda: target.velocity(result, place),
        lambda: body.reduced_rows(recovery.strain_rows(block, place[None])),
        lambda: recovery.static_correction(ball[0], light[0]),
        lambda: ep.view.picture(result, 5e-6, [(striker, ball[0])], field="von_mises"),
        lambda: write_paraview(tmp_path, result, [(striker, ball[0])], fields="stress"),
        lambda: write_paraview(tmp_path, result, [(striker, ball[0])], surface=False),
    ):
        with pytest.raises(InputError, match=LACKS):
            ask()
    assert not [*tmp_path.iterdir()]
    with pytest.raises(InputError, match=re.escape(f"node {node} at {place} m")):
        body.rows(np.array([node]))
    with pytest.raises(InputError, match="inside: expected True or False, got 3"):
        body.save(tmp_path / "body.npz", inside=3)


def test_exudyn_s_own_markers_and_sensors_inside_are_refused(light, block, mbs):
    """Of a node without shapes, Exudyn would tell that nothing moves it."""
    item = ep.CreatePartitionBody(mbs, light[1], name="block", frame="floating")
    item.CreateInterfaceMarker(mbs, "base")
    on, node, kind = item["oFFRFreducedOrder"], inner_node(block), exu.OutputVariableType.Displacement
    with pytest.raises(InputError, match=LACKS):
        item.CreatePointMarker(mbs, block.points[node])
    interface = block.n_nodes  # its first mesh node
    for first in (int(light[1].basis.shape_nodes[0]), interface):
        mbs.AddSensor(items.SensorSuperElement(bodyNumber=on, meshNodeNumber=first, outputVariableType=kind))
    mbs.Assemble()
    ep.solve_dynamic(mbs, end_time=1e-6, step=0.5e-6, method="implicit")
    sensor = mbs.AddSensor(items.SensorSuperElement(bodyNumber=on, meshNodeNumber=node, outputVariableType=kind))
    mbs.Assemble()
    with pytest.raises(InputError, match=f"sensor {int(sensor)} .*, a SensorSuperElement, on body 'block': .*{LACKS}"):
        ep.solve_dynamic(mbs, end_time=1e-6, step=0.5e-6, method="implicit")
    marker = mbs.AddMarker(
        items.MarkerSuperElementPosition(bodyNumber=on, meshNodeNumbers=[node], weightingFactors=[1.0])
    )
    mbs.Assemble()
    with pytest.raises(InputError, match=f"marker {int(marker)} .*, a MarkerSuperElementPosition, on body .*{LACKS}"):
        ep.solve_dynamic(mbs, end_time=1e-6, step=0.5e-6, method="implicit")


def test_a_stored_run_goes_with_whole_bodies_and_with_others(runs, tmp_path):
    """What was run with small files is looked at, inside too, with the whole bodies."""
    (_, _, target, *_, mbs), (other, _, of_other, *_) = runs
    other.save(tmp_path / "run.npz")
    read = ep.Result.load(tmp_path / "run.npz", mbs)
    np.testing.assert_array_equal(target.coordinates(read), of_other.coordinates(other))
    assert np.isfinite(target.body.displacement(target.coordinates(read)[-1])).all()


def test_nodal_columns_inside_are_kept(block, top):
    """The paper's basis keeps the nodes of its impact region, also those below the surface."""
    body = ep.reduce(block, top, basis="free", f_cut=80e3)
    part = body.without_inside()
    below = np.setdiff1d(top.nodes, block.facets)
    assert len(below)
    assert len(part.basis.shape_nodes) < len(block.points)
    np.testing.assert_array_equal(part.rows(below).toarray(), body.rows(below).toarray())
