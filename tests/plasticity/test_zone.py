"""The plastic zone of a patch: strains and forces of its elements, and the flexibility of its nodes."""

import dataclasses
import pickle

import numpy as np
import pytest
from oracles import SIZE, box, each_way, hexahedra, quadratic, split, write_deck

import exudyn_partition as ep
from exudyn_partition.contact.plasticity.active_points import OrderedRows
from exudyn_partition.errors import EmptyRegionError, InputError
from exudyn_partition.fe.elements import kinds_of
from exudyn_partition.fe.model import node_dofs, rigid_modes
from exudyn_partition.plasticity import loops
from exudyn_partition.plasticity.flow import PlasticState
from exudyn_partition.plasticity.integration import flow_places, points_an_element
from exudyn_partition.plasticity.zone import PlasticZone
from exudyn_partition.plasticity.zone_stress import ZoneStress
from exudyn_partition.reduction.free_body import FreeBody

MATERIAL = ep.Material(E=70e9, nu=0.33, rho=2700.0, yield_stress=200e6, hardening=500e6)
CENTER = (0, 0, 4e-3)


def mixed(path, order, material):
    """The same box of wedges beside hexahedra on pyramids on tetrahedra."""
    points, cells = hexahedra(3, 4, 3)
    _, y, z = (points[cells].mean(axis=1) / SIZE).T
    kinds = np.select([y < 0, z > 0.6, z > 0.3], ["wedge", "hexahedron", "pyramid"], "foot")
    found = split(points * [1.0, 0.6, 4 / 30], cells, kinds)
    points, blocks = quadratic(*found) if order == 2 else found
    return ep.fe_model(write_deck(path, points, *blocks), material, order=order)


@pytest.fixture(scope="module", params=[1, 2, 3, "mixed 1", "mixed 2"])
def model(request, tmp_path_factory):
    material = dataclasses.replace(MATERIAL, nu=0.3)
    if isinstance(request.param, str):
        fem = mixed(tmp_path_factory.mktemp("zone") / "box.inp", int(request.param[-1]), material)
    else:
        maxh = 2.5e-3 if request.param < 3 else 4e-3
        fem = ep.fe_model(box(10e-3, 12e-3, 4e-3), material, maxh=maxh, order=request.param)
    return fem, ep.Partition.ball(fem, CENTER, 2.2e-3, plastic_radius=3e-3)


@pytest.fixture(scope="module")
def zone(model):
    fem, partition = model
    return PlasticZone(fem.points, partition.patches[0].plastic, fem.material)


def test_strains_are_those_of_a_linear_field(model, zone):
    fem, _ = model
    gradient = np.random.default_rng(1).standard_normal((3, 3))
    strain = (gradient + gradient.T) / 2
    deviator = strain - np.trace(strain) / 3 * np.eye(3)
    found = zone.strains((fem.points[zone.nodes] @ gradient.T).ravel())
    root = np.sqrt(2)
    expected = [*np.diag(deviator), root * deviator[1, 2], root * deviator[0, 2], root * deviator[0, 1]]
    np.testing.assert_allclose(found, np.tile(expected, (len(zone), 1)), atol=1e-12)


def test_weights_sum_to_the_volume_of_the_elements(model, zone):
    fem, partition = model
    own = {tuple(cell) for cell in partition.patches[0].plastic.cells}
    inside = np.array([tuple(cell) in own for cell in fem.cells])
    assert zone.weight.sum() == pytest.approx(fem.cell_mass[inside].sum() / fem.material.rho, rel=1e-9)


def test_the_spacing_is_that_of_nodes_along_the_edges(model, zone):
    """The same at all points of an element: each edge by the nodes that lie on it."""
    fem, partition = model
    region = partition.patches[0].plastic
    spacing = zone.spacing.reshape(len(region.cells), -1)
    for kind, rows in kinds_of(region.cells, region.hexahedra):
        for row in rows:
            x = fem.points[np.unique(region.cells[row])]
            steps = []
            for a, b in fem.points[region.cells[row][kind.columns[: kind.corners]][kind.edges]]:
                way = b - a
                share = (x - a) @ way / (way @ way)
                beside = np.linalg.norm(x - a - share[:, None] * way, axis=1) < 1e-9
                between = np.count_nonzero(beside & (share > 1e-6) & (share < 1 - 1e-6))
                steps.append(np.linalg.norm(way) / (1 + between))
            np.testing.assert_allclose(spacing[row], np.mean(steps), rtol=1e-9)


