"""Meshes by Netgen: what it does not survive, options beside a mesh, threads that take turns."""

import sys
import threading

import meshio
import netgen.occ as occ
import numpy as np
import pytest
import scipy.sparse.linalg
from oracles import box

import exudyn_partition as ep
from exudyn_partition.errors import InputError, MeshError

BLOCK = box(0.01, 0.02, 0.03)


def test_a_mesh_that_misses_its_shape():
    ball = occ.Sphere(occ.Pnt(0, 0, 0), 0.01)
    mesh = ep.generate_mesh(ball, maxh=0.005)
    assert ep.fe_model(mesh, ep.STEEL).total_mass == pytest.approx(4.18879e-6 * 7800, rel=0.01)


@pytest.mark.parametrize("grading", [1e-6, 0.01, 5, float("nan"), None])
def test_gradings_that_netgen_does_not_survive(grading):
    with pytest.raises(InputError, match="grading: expected"):
        ep.generate_mesh(BLOCK, maxh=0.01, grading=grading)


def test_boxes_without_size():
    for corner in (np.nan, np.inf):
        with pytest.raises(InputError, match="shape: expected a body of finite size"):
            ep.fe_model(occ.Box((0, 0, 0), (corner, 1, 1)), ep.STEEL, maxh=0.1)


@pytest.mark.parametrize("option", [{"maxh": 1e-3}, {"refine": ep.Refine((0, 0, 0), 1e-3, 1e-4)}, {"grading": 0.5}])
def test_options_of_meshing_beside_a_mesh(block, tmp_path, option):
    meshio.Mesh(block.points, [("tetra10", block.cells)]).write(tmp_path / "block.vtu")
    for source in (tmp_path / "block.vtu", ep.generate_mesh(BLOCK, maxh=0.02)):
        with pytest.raises(InputError, match=f"{next(iter(option))}: a mesh is taken as it is, .* no effect"):
            ep.fe_model(source, ep.STEEL, **option)


@pytest.mark.parametrize("source", [None, 3, [1, 2], {}, b"rod.step"])
def test_what_is_no_source(source):
    with pytest.raises(InputError, match=r"(source|shape): expected"):
        ep.fe_model(source, ep.STEEL, maxh=1e-3)


def test_threads_take_turns_and_standard_output_comes_back(block, tmp_path):
    meshio.Mesh(block.points, [("tetra10", block.cells)]).write(tmp_path / "block.vtu")
    (tmp_path / "broken.vtu").write_text("rubbish")
    failed = []

    def work(length):
        try:
            for _ in range(2):
                made = ep.fe_model(box(0.01, 0.02, length), ep.STEEL, maxh=0.02)
                np.testing.assert_allclose(made.total_mass, 7800 * 2e-4 * length, rtol=1e-9)
                read = ep.fe_model(tmp_path / "block.vtu", ep.STEEL)
                np.testing.assert_array_equal(read.points, block.points)
                with pytest.raises(InputError):
                    ep.fe_model(tmp_path / "broken.vtu", ep.STEEL)
        except BaseException as error:  # also pytest's own
            failed.append(error)

    before = sys.stdout
    threads = [threading.Thread(target=work, args=(0.01 * i,)) for i in range(1, 5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failed
    assert sys.stdout is before


def test_the_tip_of_a_sharp_cone_is_tried_in_a_child_process():
    """Netgen may write where it must not there, and end the program then or later; blunt cones and spheres it can."""

    def cone(half_angle):
        frame = occ.gp_Ax2(occ.Pnt(0, 0, 0), occ.gp_Dir(0, 0, 1))
        return occ.Cone(frame, 0.0, 0.02 * np.tan(np.radians(half_angle)), 0.02, 2 * np.pi)

    with pytest.raises(MeshError, match=r"the cone with its tip .* half angle 20 degrees"):
        ep.fe_model(cone(20), ep.STEEL, maxh=5e-3)
    turned = cone(30).Rotate(occ.Axis((0, 0.1, 0), occ.X), 70) + occ.Sphere(occ.Pnt(0.2, 0, 0), 0.01)
    with pytest.raises(MeshError, match="half angle 30 degrees"):
        ep.generate_mesh(turned, maxh=5e-3)
    cut = occ.Cone(occ.gp_Ax2(occ.Pnt(0, 0, 0), occ.gp_Dir(0, 0, 1)), 2e-3, 9e-3, 0.02, 2 * np.pi)
    for shape in (cone(60), cut):  # spheres and cylinders are in other tests
        assert ep.generate_mesh(shape, maxh=0.02).ne > 0


def test_a_hole_that_ends_in_a_sharp_cone_is_meshed_where_netgen_can():
    half, rim, length = np.radians(39), 2e-3, 20e-3
    depth = rim / np.tan(half)
    hole = occ.Cone(occ.Axes((0, 0, length - depth), occ.Z), 0, rim, depth, 2 * np.pi)
    fem = ep.fe_model(occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=5e-3, h=length) - hole, ep.STEEL, maxh=2e-3)
    exact = np.pi * (5e-3**2 * length - rim**2 * depth / 3)
    assert fem.cell_volume.sum() == pytest.approx(exact, rel=2e-3)


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.UnitsWarning")
@pytest.mark.parametrize("radius", [5e-7, 5e-6, 1e5])
def test_tiny_and_huge_balls_are_meshed_as_others_are(radius):
    """OCC takes 1e-7 m for nothing. The lowest mode is torsional, omega R / c = 2.5011 whatever nu is (Lamb)."""
    ball = occ.Sphere((0, 0, 0), radius)
    top = ep.Refine((0, 0, radius), 0.2 * radius, 0.1 * radius)
    fem = ep.fe_model(ball, ep.STEEL, maxh=0.6 * radius, refine=[top])
    assert fem.total_mass == pytest.approx(4 / 3 * np.pi * radius**3 * ep.STEEL.rho, rel=5e-3)
    shift = -((0.5 * ep.STEEL.shear_wave_speed / radius) ** 2)
    omega = np.sqrt(scipy.sparse.linalg.eigsh(fem.stiffness, 8, fem.mass, sigma=shift)[0][6:])
    assert omega * radius / ep.STEEL.shear_wave_speed == pytest.approx(2.5011, rel=5e-3)
    mesh = ep.generate_mesh(ball, maxh=0.6 * radius)
    assert np.linalg.norm(mesh.ngmesh.Coordinates(), axis=1).max() == pytest.approx(radius, rel=1e-6)
    assert ep.fe_model(mesh, ep.STEEL).total_mass == pytest.approx(fem.total_mass, rel=5e-3)


def test_sizes_that_faces_have_been_given_are_scaled_with_the_shape():
    def shape(length):
        made = occ.Box((0, 0, 0), (length, length, length))
        made.faces[0].maxh = length / 8
        return made

    expected = len(ep.fe_model(shape(0.02), ep.STEEL, maxh=0.01).facets)
    assert expected > 150
    assert len(ep.fe_model(shape(20.0), ep.STEEL, maxh=0.01, scale=1e-3).facets) == pytest.approx(expected, rel=0.1)
