"""FE models of matrices from elsewhere: the body is that of our own elements; what does not fit is refused by name."""

from dataclasses import replace

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest
import scipy.sparse as sp
from oracles import box, hexahedra, split, write, write_deck
from oracles import quadratic as with_middles

import exudyn_partition as ep
from exudyn_partition.errors import InputError, MeshError, UnitsWarning
from exudyn_partition.fe.consistency import check_elements
from exudyn_partition.fe.given_matrices import check_surface, enclosed_volume
from exudyn_partition.meshing.ngsolve_fem import surplus_of

TOP = (0, 0, 0.03)


def bored():
    """A block with a bore, of curved elements."""
    block = occ.Box((-0.01, -0.01, 0), (0.01, 0.01, 0.03)) - occ.Cylinder(
        occ.Pnt(0, -0.02, 0.01), occ.Y, r=4e-3, h=0.04
    )
    block.faces.Min(occ.Z).name = "foot"
    return block


@pytest.fixture(scope="module", params=[1, 2])
def own(request):
    return ep.fe_model(bored(), ep.STEEL, maxh=9e-3, order=request.param)


@pytest.fixture(scope="module")
def answer(own):
    return flexibility(own)


def by_surface(fem, material=None, **changes):
    """The same model, without its elements."""
    given = {"mass": fem.mass, "stiffness": fem.stiffness, "points": fem.points, "facets": fem.facets}
    boundaries = fem.boundaries if "facets" not in changes else {}
    return ep.FEModel.from_matrices(**(given | changes), material=material or fem.material, boundaries=boundaries)


def flexibility(fem, f=7e3):
    """What equal and opposite forces at top and foot move there, with the contact's own flexibility [m/N]."""
    top = ep.Partition.ball(fem, TOP, 6e-3, direction=(0, 0, 1), name="top")
    foot = ep.Partition.interface(fem, "foot", nodes="foot")
    out = ep.reduce(fem, top | foot, f_cut=60e3).matrices()
    rows = np.vstack([out.contacts["top"].rows, out.interfaces["foot"]])
    answer = np.linalg.solve((out.stiffness - (2 * np.pi * f) ** 2 * out.mass).toarray(), rows.T)
    return rows @ answer, out.contacts["top"].flexibility


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.MeshQualityWarning")
@pytest.mark.parametrize("way", ["facets", "cells", "other order of dofs"])
def test_the_body_is_the_same(own, answer, way):
    """Responses at 7 kHz, between the rigid motion and the first bending, and the contact's flexibility."""
    if way == "facets":
        other = by_surface(own)
    elif way == "cells":
        other = ep.FEModel.from_matrices(
            own.mass, own.stiffness, own.points, cells=own.cells, material=ep.STEEL, boundaries=own.boundaries
        )
    else:
        order = np.random.default_rng(1).permutation(own.n_dofs)
        mixed = [matrix[order][:, order] for matrix in (own.mass, own.stiffness)]
        other = by_surface(
            own, mass=mixed[0], stiffness=mixed[1], dofs=np.column_stack(np.divmod(order, 3)), facets=own.facets
        )
        other = replace(other, boundaries=own.boundaries)
    for one, two in zip(answer, flexibility(other), strict=True):
        np.testing.assert_allclose(two, one, rtol=0, atol=1e-10 * abs(one).max())
    assert other.total_mass == pytest.approx(own.total_mass, rel=1e-6)
    np.testing.assert_allclose(other.inertia_tensor, own.inertia_tensor, rtol=1e-10)


def test_an_impact_needs_no_elements():
    """The same force, whether the elements are known or not."""
    ball = occ.Sphere((0, 0, 0.01), 0.01)
    own = ep.fe_model(ball, ep.STEEL, maxh=6e-3, refine=[ep.Refine((0, 0, 0), 0.5e-3, 0.3e-3)])
    forces = []
    for fem in (own, by_surface(own)):
        body = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), 1e-3, direction=(0, 0, -1)), f_cut=80e3)
        mbs = exu.SystemContainer().AddSystem()
        item = ep.CreatePartitionBody(mbs, body, initialVelocity=[0, 0, -0.1])
        contact = ep.CreatePartitionContact(mbs, item, ep.RigidPlane((0, 0, -1e-9)))
        mbs.Assemble()
        forces.append(contact.force(ep.solve_dynamic(mbs, end_time=8e-6)))
    assert forces[0].max() > 10
    np.testing.assert_allclose(forces[1], forces[0], atol=1e-9 * forces[0].max())


