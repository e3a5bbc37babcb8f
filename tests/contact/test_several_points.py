"""Several points of contact on one patch: faces, forces, energies, states, and points that pass from face to face."""

import itertools

import exudyn as exu
import netgen.occ as occ
import numpy as np
import pytest

import exudyn_partition as ep
from exudyn_partition.contact.formulations.hertz_friction import Springs
from exudyn_partition.contact.smooth_faces import smooth_faces
from exudyn_partition.contact.true_surface import Torus
from exudyn_partition.errors import ContactPatchWarning, InputError

pytestmark = [
    pytest.mark.filterwarnings("ignore::exudyn_partition.errors.YieldWarning"),
    pytest.mark.filterwarnings("ignore:.*Left out, so that nothing keeps"),
]
SPEED, CLEARANCE, TOP = 0.5, 1e-7, 9e-3
BUMPS = [(-3e-3, 0, TOP), (3e-3, 0, TOP)]


@pytest.fixture(scope="module")
def bumps():
    """A steel block with two bumps of 4 mm radius, and one patch of both and what is between them."""
    block = occ.Box(occ.Pnt(-9e-3, -5e-3, 0), occ.Pnt(9e-3, 5e-3, 8e-3))
    for x, y, z in BUMPS:
        ball = occ.Sphere(occ.Pnt(x, y, z - 4e-3), 4e-3)
        block += ball.Rotate(occ.Axis(occ.Pnt(x, y, z - 4e-3), occ.Dir(1, 0.3, 0.1)), 50)
    fem = ep.fe_model(block, ep.STEEL, maxh=4e-3, refine=[ep.Refine(top, 1.8e-3, 0.6e-3) for top in BUMPS], grading=0.6)
    return ep.reduce(fem, ep.Partition.ball(fem, (0, 0, TOP), 5.5e-3, axes="xyz", direction=(0, 0, 1)), f_cut=100e3)


def impact(body, friction=None, sliding=0.0, end=50e-6):
    """Model, body, and contacts of the block that comes with both bumps to a plane."""
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, body, initialVelocity=[sliding, 0, SPEED])
    plane = ep.RigidPlane((0, 0, TOP + CLEARANCE), (0, 0, -1))
    contacts = ep.CreatePartitionContact(mbs, [item, plane], formulation="hertz", friction=friction)
    mbs.Assemble()
    return mbs, item, contacts


def test_faces_of_a_patch_are_found(bumps):
    faces = smooth_faces(bumps.points, bumps.partition.patches[0].facets)
    balls = [face.surface for face in faces.known if face.surface.ball is not None]
    centres = sorted(tuple(np.round(ball.ball[0], 8)) for ball in balls)
    np.testing.assert_allclose(centres, [(-3e-3, 0, 5e-3), (3e-3, 0, 5e-3)], atol=1e-8)
    assert [ball.ball[1] for ball in balls] == pytest.approx([4e-3, 4e-3], rel=1e-6)
    flat = [face.surface.shape.normal for face in faces.known if face.surface.ball is None]
    np.testing.assert_allclose(flat, [(0, 0, 1)] * len(flat), atol=1e-9)
    assert not faces.unknown
    assert not any(len(face.seam) for face in faces.known)  # they meet at edges


def test_contacts_of_one_patch_have_its_side_in_common(bumps):
    """A patch is placed once for all of them: with whole skins on each other there are hundreds."""
    _, _, contacts = impact(bumps)
    first, second = (contact.mechanics.gaps.sides[0].surface for contact in contacts[:2])
    assert np.shares_memory(first.points, second.points)


def test_gaps_of_a_torus_change_as_it_moves():
    """Against central differences, by centre, axis, ring and tube; the axis stays a unit vector."""
    rng = np.random.default_rng(3)
    values = np.array([0.1, -0.2, 0.3, *rng.normal(size=3), 2.0, 0.6])
    values[3:6] /= np.linalg.norm(values[3:6])
    x = 2.5 * rng.normal(size=(20, 3))

    def gaps(values):
        axis = values[3:6] / np.linalg.norm(values[3:6])
        return Torus(values[:3], axis, values[6], values[7]).project(x)[0]

    step = 1e-6 * np.eye(8)
    differences = np.column_stack([(gaps(values + way) - gaps(values - way)) / 2e-6 for way in step])
    by_values = Torus(values[:3], values[3:6], values[6], values[7]).gaps_by(x)
    np.testing.assert_allclose(by_values, differences, atol=1e-8)


