"""Scenes set up wrongly, and wrong command lines, for `misuse.py`: each must end in a named error or a warning."""

import contextlib
import io
from dataclasses import dataclass
from typing import Any

import exudyn as exu
import netgen.occ as occ
import ngsolve
import numpy as np
import scipy.sparse as sp

import exudyn_partition as ep
from exudyn_partition import cli
from exudyn_partition.errors import CallError
from validation.stability.misuse_values import STEP, Made


@dataclass(frozen=True)
class Wrong:
    """A scene that is wrong, by its name."""

    name: str
    make: Any

    def __call__(self, scene):
        """Set it up and run it."""
        return self.make(scene)


SCENES: list[Wrong] = []


def scene(function):
    """Add a scene, named by its function."""
    SCENES.append(Wrong(f"scene({function.__name__.replace('_', ' ')})", function))
    return function


def run(mbs, **options):
    mbs.Assemble()
    return ep.solve_dynamic(mbs, **{"end_time": 4 * STEP, **options})


def two(s, mbs, **options):
    """Both bodies in a model."""
    item = ep.CreatePartitionBody(mbs, s.body, name="upper", **options)
    return item, ep.CreatePartitionBody(mbs, s.other_body, name="lower")


def steel_box(size=1.0, **options):
    """A bar of 40 mm, times a factor."""
    return ep.fe_model(occ.Box((0, 0, 0), (0.01 * size, 0.01 * size, 0.04 * size)), ep.STEEL, **options)


_CUBE = "".join(f"{i + 1}, {i % 2}e-2, {i // 2 % 2}e-2, {i // 4}e-2\n" for i in range(8))
_ABAQUS = f"*NODE\n{_CUBE}*ELEMENT, TYPE=C3D8, ELSET=ALL\n1, 1, 2, 4, 3, 5, 6, 8, 7\n"
_NASTRAN = "BEGIN BULK\n" + "".join(f"GRID,{line.replace(',', ',,', 1)}\n" for line in _CUBE.splitlines())
_NASTRAN += "CHEXA,1,1,1,2,4,3,5,6\n,8,7\n"


def deck(said, ending, text):
    """Add a scene in which a deck is read that is damaged, or has what an FE model of solids leaves out."""

    def read(s):
        path = s.folder / f"deck.{ending}"
        path.write_text(text)
        ep.fe_model(path, ep.STEEL)

    SCENES.append(Wrong(f"deck({said})", read))


for said, more in {
    "a spring": "*ELEMENT, TYPE=SPRINGA, ELSET=S\n9, 1, 2\n",
    "a mass": "*MASS, ELSET=ALL\n1.\n",
    "a shell": "*SHELL SECTION, ELSET=ALL\n1e-3\n",
    "nodes that are generated": "*NGEN\n1, 8, 1\n",
    "a node in two places": "*NODE\n1, 1., 0., 0.\n",
    "an element that is there twice": "*ELEMENT, TYPE=C3D8\n1, 1, 2, 4, 3, 5, 6, 8, 7\n",
    "a node that is not there": "*ELEMENT, TYPE=C3D4\n2, 1, 2, 3, 99\n",
    "too few nodes": "*ELEMENT, TYPE=C3D8\n2, 1, 2, 3\n",
    "a misspelt keyword": "*ELEMNT, TYPE=C3D8\n2, 1, 2, 4, 3, 5, 6, 8, 7\n",
    "a set of no set": "*NSET, NSET=A\nB\n",
    "a set of itself": "*NSET, NSET=A\nA\n",
    "a face that is not there": "*SURFACE, NAME=A\nALL, S7\n",
    "a range that ends early": "*NSET, NSET=A, GENERATE\n8, 1\n",
    "a file that is not there": "*INCLUDE, INPUT=none.inp\n",
    "a file that includes itself": "*INCLUDE, INPUT=deck.inp\n",
    "an instance of no part": "*INSTANCE, NAME=I, PART=P\n*END INSTANCE\n",
    "text for a number": "*NODE\n9, 1., x, 0.\n",
}.items():
    deck(f"Abaqus, {said}", "inp", _ABAQUS + more)