def test_lumped_mass_without_elements_is_that_of_straight_ones():
    for order in (1, 2, 3):
        own = ep.fe_model(box(0.01, 0.02, 0.03), ep.STEEL, maxh=1e-2, order=order)
        np.testing.assert_allclose(by_surface(own).lumped_mass, own.lumped_mass, rtol=1e-12)


def test_hexahedra(tmp_path):
    points, cells = hexahedra(2, 3, 4)
    own = ep.fe_model(write(tmp_path / "block.vtu", points, ("hexahedron", cells)), ep.STEEL)
    other = by_surface(own)
    assert other.max_size == pytest.approx(own.max_size, rel=0.3)
    np.testing.assert_allclose(other.lumped_mass, own.lumped_mass, rtol=1e-12)


@pytest.mark.parametrize("order", [1, 2])
def test_wedges_and_pyramids_among_hexahedra(tmp_path, order):
    """Triangles among quadrilaterals; the same responses by the elements and by the surface, of the order that is."""
    kinds = ["wedge"] * 6 + ["hexahedron", "pyramid"] * 3
    points, blocks = split(*hexahedra(2, 2, 3), kinds)
    if order == 2:
        points, blocks = with_middles(points, blocks)
    own = ep.fe_model(write_deck(tmp_path / "bar.inp", points, *blocks), ep.STEEL)
    assert own.facets.shape[1] == 4 * order
    other = by_surface(own)
    assert other.order == own.order == order
    rows = []
    for fem in (own, other):
        foot = ep.Partition.interface(fem, "foot", plane=((0, 0, 0), (0, 0, -1)))
        out = ep.reduce(fem, foot, f_cut=0.8 * min(own.resolved_frequency, other.resolved_frequency)).matrices()
        foot = out.interfaces["foot"]
        rows.append(foot @ np.linalg.solve((out.stiffness - (2e4 * np.pi) ** 2 * out.mass).toarray(), foot.T))
    np.testing.assert_allclose(rows[1], rows[0], atol=1e-9 * abs(rows[0]).max())
    with pytest.raises(MeshError, match="expected the whole surface"):
        by_surface(own, facets=own.facets[1:])


def test_what_a_mesh_resolves_is_estimated_without_its_elements():
    """Shear waves by the distance of coupled nodes, and bending waves by the thickness between opposite facets."""
    for shape, maxh in ((box(0.01, 0.02, 0.03), 4e-3), (box(0.1, 0.1, 2e-3), 8e-3)):
        own = ep.fe_model(shape, ep.STEEL, maxh=maxh)
        other = by_surface(own)
        assert other.weakest_wall.thickness == pytest.approx(own.weakest_wall.thickness, rel=1e-9)
        assert other.resolved_frequency == pytest.approx(own.resolved_frequency, rel=0.25)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_the_volume_inside_curved_facets(order):
    own = ep.fe_model(occ.Sphere((0, 0, 0), 0.01), ep.STEEL, maxh=2e-2, order=order)
    assert enclosed_volume(own.points, own.facets) == pytest.approx(own.cell_volume.sum(), rel=1e-8)
    assert check_surface(own.points, own.facets) == enclosed_volume(own.points, own.facets)


def moved(matrix, one, two):
    """Two nodes of a matrix exchanged."""
    order = np.arange(matrix.shape[0]).reshape(-1, 3)
    order[[one, two]] = order[[two, one]]
    return matrix[order.ravel()][:, order.ravel()]


def blocked(matrix):
    """All x, then all y, then all z."""
    order = np.arange(matrix.shape[0]).reshape(-1, 3).T.ravel()
    return matrix[order][:, order]


def held(matrix):
    """A penalty on one node, as Abaqus writes it."""
    diagonal = np.zeros(matrix.shape[0])
    diagonal[6:9] = 1e36
    return matrix + sp.diags(diagonal)