def test_elastic_forces_of_the_zone_are_those_of_plastic_strain(model, zone):
    """p of a plastic strain is the force by which the elements answer the same elastic strain, without its pressure."""
    fem, _ = model
    u = np.random.default_rng(2).standard_normal(3 * len(zone.nodes)) * 1e-6
    state = dataclasses.replace(PlasticState.virgin(len(zone)), strain=zone.strains(u))
    p = zone.pseudo_forces(state.strain)
    assert u @ p / 2 == pytest.approx(zone.own_energy(state), rel=1e-10)
    arms = fem.points[zone.nodes] - fem.points[zone.nodes].mean(axis=0)
    resultant = rigid_modes(arms).T @ p  # balanced in themselves
    assert abs(resultant[:3]).max() < 1e-9 * abs(p).sum()
    assert abs(resultant[3:]).max() < 1e-9 * abs(p).sum() * 3e-3


def test_a_part_of_a_zone_may_be_empty(zone):
    assert zone.part(np.zeros(len(zone), dtype=bool)).strain.shape == (0, 0)


@pytest.mark.parametrize("hardening", [0.0, 500e6, ((0.0, 200e6), (1e-3, 260e6), (4e-3, 300e6))])
def test_compiled_loops_give_the_same_flow(model, hardening):
    """Also of a part of the zone, from the state that a first step leaves behind."""
    fem, partition = model
    material = dataclasses.replace(MATERIAL, hardening=hardening, kinematic_hardening=1e9)
    whole = PlasticZone(fem.points, partition.patches[0].plastic, material)
    rng = np.random.default_rng(3)
    chosen = rng.random(len(whole)) < 0.5
    zone, size = whole.part(chosen), 3e-6
    first, second = size * rng.standard_normal((2, 3 * len(whole.nodes)))
    own = (3 * zone.nodes[:, None] + np.arange(3)).ravel()
    np.testing.assert_allclose(zone.strains(first[own]), whole.strains(first)[chosen], atol=1e-15)

    def flow():
        state, _, change = zone.answer(first[own], PlasticState.virgin(len(zone)))
        later, strain, more = zone.answer(second[own], state)
        beyond = zone.excess(first[own], later)
        return later.strain, later.equivalent, later.back, strain, change, more, beyond

    compiled, plain = each_way(flow)
    for one, other in zip(compiled, plain, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-11 * abs(other).max())
    assert 0.1 < np.mean(plain[1] > 0)


def test_flexibility_of_the_zone_is_that_of_a_solution_for_each_force(model):
    fem, partition = model
    body = FreeBody(fem, partition)
    dofs, flexibility = body.zone_dofs(partition.patches[0]), body.flexibility()
    loads = np.zeros((fem.n_dofs, len(dofs)))
    loads[dofs, np.arange(len(dofs))] = 1.0
    direct = flexibility(loads)[dofs]
    found = flexibility.kept(dofs) @ np.eye(len(dofs))
    assert abs(found - direct).max() < 1e-10 * abs(direct).max()


def test_flexibility_where_held_dofs_lie_in_the_zone(model):
    """A zone that covers the whole body."""
    fem, _ = model
    partition = ep.Partition.ball(fem, CENTER, 2e-3, plastic_radius=0.1)
    assert len(partition.patches[0].plastic.border) == 0
    body = FreeBody(fem, partition)
    flexibility = body.flexibility()
    direct = flexibility(np.eye(fem.n_dofs))
    found = flexibility.kept(np.arange(fem.n_dofs)) @ np.eye(fem.n_dofs)
    assert abs(found - direct).max() < 1e-10 * abs(direct).max()