for said, more in {
    "a mass": "CONM2,9,1,,0.5\n",
    "a shell": "CQUAD4,9,2,1,2,4,3\nPSHELL,2,1,.1\n",
    "an unknown solid": "CIHEX1,9,1,1,2,4,3,5,6\n,8,7\n",
    "too few nodes": "CHEXA,9,1,1,2,4,3\n",
    "a system that is not there": "GRID,9,5,1.,1.,1.\n",
    "a system in itself": "CORD2R,5,5,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\nGRID,9,5,1.,1.,1.\n",
    "a node in two places": "GRID,1,,1.,1.,1.\n",
    "repeated cards": "=,*1,==\n",
    "a continuation of no card": f"{'CHEXA   9':72}+A\n+B      8\n",
    "text for a number": "GRID,9,,x,1.,1.\n",
}.items():
    deck(f"Nastran, {said}", "bdf", _NASTRAN + more + "ENDDATA\n")


@scene
def solids_that_share_no_face(s):
    boxes = [occ.Box((0.02 * i, 0, 0), (0.02 * i + 0.01, 0.01, 0.01)) for i in range(2)]
    ep.fe_model(occ.Compound(boxes), ep.STEEL, maxh=5e-3)


@scene
def mesh_of_a_free_edge(s):
    shape = occ.Compound([occ.Box((0, 0, 0), (0.01, 0.01, 0.01)), occ.Segment((0, 0, 0.02), (0.01, 0, 0.02))])
    ep.fe_model(ngsolve.Mesh(occ.OCCGeometry(shape).GenerateMesh(maxh=5e-3)), ep.STEEL)


@scene
def lengths_in_millimetres(s):
    steel_box(1e3, maxh=8)


@scene
def elements_in_millimetres(s):
    steel_box(maxh=8)


@scene
def shape_in_millimetres_and_elements_in_metres(s):
    steel_box(1e3, maxh=1e-3)


@scene
def elements_of_a_micrometre(s):
    steel_box(maxh=1e-6)


@scene
def modulus_in_megapascal(s):
    ep.fe_model(s.shape, ep.Material(E=210e3, nu=0.3, rho=7800.0), maxh=8e-3)


@scene
def density_in_grams(s):
    ep.fe_model(s.shape, ep.Material(E=210e9, nu=0.3, rho=7.8), maxh=8e-3)


@scene
def material_in_millimetres_and_geometry_in_metres(s):
    ep.fe_model(s.shape, ep.Material(E=210e3, nu=0.3, rho=7.8e-9), maxh=8e-3)


@scene
def material_in_millimetres_and_milliseconds_and_geometry_in_metres(s):
    ep.fe_model(s.shape, ep.Material(E=210.0, nu=0.3, rho=7.8e-6), maxh=8e-3)


@scene
def gravity_in_millimetres(s):
    ep.CreatePartitionBody(s.empty(), s.body, gravity=[0, 0, -9810])


def far(s, surface):
    mbs = s.empty()
    ep.CreatePartitionContact(mbs, ep.CreatePartitionBody(mbs, s.body, initialVelocity=[0, 0, -1]), surface)
    run(mbs)


@scene
def a_plane_metres_away(s):
    far(s, ep.RigidPlane((0, 0, -2.0)))


@scene
def a_sphere_in_millimetres(s):
    far(s, ep.RigidSphere((0, 0, -40.0), 10.0))


@scene
def a_ball_larger_than_the_body(s):
    ep.Partition.ball(s.fem, (0, 0, 0), 4.0)


def changed(name):
    """A scene in which a matrix of a body's object is changed after it was made."""

    def change(s):
        mbs = s.apart()
        number = s.striker["oGenericODE2"]
        twice = exu.MatrixContainer(sp.csr_matrix(2 * sp.identity(s.body.n_dofs)))
        mbs.SetObjectParameter(number, name, twice)
        run(mbs)

    SCENES.append(Wrong(f"scene(changed {name})", change))