def softer_somewhere(fem):
    """Stiffness with one element of half the modulus."""
    modulus = np.full(len(fem.cells), ep.STEEL.E)
    modulus[5] /= 2
    return ep.fe_model(bored(), ep.STEEL, maxh=9e-3, order=fem.order, modulus=lambda places: modulus).stiffness


def upside(fem):
    """Dofs of nodes in the order of their mass, heavy ones below."""
    order = np.empty(fem.n_nodes, dtype=int)
    order[np.argsort(fem.points[:, 2])] = np.argsort(-fem.lumped_mass)
    return (3 * order[:, None] + np.arange(3)).ravel()


def inner(fem):
    """Two nodes of the surface far from each other."""
    nodes = np.unique(fem.facets)
    return nodes[0], nodes[np.linalg.norm(fem.points[nodes] - fem.points[nodes[0]], axis=1).argmax()]


def turned(fem):
    """A local system of coordinates at one node, as of *TRANSFORM."""
    turn = sp.lil_matrix(sp.identity(fem.n_dofs))
    turn[30:32, 30:32] = [[0.8, 0.6], [-0.6, 0.8]]
    return turn.tocsr() @ fem.stiffness @ turn.T.tocsr()


WRONG = {
    "millimetres": (lambda f: {"points": f.points * 1e3}, "mass: a motion along x moves .* kg, 1e[+]09 times"),
    "density": (lambda f: {"material": replace(ep.STEEL, rho=7850.0)}, "mass: a motion along x"),
    "modulus": (lambda f: {"material": replace(ep.STEEL, E=206e9)}, "material: a uniform strain along x stores"),
    "Poisson's ratio": (lambda f: {"material": replace(ep.STEEL, nu=0.29)}, "material: a uniform strain"),
    "stiffness in N/mm": (lambda f: {"stiffness": f.stiffness / 1e3}, "material: a uniform strain"),
    "mass in t": (lambda f: {"mass": f.mass / 1e3}, "mass: a motion along x"),
    "x x x y y y": (lambda f: {"mass": blocked(f.mass), "stiffness": blocked(f.stiffness)}, "stiffness|mass"),
    "another order of nodes": (lambda f: {"stiffness": moved(f.stiffness, *inner(f))}, "stiffness: "),
    "another order of both": (
        lambda f: {"stiffness": moved(f.stiffness, *inner(f)), "mass": moved(f.mass, *inner(f))},
        "stiffness: ",
    ),
    "the lower nodes of the mass upside": (
        lambda f: {"mass": f.mass[upside(f)][:, upside(f)]},
        "mass: its centre lies .* m from that of the volume",
    ),
    "one triangle": (lambda f: {"stiffness": sp.triu(f.stiffness)}, "stiffness: expected a symmetric matrix"),
    "one triangle of the mass": (lambda f: {"mass": sp.triu(f.mass)}, "mass: expected a symmetric matrix"),
    "held": (lambda f: {"stiffness": held(f.stiffness)}, "stiffness: 3 diagonal entries, as that of x of node 2"),
    "a spring to the ground": (
        lambda f: {"stiffness": f.stiffness + sp.diags(np.r_[1e7, np.zeros(f.n_dofs - 1)])},
        "stiffness: rigid motion gives forces",
    ),
    "local axes": (lambda f: {"stiffness": turned(f)}, "stiffness: rigid motion gives forces"),
    "mass and stiffness exchanged": (
        lambda f: {"mass": f.stiffness, "stiffness": f.mass},
        "mass: its entries differ between x, y and z by",
    ),
    "a rotated mass": (
        lambda f: {"mass": f.mass + sp.diags(np.tile([1e-3, 0, 0], f.n_nodes))},
        "mass: its entries differ between x, y and z",
    ),
    "rows missing": (lambda f: {"mass": f.mass[3:, 3:]}, "mass: expected shape"),
    "complex": (lambda f: {"stiffness": f.stiffness * (1 + 0.02j)}, "stiffness: expected real numbers"),
    "not finite": (lambda f: {"mass": f.mass * np.nan}, "mass: expected finite numbers"),
    "an element of another modulus": (lambda f: {"stiffness": softer_somewhere(f)}, "material: |stiffness: at"),
    "a facet missing": (lambda f: {"facets": f.facets[1:]}, "facets: expected the whole surface.* 3 edges"),
    "a facet twice": (lambda f: {"facets": f.facets[[0, *range(len(f.facets))]]}, "facets: expected the whole"),
    "a facet turned": (lambda f: {"facets": np.vstack([inwards(f.facets[:1]), f.facets[1:]])}, "opposite ways"),
    "all facets turned": (lambda f: {"facets": inwards(f.facets)}, "facets: they enclose -"),
    "facets from 1 on": (lambda f: {"facets": f.facets + 1 + f.n_nodes - 1 - f.facets.max()}, "facets|mass|stiffness"),
    "facets beyond the nodes": (lambda f: {"facets": f.facets + f.n_nodes}, "facets: expected numbers from 0 to"),
    "facets of five nodes": (lambda f: {"facets": np.zeros((4, 5), int)}, "facets: expected triangles with 3, 6"),
    "no facets": (lambda f: {"facets": f.facets[:0]}, "facets: "),
    "facets in a row": (lambda f: {"facets": f.facets.ravel()}, "facets: expected shape"),
    "elements of five nodes": (
        lambda f: {"facets": None, "cells": f.cells[:, :5]},
        "cells: expected tetrahedra .* got 5 nodes",
    ),
    "elements in a row": (lambda f: {"facets": None, "cells": f.cells.ravel()}, "cells: expected shape"),
    "no elements": (lambda f: {"facets": None, "cells": f.cells[:0]}, "cells: expected elements, got none"),
    "an element missing": (lambda f: {"facets": None, "cells": f.cells[1:]}, "cells|mass: a motion along x"),
    "elements turned": (
        lambda f: {"facets": None, "cells": f.cells[:, [1, 0, 2, 3, 4, 6, 5, 8, 7, 9]]},
        "cell_mass: .* have no mass, or negative",
    ),
    "neither": (lambda f: {"facets": None}, "facets, cells: expected one of them, got none"),
    "both": (lambda f: {"cells": f.cells}, "facets, cells: expected one of them, got both"),
    "dofs counted from 1": (lambda f: {"dofs": dofs(f) + 1}, "dofs: .* Programs count both from 1"),
    "a dof twice": (lambda f: {"dofs": dofs(f)[[0, *range(f.n_dofs - 1)]]}, "1 are missing, the first is z of node"),
    "dofs of another shape": (lambda f: {"dofs": dofs(f)[:-3]}, "dofs: expected shape"),
    "dofs in words": (lambda f: {"dofs": "xyz"}, "dofs: expected whole numbers"),
    "no material": (lambda f: {"material": "steel"}, "material: expected"),
    "two bodies": (
        lambda f: {
            "points": np.vstack([f.points, f.points + 1]),
            "facets": np.vstack([f.facets, f.facets + f.n_nodes]),
            "mass": sp.block_diag([f.mass] * 2),
            "stiffness": sp.block_diag([f.stiffness] * 2),
        },
        "stiffness: 2 parts are not connected",
    ),
}


