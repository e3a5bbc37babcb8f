"""Tangents of Exudyn's own items, which are moved many at once."""

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np

from exudyn_partition.exudyn_bodies.tangents import tangents


def test_tangents_of_a_chain_are_those_of_each_spring_alone():
    """Neighbours share a mass, others do not; a user function may read any coordinate."""
    mbs = exu.SystemContainer().AddSystem()
    bodies = [mbs.CreateMassPoint(referencePosition=[i, 0, 0], initialVelocity=[i, 1, 0]) for i in range(4)]
    markers = [mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=body)) for body in bodies]

    def join(i, j, **options):
        options = {"markerNumbers": [markers[i], markers[j]], "stiffness": [3.0, 5.0, 7.0]} | options
        mbs.AddObject(items.ObjectConnectorCartesianSpringDamper(**options))

    def by_another(mbs, t, number, way, speed, stiffness, damping, offset):
        elsewhere = mbs.GetNodeOutput(3, exu.OutputVariableType.Displacement)[0]
        return [1e3 * elsewhere + 2 * way[0], 0, 0]

    join(0, 1, springForceUserFunction=by_another)
    for i in range(3):
        join(i, i + 1, damping=[0.1 * (i + 1), 0, 0])
    join(0, 1, springForceUserFunction=lambda *given: 1 / 0)
    join(0, 1, activeConnector=False)
    mbs.Assemble()
    velocities = mbs.systemData.GetODE2Coordinates_t()
    found = tangents(mbs)
    opposite = np.array([[1, -1], [-1, 1]])
    for i, tangent in enumerate(found[1:]):
        np.testing.assert_array_equal(tangent.columns, np.arange(3 * i, 3 * i + 6))
        np.testing.assert_allclose(tangent.stiffness, np.kron(opposite, np.diag([3.0, 5.0, 7.0])), atol=1e-6)
        np.testing.assert_allclose(tangent.damping, np.kron(opposite, np.diag([0.1 * (i + 1), 0, 0])), atol=1e-6)
    np.testing.assert_allclose(found[0].stiffness, np.kron(opposite, np.diag([2.0, 0, 0])), atol=1e-6)
    assert len(found) == 4
    np.testing.assert_array_equal(mbs.systemData.GetODE2Coordinates_t(), velocities)