for matrix in ("massMatrix", "stiffnessMatrix", "dampingMatrix"):
    changed(matrix)


def moved(s):
    """A model with a body whose node was moved after it was made."""
    mbs = s.apart()
    node = s.striker["nModal"]
    place = mbs.GetNodeParameter(node, "referenceCoordinates")
    mbs.SetNodeParameter(node, "referenceCoordinates", [place[0] + 1e-3, *place[1:]])
    mbs.Assemble()
    return mbs


@scene
def changed_reference_coordinates(s):
    ep.solve_dynamic(moved(s), end_time=4 * STEP)


@scene
def changed_reference_coordinates_and_statics(s):
    ep.solve_static(moved(s))


@scene
def a_run_within_a_run(s):
    mbs = s.apart()
    mbs.SetPreStepUserFunction(lambda mbs, t: bool(ep.solve_dynamic(mbs, end_time=4 * STEP)) or True)
    run(mbs)


@scene
def bodies_that_overlap_by_initial_coordinates(s):
    mbs = s.empty()
    ep.CreatePartitionContact(mbs, *two(s, mbs))
    mbs.Assemble()
    q = np.array(mbs.systemData.GetODE2Coordinates(exu.ConfigurationType.Initial))
    q[: s.body.n_dofs] = s.body.rigid[:, 2] * -1e-5
    mbs.systemData.SetODE2Coordinates(q, exu.ConfigurationType.Initial)
    ep.solve_dynamic(mbs, end_time=4 * STEP)


@scene
def penalty_that_lets_bodies_through(s):
    mbs = s.empty()
    ep.CreatePartitionContact(mbs, *two(s, mbs, initialVelocity=[0, 0, -1]), formulation="penalty", stiffness=1e3)
    run(mbs, end_time=1e-3, step=1e-6)


@scene
def incompressible_in_linear_elements(s):
    ep.fe_model(s.shape, ep.Material(E=1e6, nu=0.4999, rho=1000.0), maxh=8e-3, order=1)


@scene
def refinement_beside_the_body(s):
    ep.fe_model(s.shape, ep.STEEL, maxh=8e-3, refine=ep.Refine((1, 1, 1), 1e-3, 1e-4))


@scene
def region_in_millimetres(s):
    ep.Partition.ball(s.fem, (0, 0, 40), 4)


@scene
def region_within_the_body(s):
    ep.Partition.ball(s.fem, (0, 0, 0.02), 1e-4)


@scene
def partitions_of_two_meshes(s):
    ep.reduce(s.fem, ep.Partition.ball(steel_box(maxh=6e-3), (0, 0, 0), 4e-3), f_cut=60e3)


@scene
def patches_that_overlap(s):
    ep.Partition.ball(s.fem, (0, 0, 0), 4e-3) | ep.Partition.ball(s.fem, (0, 0, 0), 4e-3)


@scene
def two_patches_of_one_name(s):
    ends = [ep.Partition.ball(s.fem, (0, 0, z), 4e-3, name="end") for z in (0, 0.04)]
    ends[0] | ends[1]


@scene
def frequency_and_tolerance(s):
    ep.reduce(s.fem, s.part, f_cut=60e3, tolerance=0.1)


@scene
def neither_frequency_nor_tolerance(s):
    ep.reduce(s.fem, s.part)


@scene
def bodies_that_overlap(s):
    mbs = s.empty()
    ep.CreatePartitionContact(mbs, *two(s, mbs, referencePosition=(0, 0, -5e-3)))


@scene
def bodies_placed_in_millimetres(s):
    mbs = s.empty()
    ep.CreatePartitionContact(mbs, *two(s, mbs, referencePosition=(30, 0, 0)))
    run(mbs)


@scene
def bodies_that_turn_their_backs(s):
    mbs = s.empty()
    item, other = two(s, mbs, referencePosition=(0, 0, -0.1))
    ep.CreatePartitionContact(mbs, item, other)
    run(mbs)


