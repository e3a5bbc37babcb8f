"""Uniform tractions on faces: deflections against beam theory and the FE mesh, resultants, and what is refused."""

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import pytest
import scipy.sparse.linalg

import exudyn_partition as ep
from exudyn_partition.errors import InputError
from exudyn_partition.exudyn_bodies.surface_loads import loaded_area

LENGTH, FROM, HEIGHT, TRACTION = 0.2, 0.01, 0.01, 50.0  # length, where the load begins, height [m]; [Pa]


@pytest.fixture(scope="module")
def beam():
    """A square beam along x, clamped at its foot, and loaded on top a little beside it."""
    shape = occ.Fuse([occ.Box((x, 0, 0), (end, HEIGHT, HEIGHT)) for x, end in ((0, FROM), (FROM, LENGTH))])
    shape.faces.Min(occ.X).name = "foot"
    for face in shape.faces:
        if face.center.z > 0.99 * HEIGHT and face.center.x > FROM:
            face.name = "top"
    fem = ep.fe_model(shape, ep.STEEL, maxh=0.006)
    part = ep.Partition.interface(fem, "top", "top", kind="averaged")
    return fem, part | ep.Partition.interface(fem, "foot", "foot")


@pytest.fixture(scope="module")
def body(beam):
    """The same, reduced."""
    return ep.reduce(*beam, f_cut=10e3)


def clamped(mbs, body, **options):
    """The body with its foot fixed in space."""
    item = ep.CreatePartitionBody(mbs, body, frame="floating", **options)
    foot = body.partition.find_interface("foot").position
    ends = [
        mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.CreateGround(), localPosition=foot)),
        item.CreateInterfaceMarker(mbs, "foot"),
    ]
    joint = mbs.AddObject(items.GenericJoint(markerNumbers=ends))
    kinds = exu.OutputVariableType
    force = mbs.AddSensor(
        items.SensorObject(objectNumber=joint, outputVariableType=kinds.ForceLocal, storeInternal=True)
    )
    return item, force


def test_a_cantilever_under_a_uniform_load(mbs, beam, body):
    """Tip by Timoshenko's beam to 1 %, and by the FE mesh under the same traction."""
    fem, part = beam
    item, force = clamped(mbs, body)
    item.CreateSurfaceLoad(mbs, "top", [0, 0, -TRACTION])
    mbs.Assemble()
    result = ep.solve_static(mbs, load_steps=1)
    tip = item.displacement(result, (LENGTH, HEIGHT, 0))[-1, 2]
    load, E, G = TRACTION * HEIGHT, ep.STEEL.E, ep.STEEL.shear_modulus
    bending = load * (LENGTH**4 / 8 - FROM**3 * LENGTH / 6 + FROM**4 / 24) / (E * HEIGHT**4 / 12)
    shear = load * (LENGTH**2 - FROM**2) / (2 * 5 / 6 * G * HEIGHT**2)
    assert -tip == pytest.approx(bending + shear, rel=0.01)
    total = load * (LENGTH - FROM)
    np.testing.assert_allclose(abs(result.sensor(force)[-1]), [0, 0, total], atol=1e-4 * total)

    traction = np.zeros((fem.n_nodes, 3))
    corners = fem.facets[fem.boundaries["top"]]
    area = (
        np.linalg.norm(np.cross(*(fem.points[corners[:, i]] - fem.points[corners[:, 0]] for i in (1, 2))), axis=1) / 2
    )
    np.add.at(traction[:, 2], corners[:, 3:], -TRACTION * area[:, None] / 3)  # of quadratic triangles
    held = np.isin(np.arange(fem.n_nodes), part.find_interface("foot").nodes)
    free = np.repeat(~held, 3)
    u = np.zeros(fem.n_dofs)
    u[free] = scipy.sparse.linalg.spsolve(fem.stiffness[free][:, free].tocsc(), traction.ravel()[free])
    assert tip == pytest.approx(u.reshape(-1, 3)[fem.nearest_node((LENGTH, HEIGHT, 0)), 2], rel=1e-6)


def test_tractions_follow_time_and_the_body(mbs, body):
    """A free body: the push turns with it, and grows as the function says."""
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    item = ep.CreatePartitionBody(mbs, body, frame="floating", referenceRotationMatrix=turn)
    item.CreateSurfaceLoad(
        mbs,
        "top",
        [TRACTION, 0, 0],
        bodyFixed=True,
        loadVectorUserFunction=lambda mbs, t, load: 1e4 * t * np.array(load),
    )
    mbs.Assemble()
    end = 1e-4
    result = ep.solve_dynamic(mbs, end_time=end, method="implicit", step=2e-6)
    impulse = 1e4 * TRACTION * (LENGTH - FROM) * HEIGHT * end**2 / 2
    np.testing.assert_allclose(item.momentum(result)[-1], [0, impulse, 0], atol=1e-3 * impulse)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda mbs, item: item.CreateSurfaceLoad(mbs, "foot", [0, 0, 1]), "'foot' is rigid, so that a traction"),
        (lambda mbs, item: item.CreateSurfaceLoad(mbs, "side", [0, 0, 1]), "interface: expected one of 'top', 'foot'"),
        (lambda mbs, item: item.CreateSurfaceLoad(mbs, "top", 5.0), "loadVector: expected"),
        (lambda mbs, item: item.CreateSurfaceLoad(mbs, "top", [0, 0, 1], bodyFixed="no"), "bodyFixed: expected"),
        (
            lambda mbs, item: item.CreateSurfaceLoad(mbs, "top", [0, 0, 1], loadVectorUserFunction=1.0),
            "loadVectorUserFunction: expected a function",
        ),
    ],
)
def test_what_is_no_traction_is_named(mbs, body, call, message):
    item = ep.CreatePartitionBody(mbs, body, frame="floating")
    with pytest.raises(InputError, match=message):
        call(mbs, item)
    assert "top" not in item


def test_moments_about_the_point_of_an_interface_are_refused(mbs, beam, body):
    item = ep.CreatePartitionBody(
        mbs, body, superElement=True, superElementRigidMarkersOffsets=[[0.1, 0, 0], [0, 0, 0]]
    )
    with pytest.raises(InputError, match="the marker of 'top' has an offset"):
        item.CreateSurfaceLoad(mbs, "top", [0, 0, 1])
    fem, nodes = beam[0], np.unique(beam[0].facets[beam[0].boundaries["top"]])
    for options, message in (
        ({"position": [0.05, 0, 0]}, "the point of 'top' is 0.* m away from the mean"),
        ({"nodes": [*nodes, fem.nearest_node((0, 0, 0))]}, "expected nodes that are those of a face"),
    ):
        part = ep.Partition.interface(fem, "top", **{"nodes": "top", "kind": "averaged"} | options)
        with pytest.raises(InputError, match=message):
            loaded_area(fem, part.find_interface("top"))
