"""Elements of plastic zones have nearly one dilatation each."""

import dataclasses

import numpy as np
import pytest
from oracles import box

import exudyn_partition as ep
from exudyn_partition.fe.elements import kinds_of
from exudyn_partition.fe.model import node_dofs
from exudyn_partition.plasticity.dilatation import freed, mean_dilatation, with_free_zones, with_mean_dilatation
from exudyn_partition.plasticity.flow import PlasticState
from exudyn_partition.plasticity.integration import flow_places
from exudyn_partition.plasticity.zone import PlasticZone
from exudyn_partition.plasticity.zone_stress import ZoneStress

MATERIAL = ep.Material(E=70e9, nu=0.3, rho=2700.0, yield_stress=200e6, hardening=500e6)


@pytest.fixture(scope="module")
def model():
    fem = ep.fe_model(box(12e-3, 12e-3, 12e-3), MATERIAL, maxh=2.4e-3)
    return fem, ep.Partition.ball(fem, (0, 0, 12e-3), 2e-3, plastic_radius=2.4e-3)


def test_nine_tenths_of_the_pressure_follow_the_mean_dilatation_of_each_element(model):
    """Beside the energy of shape: that of the change of each element's volume, by Gauss' theorem on its faces."""
    fem, partition = model
    region = partition.patches[0].plastic
    zone = PlasticZone(fem.points, region, MATERIAL)
    own = np.random.default_rng(3).standard_normal((len(zone.nodes), 3)) * 1e-6
    u = np.zeros((fem.n_nodes, 3))
    u[zone.nodes] = own
    u[region.border] = 0.0  # elements outside the zone stay as they are
    strain = zone.strains(u[zone.nodes].ravel())
    shape = zone.own_energy(PlasticState(strain, np.zeros(len(zone)), np.zeros_like(strain)))
    bulk, corners = MATERIAL.lame + 2 / 3 * MATERIAL.shear_modulus, region.cells[:, :4]
    volume = np.linalg.det(fem.points[corners[:, 1:]] - fem.points[corners[:, :1]]) / 6
    # Volume swept by the faces: the flux of a quadratic field through a flat face is the mean over its mid-sides.
    flux = np.zeros(len(region.cells))
    for face in ([0, 2, 1, 6, 5, 4], [0, 1, 3, 4, 8, 7], [1, 2, 3, 5, 9, 8], [0, 3, 2, 7, 9, 6]):
        a, b, c = (fem.points[region.cells[:, i]] for i in face[:3])
        area = np.cross(b - a, c - a) / 2
        flux += np.einsum("cj,cj->c", area, u[region.cells[:, face[3:]]].mean(axis=1))
    mean, at_points = (with_free_zones(fem, partition), fem)
    of_mean, of_points = (u.ravel() @ (m.stiffness @ u.ravel()) / 2 - shape for m in (mean, at_points))
    expected = 0.9 * bulk / 2 * (flux**2 / volume).sum() + 0.1 * of_points
    assert of_mean == pytest.approx(expected, rel=1e-9)
    assert of_mean < 0.8 * of_points


def test_uniform_strain_is_answered_as_before(model):
    fem, partition = model
    u = (fem.points @ np.random.default_rng(4).standard_normal((3, 3))).ravel()
    change = with_free_zones(fem, partition).stiffness @ u - fem.stiffness @ u
    assert abs(change).max() < 1e-9 * abs(fem.stiffness @ u).max()


def test_cubic_elements_and_bodies_without_zones_keep_their_stiffness(model):
    cubic = ep.fe_model(box(10e-3, 12e-3, 12e-3), MATERIAL, maxh=4e-3, order=3)
    assert with_mean_dilatation(cubic, cubic.cells, MATERIAL) is cubic
    elastic = dataclasses.replace(model[0], material=dataclasses.replace(model[0].material, hardening=None))
    assert with_free_zones(elastic, ep.Partition.ball(elastic, (0, 0, 12e-3), 2e-3)) is elastic


@pytest.mark.parametrize("layers", [1, 2, 5])
def test_a_plate_that_may_yield_bends_as_an_elastic_one(layers):
    """Bent to the same curvature both ways, it has the energy of Kirchhoff's plate; all of it is in the zone."""
    t, side, curvature = 2e-3, 5e-3, 1e-2
    fem = ep.fe_model(box(side, side, t), MATERIAL, maxh=1.2 * t / layers)
    partition = ep.Partition.ball(fem, (0, 0, t), t, direction=(0, 0, 1), plastic_radius=2 * side)
    x, y, z = fem.points.T - [[0], [0], [t / 2]]
    nu = MATERIAL.nu
    u = curvature * np.stack([-x * z, -y * z, (x**2 + y**2) / 2 + nu / (1 - nu) * z**2], axis=1).ravel()
    bent = u @ (with_free_zones(fem, partition).stiffness @ u) / 2
    assert bent == pytest.approx(MATERIAL.E / (1 - nu) * curvature**2 * side**2 * t**3 / 12, rel=0.02)


def test_stress_is_that_by_which_the_stiffness_was_made():
    """The work of its change is what freeing changes of the energy, also where part of a zone keeps its stiffness.

    Nodes have the mean of the elements around them, by their mass.
    """
    t, refine = 2e-3, [ep.Refine((0, 0, 2e-3), 0.8e-3, 0.25e-3)]
    fem = ep.fe_model(box(8e-3, 8e-3, t), MATERIAL, maxh=2e-3, refine=refine, grading=0.7)
    partition = ep.Partition.ball(fem, (0, 0, t), 0.6e-3, plastic_radius=3e-3)
    cells = partition.patches[0].plastic.cells
    free = freed(fem, cells)
    assert free.any()
    assert not free.all()
    u = np.random.default_rng(7).normal(size=fem.n_dofs)
    rows = {cell.tobytes(): i for i, cell in enumerate(fem.cells)}
    own = np.array([rows[cell.astype(fem.cells.dtype).tobytes()] for cell in cells])
    ((kind, _),) = kinds_of(cells, False)
    places = flow_places(kind)
    stress = ZoneStress(fem, partition.patches[0].plastic, MATERIAL)
    change = stress.rows(np.repeat(own, len(places)), np.tile(places, (len(cells), 1)))
    pressure = (change @ u).reshape(-1, 6)[:, 0]
    volume, dilatation, _ = mean_dilatation(fem.points, cells, False)
    strain = np.einsum("cqi,ci->cq", dilatation, u[node_dofs(cells.ravel()).reshape(len(cells), -1)])
    found = np.sum(volume.ravel() * pressure * strain.ravel())
    assert found == pytest.approx(u @ ((with_free_zones(fem, partition).stiffness - fem.stiffness) @ u), rel=1e-6)
    of_nodes, mass = np.zeros((fem.n_nodes, 6)), np.zeros(fem.n_nodes)
    np.add.at(mass, fem.cells, fem.cell_mass[:, None])
    for local, column in zip(kind.nodes, kind.columns, strict=True):
        there = (stress.rows(own, np.tile(local, (len(own), 1))) @ u).reshape(-1, 6)
        np.add.at(of_nodes, cells[:, column], fem.cell_mass[own, None] * there)
    found = stress.at_nodes(u.reshape(-1, 3), np.zeros((len(cells) * len(places), 6)))
    np.testing.assert_allclose(found, of_nodes / mass[:, None], rtol=1e-9, atol=1e-9 * abs(found).max())