@scene
def body_on_itself(s):
    mbs = s.empty()
    item, _ = two(s, mbs)
    ep.CreatePartitionContact(mbs, item, item)


@scene
def plane_as_slave(s):
    mbs = s.empty()
    item, _ = two(s, mbs)
    ep.CreatePartitionContact(mbs, ep.RigidPlane(), item)


@scene
def bodies_instead_of_items(s):
    ep.CreatePartitionContact(s.empty(), s.body, s.other_body)


@scene
def items_of_another_model(s):
    ep.CreatePartitionContact(s.empty(), s.item, s.target)


@scene
def one_item_of_another_model(s):
    mbs = s.empty()
    ep.CreatePartitionContact(mbs, two(s, mbs)[0], s.target)


@scene
def item_from_before_a_reset(s):
    mbs = s.empty()
    item, other = two(s, mbs)
    mbs.Reset()
    ep.CreatePartitionContact(mbs, item, other)


@scene
def marker_in_another_model(s):
    s.item.CreateInterfaceMarker(s.empty(), "pin")


@scene
def two_bodies_of_one_name(s):
    mbs = s.empty()
    for _ in range(2):
        ep.CreatePartitionBody(mbs, s.body, name="rod")


@scene
def two_contacts_of_one_name(s):
    mbs = s.empty()
    pair = two(s, mbs)
    for _ in range(2):
        ep.CreatePartitionContact(mbs, *pair, name="tip")


@scene
def stiffness_without_a_penalty(s):
    mbs = s.empty()
    ep.CreatePartitionContact(mbs, *two(s, mbs), stiffness=1e9)


@scene
def master_patch_of_a_plane(s):
    mbs = s.empty()
    ep.CreatePartitionContact(mbs, two(s, mbs)[0], ep.RigidPlane(), masterPatch=0)


@scene
def multipliers_without_mass(s):
    mbs = s.empty()
    ep.CreatePartitionContact(mbs, *two(s, mbs), formulation="lagrange")


@scene
def rotation_of_an_inertial_frame(s):
    two(s, s.empty(), referenceRotation=np.eye(3))


@scene
def inertial_frame_that_turns_far(s):
    mbs = s.empty()
    ep.CreatePartitionBody(mbs, s.body, initialAngularVelocity=(0, 0, 1e5))
    run(mbs)


@scene
def impact_at_ten_kilometres_a_second(s):
    mbs = s.empty()
    ep.CreatePartitionContact(mbs, *two(s, mbs, initialVelocity=(0, 0, -1e4)))
    run(mbs, end_time=40 * STEP)


@scene
def run_that_was_not_assembled(s):
    ep.solve_dynamic(s.model()[0], end_time=1e-6)


@scene
def run_of_nothing(s):
    run(s.empty())


def with_a_load(s, answer):
    """A run of the upper block, with a traction that a function returns."""
    mbs = s.empty()
    item = ep.CreatePartitionBody(mbs, s.body)
    item.CreateSurfaceLoad(mbs, "pin", (0, 0, -1.0), loadVectorUserFunction=lambda mbs, t, load: answer())
    run(mbs)


@scene
def load_of_another_length(s):
    with_a_load(s, lambda: [0, 0])


@scene
def load_of_nothing(s):
    with_a_load(s, lambda: None)


@scene
def load_that_is_not_finite(s):
    with_a_load(s, lambda: [0, 0, np.nan])


@scene
def sensor_that_was_deleted(s):
    mbs = s.empty()
    item, _ = two(s, mbs)
    mbs.DeleteSensor(item["sCoordinates"][0])
    run(mbs)


@scene
def sensor_of_a_contact_that_was_deleted(s):
    mbs = s.empty()
    contact = ep.CreatePartitionContact(mbs, *two(s, mbs))
    mbs.DeleteSensor(contact["sForce"])
    run(mbs)


