"""Rigid profiles: a circle is a cylinder, an ellipse has its own distances, and contact wanders over it."""

import netgen.occ as occ
import numpy as np
import pytest
from oracles import compliant, floating, moved

import exudyn_partition as ep
from exudyn_partition.contact.rigid import RigidGaps
from exudyn_partition.contact.wandering import WanderingRigidGaps
from exudyn_partition.errors import InputError
from exudyn_partition.surfaces.points import contact_points

R, BALL = 0.02, 5e-3


def circle(angle):
    return R * np.column_stack([np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize("sense", [1, -1])
def test_a_circle_is_a_cylinder(sense):
    point, axis = [1e-3, -2e-3, 3e-3], [1.0, 2.0, 2.0]
    profile = ep.RigidProfile(circle(np.linspace(0, 2 * np.pi, 360, endpoint=False))[::sense], point, axis)
    x = point + 0.025 * np.random.default_rng(0).standard_normal((200, 3))
    known = ep.RigidCylinder(point, axis, R).project(x)
    outer = known[0] > -0.9 * R
    for found, expected in zip(profile.project(x), known, strict=True):
        np.testing.assert_allclose(found[outer], expected[outer], atol=1e-6)


def test_distances_from_an_ellipse_are_the_least_ones():
    def ellipse(angle):
        return np.column_stack([0.03 * np.cos(angle), 0.02 * np.sin(angle)])

    x = 0.05 * np.random.default_rng(1).standard_normal((100, 2))
    x = x[(x[:, 0] / 0.03) ** 2 + (x[:, 1] / 0.02) ** 2 > 1]
    many = ellipse(np.linspace(0, 2 * np.pi, 20001))
    least = np.linalg.norm(x[:, None] - many, axis=2).min(axis=1)
    gap, normal = ep.RigidProfile(ellipse).project(np.column_stack([x, np.zeros(len(x))]))
    np.testing.assert_allclose(gap, least, atol=1e-8)
    foot = x - gap[:, None] * normal[:, :2]
    np.testing.assert_allclose((foot[:, 0] / 0.03) ** 2 + (foot[:, 1] / 0.02) ** 2, 1, atol=1e-8)


def test_a_carried_profile_presses_as_a_cylinder_and_a_surface_as_a_small_patch(round_body):
    """The patch of the ball is taken as a whole surface; the profile has turned with its body."""
    A = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # carries z of the profile to x
    place = np.array([0, 0, -R])
    surfaces = (ep.RigidProfile(circle), lambda: (place, A)), (ep.RigidCylinder(place, (1, 0, 0), R), None)
    force = []
    for surface, pose in surfaces:
        side = floating(round_body)
        law = compliant(RigidGaps(side, surface, pose=pose))
        law.at(moved(side, [0, 0, -4e-6]))
        force.append(law.evaluation.resultant())
    assert force[1][2] > 50
    np.testing.assert_allclose(force[0], force[1], rtol=1e-5, atol=1e-5 * force[1][2])


def test_a_surface_that_starts_far_away_knows_its_nearest_rows():
    """The stiffness of the contact, which limits explicit steps, does not depend on the distance at the start."""
    fem = ep.fe_model(occ.Box((-5e-3, -5e-3, 0), (5e-3, 5e-3, 5e-3)), ep.STEEL, maxh=4e-3)
    body = ep.reduce(fem, ep.Partition.surface(fem, [(-1, -1, -1e-6), (1, 1, 1e-6)]), f_cut=50e3)
    laws = [compliant(WanderingRigidGaps(floating(body), ep.RigidPlane((0, 0, -d)))) for d in (1e-6, 0.02)]
    near, far = (law.closed_stiffness() for law in laws)
    np.testing.assert_allclose(far, near, atol=1e-9 * abs(near).max())
    assert not laws[1].at(np.zeros(body.n_dofs)).generalised.any()


def test_rows_to_a_rigid_plane_come_and_go_with_the_place_of_contact():
    """A ball that rolls on a plane; its whole surface is one patch. The gaps of all rows are the oracle."""
    fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, 0), BALL), ep.STEEL, maxh=2.5e-3)
    body = ep.reduce(fem, ep.Partition.surface(fem, np.arange(len(fem.facets))), f_cut=100e3)
    down, bottom = floating(body), fem.points.min(axis=0)[2] - 1e-6
    law = compliant(WanderingRigidGaps(down, ep.RigidPlane((0, 0, bottom))))
    points = contact_points(down.surface, "integrated")
    for angle in (0.0, 0.3, 1.1, 2.0):
        q = down.kinematics.moved(np.zeros(body.n_dofs), np.r_[0, 0, 0, angle, 0, 0, np.zeros(body.n_dofs - 6)])
        q[2] = -0.2e-3
        law.at(q)
        gap, rows = points.mean @ (points.at(down.kinematics.place(q))[:, 2] - bottom), law.gaps.row_nodes
        np.testing.assert_allclose(law.evaluation.h, gap[rows], atol=1e-15)
        assert set(np.flatnonzero(gap < 0)) <= set(rows)
        assert len(rows) < len(gap) / 2
        assert law.evaluation.resultant()[2] > 100


@pytest.mark.parametrize(
    ("curve", "match"),
    [
        (np.zeros((9, 3)), "curve: expected"),
        (circle(np.linspace(0, 6, 5)), "at least 8"),
        (circle(np.linspace(0, 2 * np.pi, 20)), "each point once"),
        ([(float(i), 0.0) for i in range(9)], "enclose none"),
        (lambda angle: 1 / 0, "curve: expected a function of angles.*raises ZeroDivisionError"),
    ],
)
def test_wrong_curves_have_named_errors(curve, match):
    with pytest.raises(InputError, match=match):
        ep.RigidProfile(curve)
    with pytest.raises(InputError, match="across the axis"):
        ep.RigidProfile(circle, first=(0, 0, 1))