def test_two_bumps_of_one_patch_share_an_impact(bumps):
    """Each is a ball of half the mass; energy counts what points do to each other."""
    mbs, item, contacts = impact(bumps)
    result = ep.solve_dynamic(mbs, end_time=50e-6, step=0.2e-6)
    hertz = ep.hertz.impact(bumps.total_mass / 2, SPEED, 4e-3, np.inf, ep.STEEL)
    forces = [contact.force(result) for contact in contacts]
    for force in forces:
        assert force.max() == pytest.approx(hertz.peak_force, rel=0.03)
    impulse = np.trapezoid(sum(forces), result.t)
    assert impulse == pytest.approx(2 * bumps.total_mass * SPEED, rel=0.01)
    energy = item.energy(result) + sum(contact.energy(result) for contact in contacts)
    assert np.ptp(energy) < 1e-4 * energy[0]


@pytest.mark.parametrize(("friction", "taken"), [(None, 1e-5), (0.3, 1e-3)])  # springs of friction slip a little
def test_forces_of_points_are_the_derivative_of_their_common_energy(bumps, friction, taken):
    """Without what points do to each other, the energy would be 0.3 % off here."""
    _, _, contacts = impact(bumps, friction)
    members = [contact.mechanics.for_run() for contact in contacts]
    together = contacts[0].together.for_run(members)
    scale = abs(float(members[0].gaps.jacobian(np.zeros(1, dtype=np.int64))[0, 2]))  # coordinates have a unit of mass

    def at(way):
        q = np.zeros(members[0].gaps.n)
        q[2] = way
        forces = sum(together.forces([q, q]))[2]
        return forces, sum(member.evaluation.stored for member in members)

    way, step = 4e-6 / scale, 1e-9 / scale
    slope = (at(way + step)[1] - at(way - step)[1]) / (2 * step)
    assert at(way)[0] == pytest.approx(-slope, rel=taken)


def test_points_that_move_each_other_cost_little_more(bumps, monkeypatch):
    """What takes time are the springs of each point."""
    _, _, contacts = impact(bumps, friction=0.3)
    asked, held = [0], Springs.forces_up_to

    def counted(springs, *arguments):
        asked[0] += 1
        return held(springs, *arguments)

    monkeypatch.setattr(Springs, "forces_up_to", counted)

    def press(together):
        members, asked[0] = [contact.mechanics.for_run() for contact in contacts], 0
        coupled = contacts[0].together.for_run(members)
        scale = abs(float(members[0].gaps.jacobian(np.zeros(1, dtype=np.int64))[0, 2]))
        for k in range(6):
            q = np.zeros(members[0].gaps.n)
            q[0], q[2] = 0.1e-6 * k / scale, (1e-6 + 0.2e-6 * k) / scale
            if together:
                coupled.forces([q, q])
            for member in members:
                if not together:
                    member.at(q)
                member.accept(1e-7 * (k + 1))
        return asked[0]

    assert press(True) <= 1.5 * press(False)


def test_points_of_one_patch_go_on_from_their_states(bumps, tmp_path):
    """From a file, a new model goes on as one run does, with springs of friction at each point."""
    mbs, _, contacts = impact(bumps, friction=0.3, sliding=0.2)
    whole = ep.solve_dynamic(mbs, end_time=12e-6, step=0.4e-6)
    expected = [contact.force(whole)[-1] for contact in contacts]
    tangential = [contact.friction.tangential_force(whole)[-1] for contact in contacts]
    ep.solve_dynamic(impact(bumps, friction=0.3, sliding=0.2)[0], end_time=6e-6, step=0.4e-6).save(tmp_path / "cut.npz")
    again, _, fresh = impact(bumps, friction=0.3, sliding=0.2)
    result = ep.solve_dynamic(again, end_time=12e-6, step=0.4e-6, go_on=ep.Result.load(tmp_path / "cut.npz", again))
    assert min(expected) > 1.0
    assert [contact.force(result)[-1] for contact in fresh] == pytest.approx(expected, rel=1e-9)
    for contact, force in zip(fresh, tangential, strict=True):
        np.testing.assert_allclose(contact.friction.tangential_force(result)[-1], force, rtol=1e-6, atol=1e-9)