@scene
def container_for_a_model(s):
    ep.solve_dynamic(exu.SystemContainer(), end_time=1e-6)


@scene
def unstable_step(s):
    ep.solve_dynamic(s.assembled(), end_time=1e-3, step=1e-4)


@scene
def implicit_step_over_the_whole_impact(s):
    ep.solve_dynamic(s.assembled(), end_time=2e-3, step=5e-5, method="implicit")


@scene
def free_step_of_equal_steps(s):
    ep.solve_dynamic(s.assembled(), end_time=1e-5, free_step=1e-6)


@scene
def results_before_a_run(s):
    ep.collect(s.assembled())


@scene
def nodal_forces_of_a_run_without_its_model(s):
    result = ep.Result.load(s.folder / "run.npz")
    result.contacts[0].nodal_forces(result)


@scene
def velocity_of_a_run_without_its_model(s):
    result = ep.Result.load(s.folder / "run.npz")
    result.bodies[0].velocity(result, (0, 0, 0))


@scene
def force_in_another_result(s):
    s.foreign[1].force(s.result)


@scene
def velocity_of_a_point_in_space(s):
    s.item.velocity(s.result, (10, 0, 0))


@scene
def moment_without_its_sensor(s):
    s.foreign[1].moment_on_slave(s.result)


@scene
def comparison_over_no_common_time(s):
    t = np.linspace(1, 2, 11)
    ep.compare(s.history, ep.History(t, t, {}))


@scene
def comparison_with_nothing(s):
    ep.compare(s.history, ep.History(s.history.t, 0 * s.history.t, {}))


@scene
def comparison_without_the_point(s):
    ep.compare(ep.History(s.history.t, s.history.force, {}), s.history)


@scene
def reference_with_a_step_beyond_the_end(s):
    ep.reference.simulate([s.full, s.other_full], end_time=1e-6, step=1e-3)


@scene
def reference_of_bodies_that_overlap(s):
    low = ep.reference.FullBody(s.fem, s.part, position=(0, 0, -5e-3))
    ep.reference.simulate([low, s.other_full], end_time=1e-6)


@scene
def gauge_beyond_the_surface(s):
    ep.recovery.gauge_rows(s.fem, [ep.StrainGauge((0, 0, 0), (0, 0, 1), 1e-2)])


@scene
def stress_without_the_mesh(s):
    ep.output.write_paraview(s.folder / "stress", s.result, fields="stress")


@scene
def impact_of_planes(s):
    ep.hertz.impact(1.0, 1.0, np.inf, np.inf, ep.STEEL)


@scene
def impact_that_nothing_limits(s):
    ep.hertz.impact(np.inf, 1.0, 0.01, np.inf, ep.STEEL)


def command(said, *words):
    """Add a command line; one that returns 0 without a word was taken silently."""

    def call(s):
        said, wrong = io.StringIO(), io.StringIO()
        made = [str(word.make(s)) if isinstance(word, Made) else str(word) for word in words]
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(wrong):
            try:
                code = cli.main(made)
            except SystemExit as end:  # argparse, with the usage
                code = end.code
        message = wrong.getvalue()
        if code in (1, 2) and "error: " in message and "Traceback" not in message:
            raise CallError(f"expected: {message}")
        if code:
            raise RuntimeError(f"exit code {code}: {message}")

    SCENES.append(Wrong(f"command({said})", call))


_step = Made(lambda s: s.folder / "block.step")
_out = Made(lambda s: s.folder / "out.npz")
_SOUND = {
    "--material": ("steel",),
    "--at": (0, 0, 0),
    "--radius": (4,),
    "--scale": ("1e-3",),
    "--maxh": ("8e-3",),
    "--f-cut": ("60e3",),
    "-o": (_out,),
}


def reduce_command(said, source=_step, more=(), **changed):
    """Add a call of `reduce` with options that are changed, or left out for None."""
    options = {**_SOUND, **{f"--{k.replace('_', '-')}" if k != "o" else "-o": v for k, v in changed.items()}}
    words = [word for key, value in options.items() if value is not None for word in (key, *value)]
    command(f"reduce, {said}", "reduce", source, *words, *more)