def test_the_basis_has_the_residual_flexibility_of_the_zone(model):
    """F of the zone is consistent with that of the patch: both know the forces on common nodes along the normal."""
    fem, partition = model
    body = ep.reduce(fem, partition, f_cut=60e3)
    (zone,), patch = body.basis.zones, partition.patches[0]
    nodes = patch.plastic.nodes
    common = np.intersect1d(nodes, patch.nodes)
    normal = 3 * np.searchsorted(nodes, common) + 2
    rows = np.searchsorted(patch.nodes, common)
    F = body.flexibility()
    np.testing.assert_allclose(
        zone.of_patch[normal][:, rows], F[np.ix_(rows, rows)], rtol=1e-7, atol=1e-9 * abs(F).max()
    )
    np.testing.assert_allclose(zone.rows(normal)[:, normal], F[np.ix_(rows, rows)], rtol=1e-7, atol=1e-9 * abs(F).max())


def test_a_saved_body_keeps_its_zones_in_every_bit(model, tmp_path):
    body = ep.reduce(*model, f_cut=60e3)
    body.save(tmp_path / "body.npz")
    (zone,), (same,) = body.basis.zones, ep.load_body(tmp_path / "body.npz").basis.zones
    forces = np.random.default_rng(4).standard_normal(len(zone.own))
    np.testing.assert_array_equal(same.own @ forces, zone.own @ forces)
    np.testing.assert_array_equal(same.of_patch, zone.of_patch)


def test_what_a_run_finds_of_a_zone_is_not_pickled(model):
    """Dense rows and views of fronts would be many times the zone."""
    (zone,) = ep.reduce(*model, f_cut=60e3).basis.zones
    size, forces = len(pickle.dumps(zone)), np.random.default_rng(6).standard_normal(len(zone.own))
    moved, rows = zone.own @ forces, zone.rows(np.arange(30))
    kept = pickle.dumps(zone)
    assert len(kept) == size
    np.testing.assert_array_equal(pickle.loads(kept).own @ forces, moved)
    np.testing.assert_array_equal(pickle.loads(kept).rows(np.arange(30)), rows)