def test_a_patch_with_several_points_says_how_to_get_them(bumps):
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, bumps)
    plane = ep.RigidPlane((0, 0, TOP + CLEARANCE), (0, 0, -1))
    with pytest.raises(InputError, match=r"may touch at 2 points.*2 spheres.*in a list"):
        ep.CreatePartitionContact(mbs, item, plane, formulation="hertz")
    with pytest.warns(ContactPatchWarning, match=r"has 2 points.*plane on plane"):
        contacts = ep.CreatePartitionContact(mbs, [item, plane], formulation="hertz")
    assert [contact.name for contact in contacts] == ["body 0 on plane", "body 0 on plane (2)"]


def test_faces_that_do_not_touch_yet_need_no_room_for_their_kernel(bumps):
    """A ball between the bumps touches both of them, and hangs above the narrow plane between."""
    mbs, height = exu.SystemContainer().AddSystem(), np.sqrt(19e-3**2 - 3e-3**2)
    item, ball = ep.CreatePartitionBody(mbs, bumps), ep.RigidSphere((0, 0, 5e-3 + height + CLEARANCE), 15e-3)
    contacts = ep.CreatePartitionContact(mbs, [item, ball], formulation="hertz")
    gaps = sorted(contact.mechanics.gaps.placement.clearance for contact in contacts)
    assert gaps[:2] == pytest.approx([CLEARANCE * height / 19e-3] * 2, rel=1e-3)
    assert gaps[2] > 0.5e-3


# A point that passes from one face to another.


@pytest.fixture(scope="module")
def dome():
    """A steel body of revolution: a ball of 10 mm radius goes on as a torus with a tube of 3 mm, 30 degrees aside."""
    plane = occ.WorkPlane(occ.Axes((0, 0, 0), -occ.Y, occ.X)).MoveTo(0, -10e-3).Direction(1, 0)
    profile = plane.Arc(10e-3, 30).Arc(3e-3, 60).Line(4e-3).Rotate(90).Line(6.5e-3).Close().Face()
    fem = ep.fe_model(profile.Revolve(occ.Axis((0, 0, 0), occ.Z), 360), ep.STEEL, maxh=1.5e-3)
    return ep.reduce(fem, skin=True, f_cut=30e3)


@pytest.fixture(scope="module")
def rolled(dome):
    """Contacts, and their answers at angles around the seam, with a depth of the nearest surface.

    These are the forces and shares of both, the way since the angle before, their generalised forces, and the energy.
    """
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(mbs, dome, frame="floating")
    contacts = ep.CreatePartitionContact(mbs, [item, ep.RigidPlane((0, 0, -11e-3), (0, 0, 1))], formulation="hertz")
    members = [contact.mechanics.for_run() for contact in contacts]
    kinematics = members[0].gaps.sides[0].kinematics

    def at(angle, height, depth=3e-6):
        way = np.zeros(members[0].gaps.n)
        way[4] = angle
        q = kinematics.moved(np.zeros(len(way)), way)
        q[2] += height
        for _ in range(3):
            q = q.copy()
            q[2] -= min(float(member.gaps.at(q)[0]) for member in members) + depth
        answers = [member.at(q) for member in members]
        forces = [float(answer.on_rows.sum()) for answer in answers]
        generalised, stored = sum(answer.generalised for answer in answers), sum(answer.stored for answer in answers)
        return forces, [member.gaps.spot_stage.share for member in members], q, generalised, stored

    found, height = [], 0.0
    for angle in np.radians(30) + np.linspace(-0.03, 0.09, 49) + 0.00125:  # the seam is between two of them
        found.append(at(angle, height))
        height = found[-1][2][2]
    forces, shares, q, generalised, stored = zip(*found, strict=True)
    ways = [kinematics.way(*two) for two in itertools.pairwise(q)]
    return contacts, np.array(forces), np.array(shares), np.array(ways), np.array(generalised), np.array(stored)


