"""Thin walls: their thickness, and what elements make of their bending waves, against those of Rayleigh and Lamb."""

import re

import netgen.occ as occ
import numpy as np
import pytest
import scipy.optimize
import scipy.sparse.linalg
from oracles import box, split, write

import exudyn_partition as ep
from exudyn_partition.errors import FrequencyRangeError, MeshQualityWarning
from exudyn_partition.fe.walls import bending_frequency

T = 1e-3


def lamb(wavenumber):
    """Frequency of the lowest antisymmetric wave of Rayleigh and Lamb in a steel plate of thickness T [Hz]."""
    shear = ep.STEEL.shear_wave_speed
    pressure = np.sqrt((ep.STEEL.lame + 2 * ep.STEEL.shear_modulus) / ep.STEEL.rho)

    def residual(speed):
        a, b = (wavenumber * np.sqrt(1 - (speed / c) ** 2) for c in (pressure, shear))
        return 4 * wavenumber**2 * a * b * np.tanh(b * T / 2) - (wavenumber**2 + b**2) ** 2 * np.tanh(a * T / 2)

    speeds = np.linspace(1e-3, 0.999, 1000) * shear
    first = np.flatnonzero(np.diff(np.sign([residual(c) for c in speeds])))[0]
    return wavenumber * scipy.optimize.brentq(residual, *speeds[first : first + 2]) / (2 * np.pi)


def strip_error(fem, n):
    """Error of the n-th bending wave along a strip whose ends and sides are planes of symmetry."""
    p = fem.points
    free = np.ones((fem.n_nodes, 3), dtype=bool)
    for axis in (0, 1):
        sides = np.isclose(p[:, axis, None], [p[:, axis].min(), p[:, axis].max()])
        free[sides.any(axis=1), axis] = False
    dofs = np.flatnonzero(free.ravel())
    stiffness, mass = (matrix[dofs][:, dofs].tocsc() for matrix in (fem.stiffness, fem.mass))
    k = n * np.pi / np.ptp(p[:, 0])
    exact = lamb(k)
    values, vectors = scipy.sparse.linalg.eigsh(stiffness, 12, mass, sigma=(2 * np.pi * 1.15 * exact) ** 2)
    wave = np.zeros_like(p)
    wave[:, 2] = np.cos(k * (p[:, 0] - p[:, 0].min()))
    share = (wave.ravel()[dofs] @ (mass @ vectors)) ** 2
    return np.sqrt(values[share.argmax()]) / (2 * np.pi) / exact - 1


def test_bending_waves_of_mindlin_are_those_of_rayleigh_and_lamb():
    k = np.array([0.01, 0.3, 1.0, 2.0]) / T
    np.testing.assert_allclose(bending_frequency(k, T, ep.STEEL), [lamb(x) for x in k], rtol=0.02)


@pytest.mark.parametrize(("ratio", "order"), [(1, 2), (2, 2), (4, 2), (8, 3)])
def test_bending_up_to_the_bounds_is_as_good_as_promised(ratio, order):
    h = ratio * T
    fem = ep.fe_model(box(8 * h, 3 * h, T), ep.STEEL, order=order, maxh=h, grading=0.9)
    waves = np.array([lamb(n * np.pi / (8 * h)) for n in range(1, 9)])
    n_accurate, n_seen = np.searchsorted(waves, [fem.weakest_wall.accurate_frequency, fem.resolved_frequency])
    assert 1 <= n_accurate < n_seen
    assert 0 < strip_error(fem, int(n_accurate)) < 0.08
    # Three times as many waves are not followed: the bound is no more careful than it has to be.
    assert strip_error(fem, min(8, 3 * int(n_accurate) + 1)) > 0.08


@pytest.mark.parametrize("ratio", [2, 3, 4, 6])
def test_waves_that_come_out_a_quarter_too_fast_warn(ratio):
    """The last wave below the bound is nearly so; f_cut may lie beyond it, as an impact may excite less."""
    h = ratio * T
    fem = ep.fe_model(box(8 * h, 3 * h, T), ep.STEEL, maxh=h, grading=0.9)
    rough = fem.weakest_wall.rough_frequency
    waves = np.array([lamb(n * np.pi / (8 * h)) for n in range(1, 9)])
    assert 0.12 < strip_error(fem, int(np.searchsorted(waves, rough))) < 0.25
    partition = ep.Partition.ball(fem, (0, 0, T), 2 * h)
    with pytest.warns(MeshQualityWarning, match="come out a quarter too fast, or more, in a wall of 0.001 m"):
        ep.reduce(fem, partition, f_cut=1.01 * rough)
    ep.reduce(fem, partition, f_cut=0.99 * rough)