def dofs(fem):
    return np.column_stack(np.divmod(np.arange(fem.n_dofs), 3))


def inwards(facets):
    """Facets of three corners and of those with a node on each edge, turned."""
    return facets[:, {3: [0, 2, 1], 6: [0, 2, 1, 5, 4, 3]}[facets.shape[1]]]


@pytest.fixture(scope="module")
def quadratic():
    return ep.fe_model(bored(), ep.STEEL, maxh=9e-3)


@pytest.mark.filterwarnings("ignore::exudyn_partition.errors.UnitsWarning")
@pytest.mark.parametrize("name", WRONG)
def test_what_does_not_fit_is_refused(quadratic, name):
    change, message = WRONG[name]
    with pytest.raises(InputError, match=message):
        by_surface(quadratic, **change(quadratic))


def test_a_material_in_millimetres_for_points_in_metres_is_told(quadratic):
    """All fit together, but the part would be 30 um long."""
    scaled = ep.Material(E=210e3, nu=0.3, rho=7.8e-9)
    with pytest.warns(UnitsWarning, match="those of a solid in millimetres"):
        by_surface(quadratic, scaled, mass=quadratic.mass * 1e-12, stiffness=quadratic.stiffness * 1e-6)


@pytest.mark.parametrize("what", ["strain", "stress", "plastic flow", "error of the mesh"])
def test_what_needs_elements_is_refused_by_name(quadratic, what):
    fem = by_surface(quadratic)
    field = np.zeros((fem.n_nodes, 3))
    needs = {
        "strain": lambda: ep.recovery.nodal_strain(fem, field),
        "stress": lambda: ep.recovery.stress_rows(fem, np.zeros((1, 3))),
        "plastic flow": lambda: ep.Partition.ball(
            by_surface(quadratic, replace(ep.STEEL, hardening=1e9)), TOP, 6e-3, plastic_radius=3e-3
        ),
        "error of the mesh": lambda: surplus_of(fem),
    }
    with pytest.raises(InputError, match=r"fem: .*needs the elements"):
        needs[what]()