def test_faces_of_a_dome_go_on_as_each_other(rolled):
    contacts = rolled[0]
    faces = {type(contact.mechanics.gaps.faces[0].surface.shape).__name__: contact for contact in contacts}
    assert set(faces) == {"RigidSphere", "Torus"}
    of_ball, of_torus = (faces[kind].mechanics.gaps.faces[0] for kind in ("RigidSphere", "Torus"))
    assert [face is of_torus for face in of_ball.neighbours] == [True]
    radii = np.linalg.norm(of_ball.seam.mean(axis=1)[:, :2], axis=1)  # middles of edges are 1 % nearer to the axis
    np.testing.assert_allclose(radii, 10e-3 * np.sin(np.radians(30)), rtol=3e-4)


def test_a_point_passes_from_face_to_face_without_a_jump(rolled):
    """The torus is softer by 27 %, at the same depth. It takes over step by step."""
    _, forces, shares, *_ = rolled
    np.testing.assert_allclose(shares.sum(axis=1), 1.0, rtol=1e-9)
    total = forces.sum(axis=1)
    assert forces[0].min() == 0.0
    assert forces[-1].min() == 0.0
    assert total[-1] < 0.8 * total[0]
    assert abs(np.diff(total)).max() < 0.06 * total.max()
    assert abs(np.diff(forces, axis=0)).max() < 0.2 * total.max()


def test_forces_work_as_much_as_the_energy_changes_over_a_seam(rolled):
    """Without the derivatives by the place, 70 % of the energy were missing."""
    *_, ways, generalised, stored = rolled
    work = np.cumsum(np.einsum("sn,sn->s", ways, (generalised[1:] + generalised[:-1]) / 2))
    assert np.ptp(stored) > 0.2 * stored.max()
    np.testing.assert_allclose(work + stored[1:], stored[0], atol=8e-3 * stored.max())


def tumbling(dome, friction, angle=0.5, clearance=CLEARANCE):
    """Model, body, and contacts of the dome on a plane, with 2000 rad/s: the point of contact goes on by 20 m/s."""
    c, s = np.cos(angle), np.sin(angle)
    ring = np.array([7e-3 * np.sin(np.radians(30)), 7e-3 * np.cos(np.radians(30))])
    height = 10e-3 if angle <= np.radians(30) else ring @ [s, c] + 3e-3
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(
        mbs, dome, frame="floating", referencePosition=[0, 0, height + clearance],
        referenceRotationMatrix=[[c, 0, -s], [0, 1, 0], [s, 0, c]], initialVelocity=[0, 0, -SPEED],
        initialAngularVelocity=[0, -2000, 0],
    )  # fmt: skip
    contacts = ep.CreatePartitionContact(mbs, [item, ep.RigidPlane()], formulation="hertz", friction=friction)
    mbs.Assemble()
    return mbs, item, contacts


@pytest.mark.parametrize("friction", [None, 0.3])
def test_a_dome_that_rolls_over_its_seam_keeps_its_energy(dome, friction):
    mbs, item, contacts = tumbling(dome, friction)
    result = ep.solve_dynamic(mbs, end_time=22e-6, step=0.2e-6)
    forces = [contact.force(result) for contact in contacts]
    assert min(force.max() for force in forces) > 500.0
    energy = item.energy(result) + sum(
        contact.energy(result) + contact.dissipated_energy(result) for contact in contacts
    )
    assert np.ptp(energy) < 1e-3 * energy[0]


@pytest.mark.parametrize("friction", [None, 0.3])
@pytest.mark.parametrize(("method", "angle", "steps"), [("explicit", 0.51, 16), ("implicit", 0.518, 6)])
def test_points_that_pass_over_a_seam_go_on_from_their_states(dome, method, angle, steps, friction, tmp_path):
    """In the same session, and from a file: with friction, round-off turned the axes of a circle of contact."""
    make, options = lambda: tumbling(dome, friction, angle, 1e-9), {"step": 0.2e-6, "method": method}
    cut, end = steps * 0.2e-6, (steps + 8) * 0.2e-6
    mbs, _, contacts = make()
    whole = ep.solve_dynamic(mbs, end_time=end, **options)
    mbs, _, same = make()
    ep.solve_dynamic(mbs, end_time=cut, **options).save(tmp_path / "cut.npz")
    session = ep.solve_dynamic(mbs, end_time=end, go_on=True, **options)
    again, _, fresh = make()
    result = ep.solve_dynamic(again, end_time=end, go_on=ep.Result.load(tmp_path / "cut.npz", again), **options)
    expected = np.array([contact.force(whole)[-9:] for contact in contacts])
    assert expected.min() > 50.0
    within = {"explicit": 1e-11, "implicit": 1e-9}[method] * expected.max()  # what Newton's method leaves
    for run, members in ((session, same), (result, fresh)):
        np.testing.assert_allclose([contact.force(run) for contact in members], expected, rtol=0, atol=within)