@pytest.mark.parametrize(("kind", "rounding"), [(float, 1e-12), (np.float32, 1e-4)])
def test_products_with_some_rows_are_those_of_the_whole(model, kind, rounding):
    """Dense rows in the order in which nodes come and go, and the fronts that some nodes reach."""
    body = ep.reduce(*model, f_cut=60e3)
    (zone,), rng = body.basis.zones, np.random.default_rng(5)
    n, by_fronts = len(zone.own), zone.own if kind is float else zone.own.single()
    ordered, size = OrderedRows(zone, kind), np.linalg.norm(zone.of_patch, axis=0).max()
    for count in (5, 30, 12, 0, 30):
        dofs = node_dofs(np.sort(rng.permutation(n // 3)[:count]))
        forces, whole = rng.standard_normal(len(dofs)), np.zeros(n)
        whole[dofs] = forces
        exact = zone.own @ whole
        for some in (ordered.at(dofs), by_fronts.at(dofs)):
            moved, answered = some.answer(forces)
            np.testing.assert_allclose(moved, exact[dofs], rtol=0, atol=rounding * size)
            np.testing.assert_allclose(some.spread(answered), exact, rtol=0, atol=rounding * size)


def test_the_middle_of_a_zone_needs_few_of_its_fronts():
    """Flow begins there. Its nodes reach less than half of what those reach that are spread over the zone."""
    block = ep.fe_model(box(12e-3, 12e-3, 6e-3), MATERIAL, maxh=1.5e-3, order=1)
    partition = ep.Partition.ball(block, (0, 0, 6e-3), 2.5e-3, plastic_radius=5e-3)
    nodes = partition.patches[0].plastic.nodes
    body = FreeBody(block, partition)
    fronts = body.flexibility().kept(body.zone_dofs(partition.patches[0])).fronts
    near = np.argsort(np.linalg.norm(block.points[nodes] - [0, 0, 6e-3], axis=1))
    few = len(nodes) // 20
    middle, spread = (node_dofs(np.sort(some)) for some in (near[:few], near[:: len(nodes) // few]))
    assert fronts.entries(fronts.reached(middle)) < 0.5 * fronts.entries(fronts.reached(spread))


def test_sums_of_few_rows_are_the_same_compiled():
    rng = np.random.default_rng(7)
    rows, weights = rng.standard_normal((40, 300)), np.where(np.arange(40) % 3, 0.0, rng.standard_normal(40))
    for one in each_way(lambda: (loops.combined(rows, weights), loops.combined(rows, 0 * weights))):
        np.testing.assert_allclose(one, (weights @ rows, np.zeros(300)), rtol=0, atol=1e-13)


def test_zone_by_default_and_where_it_is_refused(model):
    fem, _ = model
    elastic = dataclasses.replace(fem, material=dataclasses.replace(fem.material, hardening=None))
    own = ep.Partition.ball(fem, CENTER, 2e-3).patches[0].plastic
    away = np.linalg.norm(fem.points - CENTER, axis=1)
    beyond = np.linalg.norm(fem.points[own.cells].mean(axis=1) - CENTER, axis=1) > 2e-3
    assert not beyond.all()
    assert (away[own.cells[beyond]].min(axis=1) <= 1.5e-3).all()
    assert ep.Partition.ball(elastic, CENTER, 2e-3).patches[0].plastic is None
    with pytest.raises(InputError, match="the material is elastic; give hardening="):
        ep.Partition.ball(elastic, CENTER, 2e-3, plastic_radius=3e-3)
    with pytest.raises(EmptyRegionError, match="no element has its centre within"):
        ep.Partition.ball(fem, CENTER, 2e-3, plastic_radius=1e-6)
    with pytest.raises(InputError, match="knows no plastic zones"):
        ep.reduce(fem, ep.Partition.ball(fem, CENTER, 2e-3), f_cut=60e3, basis="craig-bampton")


def test_the_edge_of_a_zone_is_half_an_element_wide(model, zone):
    """Points count there that are nearest to a corner which elements beyond share."""
    fem, partition = model
    region = partition.patches[0].plastic
    border = zone.border.reshape(len(region.cells), -1)
    assert border.any()
    for kind, own in kinds_of(region.cells, region.hexahedra):
        corners = region.cells[own][:, kind.columns[: kind.corners]]
        held = np.isin(corners, region.border)
        if border.shape[1] == 1:
            np.testing.assert_array_equal(border[own, 0], held.any(axis=1))
        elif border.shape[1] == kind.corners:  # a point a corner
            np.testing.assert_array_equal(border[own].sum(axis=1), held.sum(axis=1))
        if kind.name.startswith("hexahedron"):  # bricks
            at = kind.functions(flow_places(kind))[0] @ fem.points[region.cells[own][:, kind.columns]]
            away = np.linalg.norm(at[:, :, None] - fem.points[corners][:, None], axis=-1)
            nearest = np.take_along_axis(held, away.argmin(axis=2), axis=1)
            np.testing.assert_array_equal(border[own], nearest)


def of_mandel(strain):
    """Strains in Mandel's notation as tensors in the order xx, yy, zz, yz, xz, xy."""
    return strain * [1, 1, 1, *[np.sqrt(0.5)] * 3]


def test_stress_of_a_plastic_strain_that_is_linear_in_space(model):
    """What it takes from Hooke's law is right at the points where it is known, in elements of each kind."""
    fem, partition = model
    region, shear = partition.patches[0].plastic, fem.material.shear_modulus
    rows = {cell.tobytes(): i for i, cell in enumerate(fem.cells)}
    slope, constant = np.random.default_rng(5).normal(size=(6, 3)), np.arange(6.0)
    q = points_an_element(region.cells, region.hexahedra)
    strain = np.zeros((len(region.cells), q, 6))
    known = kinds_of(region.cells, region.hexahedra)
    for kind, own in known:
        functions = kind.functions(flow_places(kind))[0]
        at = np.einsum("qn,cnd->cqd", functions, fem.points[region.cells[own][:, kind.columns]])
        strain[own] = 1e-3 * (constant + 100 * at @ slope.T)
    stress = ZoneStress(fem, region, fem.material)
    for kind, own in known:
        cell = np.repeat([rows[fem_cell.tobytes()] for fem_cell in region.cells[own].astype(fem.cells.dtype)], q)
        found = stress.taken(cell, np.tile(flow_places(kind), (len(own), 1)), strain.reshape(-1, 6))
        np.testing.assert_allclose(found, 2 * shear * of_mandel(strain[own].reshape(-1, 6)), rtol=1e-9, atol=1e-3)
        uniform = stress.rows(cell, np.tile(flow_places(kind), (len(own), 1)))
        assert abs(uniform @ (fem.points @ np.random.default_rng(6).normal(size=(3, 3))).ravel()).max() < 1e-3 * shear


def test_nodal_stress_of_a_uniform_plastic_strain(model):
    """In a zone that is the whole body, all nodes have it."""
    fem, _ = model
    region = ep.Partition.ball(fem, CENTER, 2.2e-3, plastic_radius=0.1).patches[0].plastic
    n = len(region.cells) * points_an_element(region.cells, region.hexahedra)
    own = 1e-3 * np.array([1.0, -2.0, 1.0, 0.3, 0.4, -0.5])
    found = ZoneStress(fem, region, fem.material).at_nodes(np.zeros((fem.n_nodes, 3)), np.tile(own, (n, 1)))
    expected = -2 * fem.material.shear_modulus * of_mandel(own)
    np.testing.assert_allclose(found, np.tile(expected, (fem.n_nodes, 1)), rtol=1e-9)


@pytest.mark.parametrize("grading", [0.5, 0.8])
def test_a_zone_is_nowhere_narrower_than_three_quarters_of_its_radius(grading):
    """Where the mesh gets coarser, large elements with their centres outside reach to the middle of the ball."""
    fem = ep.fe_model(
        box(20e-3, 20e-3, 10e-3),
        MATERIAL,
        maxh=6e-3,
        refine=[ep.Refine((0, 0, 10e-3), 0.3e-3, 0.2e-3)],
        grading=grading,
    )
    center, radius = np.array([0, 0, 10e-3]), 1.2e-3
    region = ep.Partition.ball(fem, center, 0.6e-3, plastic_radius=radius).patches[0].plastic
    away = np.linalg.norm(fem.points - center, axis=1)
    mean = fem.points[fem.cells].mean(axis=1) - center
    own = {tuple(cell) for cell in region.cells}
    inside = np.array([tuple(cell) in own for cell in fem.cells])
    assert away[fem.cells[~inside]].min() > 0.75 * radius
    assert inside[np.linalg.norm(mean, axis=1) <= radius].all()
    reaching = away[fem.cells].min(axis=1) <= 0.75 * radius
    assert np.count_nonzero(reaching & (np.linalg.norm(mean, axis=1) > radius)) > 0  # the mesh has such elements
    np.testing.assert_array_equal(inside, reaching | (np.linalg.norm(mean, axis=1) <= radius))
    zone = PlasticZone(fem.points, region, MATERIAL)
    for point in np.flatnonzero(zone.border)[:5]:
        to_edge = np.linalg.norm(fem.points[region.border] - zone.place(point), axis=1)
        assert np.linalg.norm(zone.edge_near(point) - zone.place(point)) == to_edge.min()


def test_work_of_strain_is_stored_or_taken_by_flow(zone):
    """Stress grows along a straight path in each step, so that the trapezoid is exact for both works."""
    rng, state, strain = np.random.default_rng(7), PlasticState.virgin(len(zone)), np.zeros((len(zone), 6))
    for _ in range(3):
        u = 2e-5 * rng.standard_normal(3 * len(zone.nodes))
        after, now, _ = zone.answer(u, state)
        assert np.count_nonzero(after.equivalent > state.equivalent) > 0.5 * len(zone)
        begin, end = zone.flow.stress(strain, state), zone.flow.stress(now, after)
        done = zone.weight @ ((begin + end) / 2 * (now - strain)).sum(axis=1)
        of_stress = [zone.weight @ (stress**2).sum(axis=1) / (4 * zone.flow.shear_modulus) for stress in (begin, end)]
        assert zone.work((state, strain), (after, now)) == pytest.approx(done - of_stress[1] + of_stress[0], rel=1e-9)
        state, strain = after, now