def test_elements_must_be_there_one_way_or_the_other(quadratic):
    with pytest.raises(MeshError, match="without them give facets"):
        replace(quadratic, cells=quadratic.cells[:0], cell_mass=quadratic.cell_mass[:0])


@pytest.mark.parametrize("hexahedra", [None, "yes", 2])
def test_a_flag_is_one_beside_facets_too(quadratic, hexahedra):
    with pytest.raises(InputError, match="hexahedra: expected"):
        by_surface(quadratic, hexahedra=hexahedra)


@pytest.fixture(scope="module")
def of_two():
    halves = [box(0.01, 0.01, 0.02).mat("low"), box(0.01, 0.01, 0.02).Move(occ.Vec(0, 0, 0.02)).mat("high")]
    return ep.fe_model(occ.Glue(halves), {"low": ep.STEEL, "high": ep.ALUMINIUM}, maxh=8e-3)


def test_matrices_of_several_materials(of_two):
    names = np.array(of_two.regions.names)[of_two.regions.number]
    given = {"mass": of_two.mass, "stiffness": of_two.stiffness, "points": of_two.points, "cells": of_two.cells}
    materials = {"high": ep.ALUMINIUM, "low": ep.STEEL}
    fem = ep.FEModel.from_matrices(**given, material=materials, regions=names)
    np.testing.assert_allclose(fem.cell_mass, of_two.cell_mass, rtol=1e-12)
    np.testing.assert_array_equal(fem.regions.E, of_two.regions.E)
    assert fem.material == of_two.material
    low = np.flatnonzero(fem.points[fem.facets][..., 2].max(axis=1) < 1e-9)
    assert fem.material_beneath(low) == ep.STEEL
    for wrong, message in (
        ({"regions": np.where(names == "low", "high", "low")}, "cell_mass|material|mass"),
        ({"regions": names[1:]}, f"regions: expected {len(names)} names"),
        ({"regions": np.zeros(len(names))}, f"regions: expected {len(names)} names, .* got float64"),
        ({"regions": None}, "several need cells= and regions="),
        ({"material": {"low": ep.STEEL}}, "material: expected one for each name of regions, .*'high', 'low'"),
        ({"material": ep.STEEL}, "regions: has no effect with one material"),
        ({"material": {"low": ep.STEEL, "high": 3}}, r"material\['high'\]"),
        ({"cells": None, "facets": of_two.facets}, "several need cells="),
    ):
        with pytest.raises(InputError, match=message):
            ep.FEModel.from_matrices(**given | {"material": materials, "regions": names} | wrong)


def test_elements_that_are_inside_out_beside_integration_points_are_named():
    """A mid-side node far off turns a corner; volumes of such elements differ between codes by where they look."""
    fem = ep.fe_model(box(0.01, 0.01, 0.01), ep.STEEL, maxh=0.01)
    points = np.array(fem.points)
    cell = fem.cells[0]
    a, b = cell[:2]
    points[cell[4]] = points[a] + 0.2 * (points[b] - points[a])
    masses = 1.05 * fem.cell_mass
    with pytest.raises(MeshError, match=r"elements are inside out in a corner, .* Take a smaller maxh"):
        check_elements(points, fem.cells, fem.hexahedra, masses, fem.mass, fem.stiffness, fem.elastic)
    with pytest.raises(InputError, match="cell_mass: expected density times volume"):
        check_elements(fem.points, fem.cells, fem.hexahedra, masses, fem.mass, fem.stiffness, fem.elastic)