def test_springs_do_not_feel_from_which_axis_tangents_are_made(dome):
    """A ball that rolls by so little has the same force, to and fro. Another axis of its body gives tangents fro.

    Normal forces slide springs of unlike bodies. The force fell by 2 % as these turned, and what slides them did not.
    """
    normal, up = np.array([0.9, np.sqrt(0.19), 0.0]), np.array([0.0, 0.0, 1.0])
    about, start = np.cross(normal, up), np.arccos(0.9) + 2e-4
    axis = np.cos(start) * normal + np.sin(start) * up  # of revolution
    mbs = exu.SystemContainer().AddSystem()
    item = ep.CreatePartitionBody(
        mbs, dome, frame="floating", referencePosition=list((10e-3 + CLEARANCE) * normal),
        referenceRotationMatrix=np.column_stack([about, np.cross(axis, about), axis]).tolist(),
    )  # fmt: skip
    contacts = ep.CreatePartitionContact(
        mbs, [item, ep.RigidPlane((0, 0, 0), normal)], formulation="hertz", friction=0.3
    )
    (ball,) = (contact for contact in contacts if contact.mechanics.gaps.faces[0].surface.ball)

    def rolled(way):
        member = ball.mechanics.for_run()
        kinematics, still = member.gaps.sides[0].kinematics, np.zeros(member.gaps.n)
        axes = []
        for step, angle in enumerate([0, 0, 0, *np.linspace(0, way, 7)[1:]]):
            turn = np.zeros(member.gaps.n)
            turn[3:6] = angle * about
            q = kinematics.moved(still, turn)
            middle = (kinematics.frame(q)[1] - kinematics.frame(still)[1]) @ dome.centre_of_mass
            q[:3] += middle + angle * np.cross(about, 10e-3 * normal) - min(step + 1, 3) * 1e-6 * normal
            force = float(member.at(q).on_rows[0, 0])
            member.accept(1e-7 * (step + 1))
            axes.append(member.rows.axis)
        return force, len(set(axes))

    (to, same), (fro, changed) = rolled(4e-4), rolled(-4e-4)
    assert (same, changed) == (1, 2)
    assert fro == pytest.approx(to, rel=1e-4)


def test_a_face_beside_has_no_contact_beyond_its_other_end(dome):
    """The torus goes on as a cylinder. Below its end, far off the body, that is nearer to a ball than the torus is.

    The force was spread there, so that an impact gained two thirds of its energy.
    """
    c, ring = np.sqrt(0.5), 7e-3 * np.sin(np.radians(30))
    low = np.array([-ring, 0, -7e-3 * np.cos(np.radians(30))])  # middle of the tube
    turn = np.array([[c, 0, -c], [0, 1, 0], [c, 0, c]])
    mbs, (x, _, z), ball = exu.SystemContainer().AddSystem(), turn @ low, 15e-3
    item = ep.CreatePartitionBody(mbs, dome, frame="floating", referenceRotationMatrix=turn)
    sphere = ep.RigidSphere((x + 1e-3, 1e-3, z - 3e-3 - ball), ball)
    contacts = ep.CreatePartitionContact(mbs, [item, sphere], formulation="hertz")
    members = [contact.mechanics.for_run() for contact in contacts]
    start = np.zeros(members[0].gaps.n)
    start[2] = -min(float(member.gaps.at(start)[0]) for member in members) - 3e-6
    kinematics = members[0].gaps.sides[0].kinematics

    def moved(i, way):
        return [member.at(kinematics.moved(start, way * np.eye(len(start))[i])) for member in members]

    forces = sum(answer.generalised for answer in moved(0, 0.0))
    assert forces[2] > 50.0
    for i, step in enumerate([1e-7] * 3 + [1e-5] * 3):
        more, less = (sum(answer.stored for answer in moved(i, sign * step)) for sign in (1, -1))
        size = 1.0 if i < 3 else 5e-3
        assert forces[i] == pytest.approx((less - more) / (2 * step), abs=5e-4 * size * forces[2])