def plate_modes(side):
    """Two lowest frequencies of a free square plate of steel [Hz]: A. W. Leissa, Vibration of plates, 1969."""
    factor = np.array([13.468, 19.596])
    return factor / (2 * np.pi * side**2) * np.sqrt(ep.STEEL.plane_strain_modulus * T**2 / 12 / ep.STEEL.rho)


def test_elements_far_longer_than_the_wall_resolve_nothing_of_use():
    """The fourth mode, at 870 Hz, comes out above 3 kHz; elements of that volume seem fine for shear waves."""
    plate = ep.fe_model(box(0.1, 0.1, T), ep.STEEL, maxh=0.02)
    assert plate.resolved_shear_frequency > 1e5
    assert plate.weakest_wall.thickness == pytest.approx(T)
    assert plate.resolved_frequency < plate_modes(0.1)[0]
    partition = ep.Partition.ball(plate, (0, 0, T), 0.03)
    with pytest.raises(FrequencyRangeError, match=r"bending waves of a wall of 0\.001 m in elements 0\.02"):
        ep.reduce(plate, partition, f_cut=1e3)


def test_modes_that_a_coarse_plate_follows_are_promised():
    """Elements nine times as long as the plate is thick lock, but not for its first modes; a quarter has the second."""
    quarter = ep.fe_model(box(0.05, 0.05, T), ep.STEEL, maxh=8e-3)
    assert quarter.weakest_wall.element > 8 * T
    second = plate_modes(0.1)[1]
    assert second < quarter.weakest_wall.accurate_frequency
    free = np.ones((quarter.n_nodes, 3), dtype=bool)
    free[:, :2] = ~np.isclose(quarter.points[:, :2], quarter.points[:, :2].min(axis=0))
    dofs = np.flatnonzero(free.ravel())
    stiffness, mass = (matrix[dofs][:, dofs] for matrix in (quarter.stiffness, quarter.mass))
    found = scipy.sparse.linalg.eigsh(stiffness, 2, mass, sigma=-1e5, return_eigenvectors=False).max()
    assert np.sqrt(found) / (2 * np.pi) == pytest.approx(second, rel=0.08)


def test_a_thin_bar_struck_on_its_end_is_told_the_mesh_that_does():
    """Its axial waves are long, but no contact is quite even: what bends it must be resolved too."""
    length, f_cut = 0.05, 60e3
    shape = box(length, T, T)

    def model(maxh):
        fem = ep.fe_model(shape, ep.STEEL, maxh=maxh)
        return fem, ep.Partition.ball(fem, (-length / 2, 0, T / 2), T)

    coarse = model(25e-3)
    assert coarse[0].resolved_shear_frequency > f_cut
    with pytest.raises(FrequencyRangeError, match="bar struck on its end needs that too") as caught:
        ep.reduce(*coarse, f_cut=f_cut)
    fem, partition = model(float(re.search(r"maxh of about (\S+),", str(caught.value))[1]))
    body = ep.reduce(fem, partition, basis="residual", f_cut=f_cut)
    axial = ep.STEEL.bar_wave_speed / (2 * length)
    assert abs(body.basis.omega / (2 * np.pi * axial) - 1).min() < 1e-3


def test_walls_of_tubes_are_found_and_solids_are_none():
    tube = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=0.02, h=0.01) - occ.Cylinder(
        occ.Pnt(0, 0, 0), occ.Z, r=0.018, h=0.01
    )
    fem = ep.fe_model(tube, ep.STEEL, maxh=5e-3)
    assert fem.weakest_wall.thickness == pytest.approx(2e-3, rel=0.05)
    ball = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), 0.01), ep.STEEL, maxh=3e-3)
    assert ball.weakest_wall.thickness == np.inf
    assert ball.resolved_frequency == ball.resolved_shear_frequency