for option in _SOUND:
    if option not in ("--scale", "--maxh"):
        reduce_command(f"no {option}", **{option.strip("-").replace("-", "_"): None})
for wrong in ("x", "nan", "inf", "-1", "0", ""):
    for option in ("--radius", "--scale", "--maxh", "--f-cut"):
        reduce_command(f"{option} {wrong!r}", **{option.strip("-").replace("-", "_"): (wrong,)})
    reduce_command(f"tolerance {wrong!r}", f_cut=None, tolerance=(wrong,))
    command(f"estimate, speed {wrong!r}", "estimate", "--first", 1, 0.01, "steel", "--speed", wrong)
    command(
        f"estimate, impedance {wrong!r}",
        "estimate",
        "--first",
        1,
        0.01,
        "steel",
        "--speed",
        1,
        "--impedance",
        wrong if wrong != "inf" else "-inf",
    )
    if wrong != "inf":
        command(f"estimate, mass {wrong!r}", "estimate", "--first", wrong, 0.01, "steel", "--speed", 1)
        command(f"estimate, radius {wrong!r}", "estimate", "--first", 1, wrong, "steel", "--speed", 1)
for wrong in ("gold", "1,2", "1,2,3", "nan,0.3,7800", "210e9,0.3,0", "210e9;0.3;7800", ""):
    reduce_command(f"material {wrong!r}", material=(wrong,))
    command(f"estimate, material {wrong!r}", "estimate", "--first", 1, 0.01, wrong, "--speed", 1)
for wrong in (("nan", 0, 0), (0, 0), (0, 0, 0, 0), ("x", 0, 0), (0, 0, "inf"), (1, 1, 1)):
    reduce_command(f"at {wrong}", at=wrong)
reduce_command("two points and three radii", more=("--at", 0, 0, 1, "--radius", 1, "--radius", 1))
reduce_command("two names of a point", more=("--name", "a", "--name", "b"))
reduce_command("tolerance beside f-cut", more=("--tolerance", "0.1"))
reduce_command("order 3", more=("--order", 3))
reduce_command("unknown basis", more=("--basis", "best"))
reduce_command("unknown option", more=("--size", 1))
reduce_command("over the source", o=(_step,))
reduce_command("into no folder", o=("/nowhere/at/all.npz",))
reduce_command("into a folder", o=(Made(lambda s: s.folder),))
reduce_command("into a device", o=("/dev/full",))
reduce_command("into /proc", o=("/proc/body.npz",))
reduce_command("millimetres as metres", scale=None, radius=(4,), maxh=(8,), f_cut=(60,))
for said, source in (
    ("missing", "/nowhere/block.step"),
    ("a folder", Made(lambda s: s.folder)),
    ("empty", Made(lambda s: s.folder / "empty.npz")),
    ("text", Made(lambda s: s.folder / "text.npz")),
    ("a body", Made(lambda s: s.folder / "body.npz")),
    ("a device", "/dev/null"),
):
    reduce_command(f"source {said}", source=source)
    command(f"info of what is {said}", "info", source if said != "a body" else Made(lambda s: s.folder / "other.npz"))
    command(
        f"estimate of what is {said}",
        "estimate",
        "--first",
        Made(lambda s: s.folder / "none.npz"),
        1,
        "steel",
        "--speed",
        1,
    )
command("info of half a file", "info", Made(lambda s: s.folder / "half.npz"))
command("nothing")
command("unknown", "reduse")
command("estimate of a rigid body", "estimate", "--first", 1, 0.01, "rigid", "--speed", 1)
command("estimate of two planes", "estimate", "--first", 1, "inf", "steel", "--speed", 1)
command("estimate without limits", "estimate", "--first", "inf", 0.01, "steel", "--speed", 1)
command("estimate of two values", "estimate", "--first", 1, 0.01, "--speed", 1)