def blocks(axes):
    """Points and hexahedra between places along each axis."""
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape([len(a) for a in axes])
    ring = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    cells = [number[tuple(slice(a, a + s - 1) for a, s in zip(at, number.shape, strict=True))].ravel() for at in ring]
    return points, np.stack(cells, axis=1)


@pytest.mark.parametrize("kind", ["hexahedron", "wedge"])
@pytest.mark.parametrize("ratio", [1, 4])
def test_linear_elements_that_make_a_strip_too_stiff_warn(tmp_path, kind, ratio):
    """Energy of even bending, u = (x z, 0, -x^2 / 2), by that of a beam: linear elements shear."""
    no_poisson = ep.Material(E=2e11, nu=0.0, rho=7800)
    points, cells = blocks([ratio * T * np.arange(7), ratio * T * np.arange(3), T * np.arange(2)])
    points, parts = split(points, cells, [kind] * len(cells))
    path = write(tmp_path / "strip.vtu", points, *parts)

    def energy(fem):
        x, _, z = (fem.points - [0, 0, T / 2]).T
        motion = np.stack([x * z, 0 * x, -(x**2) / 2], axis=1).ravel()
        return motion @ (fem.stiffness @ motion) / (no_poisson.E * fem.cell_volume.sum() * T**2 / 12)

    with pytest.warns(MeshQualityWarning, match="times as long as thick; linear elements make it") as said:
        linear = energy(ep.fe_model(path, no_poisson))
    told = float(re.search(r"make it (\S+) times as stiff", str(said[0].message))[1])
    assert told == pytest.approx(1 + ratio**2 / 2, rel=0.2)
    if kind == "hexahedron":
        assert linear == pytest.approx(1 + ratio**2 / 2, rel=1e-9)
    assert linear > 1.4
    assert energy(ep.fe_model(path, no_poisson, order=1)) == linear  # without a warning, as it was asked for
    assert energy(ep.fe_model(path, no_poisson, order=2)) == pytest.approx(1, rel=1e-9)


def test_quadratic_elements_far_longer_than_a_plate_is_thick_warn():
    """A square plate clamped all around under its weight, by its work, against cubic elements."""

    def work(fem):
        held = np.isclose(abs(fem.points[:, :2]), 20 * T).any(axis=1)
        dofs = np.flatnonzero(np.repeat(~held, 3))
        force = (fem.mass @ np.tile([0.0, 0.0, 1.0], fem.n_nodes))[dofs]
        return force @ scipy.sparse.linalg.spsolve(fem.stiffness[dofs][:, dofs].tocsc(), force)

    plate = box(40 * T, 40 * T, T)
    exact = work(ep.fe_model(plate, ep.STEEL, maxh=5 * T, order=3))
    with pytest.warns(MeshQualityWarning, match=r"times as long as thick; quadratic .* maxh, or order=3"):
        coarse = ep.fe_model(plate, ep.STEEL, maxh=5 * T)
    assert work(coarse) < 0.95 * exact
    assert work(ep.fe_model(plate, ep.STEEL, maxh=3 * T)) > 0.95 * exact


@pytest.mark.parametrize(("along", "layers", "resolves"), [(2, 1, False), (2, 4, False), (15, 2, True)])
def test_linear_hexahedra_in_a_wall(tmp_path, along, layers, resolves):
    """Far longer than the wall is thick they lock in shear, however many are on each other."""
    axes = [np.linspace(0, 0.01, along + 1)] * 2 + [np.linspace(0, T, layers + 1)]
    fem = ep.fe_model(write(tmp_path / "wall.vtu", *blocks(axes)), ep.STEEL, order=1)
    assert fem.weakest_wall.thickness == pytest.approx(T)
    np.testing.assert_allclose(fem.shares_of_walls(fem.cells).max(), 1 / min(layers, along))
    assert (fem.resolved_frequency > 0) == resolves


def test_what_is_followed_in_part_is_told(block, top):
    wall = block.weakest_wall
    below, above = (
        ep.reduce(block, top, f_cut=f).left_out
        for f in (0.9 * wall.accurate_frequency, 0.99 * block.resolved_frequency)
    )
    assert not any("bending waves" in said for said in below)
    assert any(said.startswith("bending waves above") for said in above)
