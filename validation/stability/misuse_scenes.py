"""Scenes set up wrongly, damaged files and wrong command lines, for `misuse.py`: tables of names and what is done.

Each must end in a named error or a warning. A new one takes one entry of `SET_UPS`, `ABAQUS`, `NASTRAN` or `COMMANDS`.
"""

import contextlib
import io
from dataclasses import replace
from functools import partial

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import ngsolve
import numpy as np
import scipy.sparse as sp

import exudyn_partition as ep
from exudyn_partition import cli
from exudyn_partition.errors import CallError
from validation.stability.misuse_objects import STEP, Made, file, the


def solve(mbs, **options):
    """A run of four steps."""
    return ep.solve_dynamic(mbs, **{"end_time": 4 * STEP, **options})


def run(mbs, **options):
    """A run of four steps of a model that is not assembled."""
    mbs.Assemble()
    return solve(mbs, **options)


def steel_box(size=1.0, **options):
    """FE model of a bar of 40 mm, times a factor."""
    return ep.fe_model(occ.Box((0, 0, 0), (0.01 * size, 0.01 * size, 0.04 * size)), ep.STEEL, **options)


def of_material(s, **changes):
    """FE model of the upper bar, of steel that does not yield, with changes."""
    return ep.fe_model(s.shape, replace(ep.STEEL, yield_stress=None, **changes), maxh=8e-3)


def solids_that_share_no_face():
    return occ.Compound([occ.Box((x, 0, 0), (x + 0.01, 0.01, 0.01)) for x in (0.0, 0.02)])


def mesh_of_a_free_edge():
    shape = occ.Compound([occ.Box((0, 0, 0), (0.01, 0.01, 0.01)), occ.Segment((0, 0, 0.02), (0.01, 0, 0.02))])
    return ngsolve.Mesh(occ.OCCGeometry(shape).GenerateMesh(maxh=5e-3))


def above(s, surface):
    """A run of the upper bar over a rigid surface."""
    mbs = s.empty()
    ep.CreatePartitionContact(mbs, ep.CreatePartitionBody(mbs, s.body, initialVelocity=[0, 0, -1]), surface)
    run(mbs)


def changed_matrix(s, name):
    """A run of a body whose matrix was changed after it was made."""
    mbs = s.apart()
    twice = exu.MatrixContainer(sp.csr_matrix(2 * sp.identity(s.body.n_dofs)))
    mbs.SetObjectParameter(s.striker["oGenericODE2"], name, twice)
    run(mbs)


def moved_node(s):
    """A model with a body whose node was moved after it was made."""
    mbs = s.apart()
    node = s.striker["nModal"]
    place = mbs.GetNodeParameter(node, "referenceCoordinates")
    mbs.SetNodeParameter(node, "referenceCoordinates", [place[0] + 1e-3, *place[1:]])
    mbs.Assemble()
    return mbs


def run_within_a_run(s):
    mbs = s.apart()
    mbs.SetPreStepUserFunction(lambda mbs, t: bool(solve(mbs)) or True)
    run(mbs)


def overlap_by_initial_coordinates(s):
    mbs = s.assembled()
    q = np.array(mbs.systemData.GetODE2Coordinates(exu.ConfigurationType.Initial))
    q[: s.body.n_dofs] = s.body.rigid[:, 2] * -1e-5
    mbs.systemData.SetODE2Coordinates(q, exu.ConfigurationType.Initial)
    solve(mbs)


def item_from_before_a_reset(s):
    mbs = s.apart()
    mbs.Reset()
    ep.CreatePartitionContact(mbs, s.striker, s.struck)


def two_bodies_of_one_name(s):
    mbs = s.empty()
    for _ in range(2):
        ep.CreatePartitionBody(mbs, s.body, name="rod")


def two_contacts_of_one_name(s):
    mbs = s.apart()
    for _ in range(2):
        ep.CreatePartitionContact(mbs, s.striker, s.struck, name="tip")


def one_patch(s, *options):
    """A model in which two contacts of the upper bar's patch have these options."""
    mbs = s.apart()
    for master, more in zip((s.struck, ep.RigidPlane((0, 0, -1e-3))), options, strict=True):
        ep.CreatePartitionContact(mbs, s.striker, master, **more)


def loaded(s, answer):
    """A run of the upper bar with a traction that a function returns."""
    mbs = s.apart()
    s.striker.CreateSurfaceLoad(mbs, "pin", (0, 0, -1.0), loadVectorUserFunction=lambda mbs, t, load: answer)
    run(mbs)


def driven(s, level=False, speed=0.0, **functions):
    """A run of the upper bar, and a mass at a speed that a constraint drives by functions of time."""
    mbs = s.apart()
    nodes = mbs.AddNode(items.NodePoint(initialVelocities=[speed, 0, 0])), mbs.AddNode(items.NodePointGround())
    mbs.AddObject(items.MassPoint(mass=1.0, nodeNumber=nodes[0]))
    markers = [mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=0)) for node in nodes[::-1]]
    along = {name: lambda mbs, t, i, offset, of=of: of(t) for name, of in functions.items()}
    mbs.AddObject(items.ObjectConnectorCoordinate(markerNumbers=markers, velocityLevel=level, **along))
    run(mbs, method="implicit")


def without_a_sensor(s, sensor):
    """A run of a model after a sensor of its items was deleted."""
    mbs, item, _, contact = s.model()
    mbs.DeleteSensor({"coordinates": item["sCoordinates"][0], "force": contact["sForce"]}[sensor])
    run(mbs)


def history(s, force):
    """The history of the scene's run with another force, and without points."""
    return ep.History(s.history.t, force, {})


def ask_a_file(s, ask):
    """Ask for what a result does not have that was read without its model."""
    return ask(ep.Result.load(s.folder / "run.npz"))


SET_UPS = {
    # Meshes and materials
    "solids that share no face": lambda s: ep.fe_model(solids_that_share_no_face(), ep.STEEL, maxh=5e-3),
    "mesh of a free edge": lambda s: ep.fe_model(mesh_of_a_free_edge(), ep.STEEL),
    "lengths in millimetres": lambda s: steel_box(1e3, maxh=8),
    "elements in millimetres": lambda s: steel_box(maxh=8),
    "shape in millimetres and elements in metres": lambda s: steel_box(1e3, maxh=1e-3),
    "elements of a micrometre": lambda s: steel_box(maxh=1e-6),
    "modulus in megapascal": lambda s: of_material(s, E=210e3),
    "density in grams": lambda s: of_material(s, rho=7.8),
    "material in millimetres and geometry in metres": lambda s: of_material(s, E=210e3, rho=7.8e-9),
    "material in millimetres and milliseconds and geometry in metres": lambda s: of_material(s, E=210.0, rho=7.8e-6),
    "incompressible in linear elements": lambda s: ep.fe_model(
        s.shape, ep.Material(E=1e6, nu=0.4999, rho=1000.0), maxh=8e-3, order=1
    ),
    "refinement beside the body": lambda s: ep.fe_model(
        s.shape, ep.STEEL, maxh=8e-3, refine=ep.Refine((1, 1, 1), 1e-3, 1e-4)
    ),
    # Partitions and bodies
    "a ball larger than the body": lambda s: ep.Partition.ball(s.fem, (0, 0, 0), 4.0),
    "region in millimetres": lambda s: ep.Partition.ball(s.fem, (0, 0, 40), 4),
    "region within the body": lambda s: ep.Partition.ball(s.fem, (0, 0, 0.02), 1e-4),
    "partitions of two meshes": lambda s: ep.reduce(
        s.fem, ep.Partition.ball(steel_box(maxh=6e-3), (0, 0, 0), 4e-3), f_cut=60e3
    ),
    "patches that overlap": lambda s: (
        ep.Partition.ball(s.fem, (0, 0, 0), 4e-3) | ep.Partition.ball(s.fem, (0, 0, 0), 4e-3)
    ),
    "two patches of one name": lambda s: (
        ep.Partition.ball(s.fem, (0, 0, 0), 4e-3, name="end") | ep.Partition.ball(s.fem, (0, 0, 0.04), 4e-3, name="end")
    ),
    "frequency and tolerance": lambda s: ep.reduce(s.fem, s.part, f_cut=60e3, tolerance=0.1),
    "neither frequency nor tolerance": lambda s: ep.reduce(s.fem, s.part),
    "gravity in millimetres": lambda s: ep.CreatePartitionBody(s.empty(), s.body, gravity=[0, 0, -9810]),
    "rotation of an inertial frame": lambda s: s.apart(referenceRotation=np.eye(3)),
    "inertial frame that turns far": lambda s: run(s.apart(initialAngularVelocity=(0, 0, 1e5))),
    "marker in another model": lambda s: s.item.CreateInterfaceMarker(s.empty(), "pin"),
    "two bodies of one name": two_bodies_of_one_name,
    "load of another length": partial(loaded, answer=[0, 0]),
    "load of nothing": partial(loaded, answer=None),
    "load that is not finite": partial(loaded, answer=[0, 0, np.nan]),
    # Contacts
    "a plane metres away": lambda s: above(s, ep.RigidPlane((0, 0, -2.0))),
    "a sphere in millimetres": lambda s: above(s, ep.RigidSphere((0, 0, -40.0), 10.0)),
    "bodies that overlap": lambda s: s.model(referencePosition=(0, 0, -5e-3)),
    "bodies that overlap by initial coordinates": overlap_by_initial_coordinates,
    "bodies placed in millimetres": lambda s: run(s.model(referencePosition=(30, 0, 0))[0]),
    "bodies that turn their backs": lambda s: run(s.model(referencePosition=(0, 0, -0.1))[0]),
    "body on itself": lambda s: ep.CreatePartitionContact(s.apart(), s.striker, s.striker),
    "body on itself by a penalty": lambda s: ep.CreatePartitionContact(
        s.apart(), s.striker, s.striker, slavePatch=0, masterPatch=0, formulation="penalty"
    ),
    "one patch by two formulations": lambda s: one_patch(s, {}, {"formulation": "penalty"}),
    "one patch by two penalties": lambda s: one_patch(s, {"formulation": "penalty"}, {"formulation": "penalty"}),
    "one patch with friction but without tangents": lambda s: one_patch(s, {}, {"friction": 0.3}),
    "plane as slave": lambda s: ep.CreatePartitionContact(s.apart(), ep.RigidPlane(), s.striker),
    "bodies instead of items": lambda s: ep.CreatePartitionContact(s.empty(), s.body, s.other_body),
    "items of another model": lambda s: ep.CreatePartitionContact(s.empty(), s.item, s.target),
    "one item of another model": lambda s: ep.CreatePartitionContact(s.apart(), s.striker, s.target),
    "item from before a reset": item_from_before_a_reset,
    "two contacts of one name": two_contacts_of_one_name,
    "stiffness without a penalty": lambda s: s.model({"stiffness": 1e9}),
    "master patch of a plane": lambda s: ep.CreatePartitionContact(
        s.apart(), s.striker, ep.RigidPlane(), masterPatch=0
    ),
    "multipliers without mass": lambda s: s.model({"formulation": "lagrange"}),
    "penalty that lets bodies through": lambda s: run(
        s.model({"formulation": "penalty", "stiffness": 1e3})[0], end_time=1e-3, step=1e-6
    ),
    "impact at ten kilometres a second": lambda s: run(s.model(initialVelocity=(0, 0, -1e4))[0], end_time=40 * STEP),
    # Runs
    **{
        f"changed {name}": partial(changed_matrix, name=name)
        for name in ("massMatrix", "stiffnessMatrix", "dampingMatrix")
    },
    "changed reference coordinates": lambda s: solve(moved_node(s)),
    "changed reference coordinates and statics": lambda s: ep.solve_static(moved_node(s)),
    "a run within a run": run_within_a_run,
    "run that was not assembled": lambda s: solve(s.model()[0]),
    "run of nothing": lambda s: run(s.empty()),
    "drive that begins at another speed": lambda s: driven(s, offsetUserFunction=lambda t: 0.3 * t),
    "drive by a rate alone": lambda s: driven(s, speed=0.3, offsetUserFunction_t=lambda t: 0.3),
    "drive of a velocity by a way": lambda s: driven(s, level=True, offsetUserFunction=lambda t: 0.3 * t),
    "drive that fails": lambda s: driven(s, offsetUserFunction=lambda t: {}[t]),
    "sensor that was deleted": partial(without_a_sensor, sensor="coordinates"),
    "sensor of a contact that was deleted": partial(without_a_sensor, sensor="force"),
    "container for a model": lambda s: solve(exu.SystemContainer()),
    "unstable step": lambda s: solve(s.assembled(), end_time=1e-3, step=1e-4),
    "implicit step over the whole impact": lambda s: solve(s.assembled(), end_time=2e-3, step=5e-5, method="implicit"),
    "free step of equal steps": lambda s: solve(s.assembled(), end_time=1e-5, free_step=1e-6),
    "reference with a step beyond the end": lambda s: ep.reference.simulate(
        [s.full, s.other_full], end_time=1e-6, step=1e-3
    ),
    "reference of bodies that overlap": lambda s: ep.reference.simulate(
        [ep.reference.FullBody(s.fem, s.part, position=(0, 0, -5e-3)), s.other_full], end_time=1e-6
    ),
    # Results
    "results before a run": lambda s: ep.collect(s.assembled()),
    "nodal forces of a run without its model": partial(ask_a_file, ask=lambda r: r.contacts[0].nodal_forces(r)),
    "velocity of a run without its model": partial(ask_a_file, ask=lambda r: r.bodies[0].velocity(r, (0, 0, 0))),
    "force in another result": lambda s: s.foreign.contact.force(s.result),
    "moment without its sensor": lambda s: s.foreign.contact.moment_on_slave(s.result),
    "velocity of a point in space": lambda s: s.item.velocity(s.result, (10, 0, 0)),
    "comparison over no common time": lambda s: ep.compare(s.history, ep.History(*[np.linspace(1, 2, 11)] * 2, {})),
    "comparison with nothing": lambda s: ep.compare(s.history, history(s, 0 * s.history.t)),
    "comparison without the point": lambda s: ep.compare(history(s, s.history.force), s.history),
    "gauge beyond the surface": lambda s: ep.recovery.gauge_rows(s.fem, [ep.StrainGauge((0, 0, 0), (0, 0, 1), 1e-2)]),
    "stress without the mesh": lambda s: ep.output.write_paraview(s.folder / "stress", s.result, fields="stress"),
    "impact of planes": lambda s: ep.hertz.impact(1.0, 1.0, np.inf, np.inf, ep.STEEL),
    "impact that nothing limits": lambda s: ep.hertz.impact(np.inf, 1.0, 0.01, np.inf, ep.STEEL),
}


# Decks of FE codes, a block of one element each, that are damaged or have what an FE model of solids leaves out
CUBE = "".join(f"{i + 1}, {i % 2}e-2, {i // 2 % 2}e-2, {i // 4}e-2\n" for i in range(8))
BLOCK_OF_ABAQUS = f"*NODE\n{CUBE}*ELEMENT, TYPE=C3D8, ELSET=ALL\n1, 1, 2, 4, 3, 5, 6, 8, 7\n"
BLOCK_OF_NASTRAN = "BEGIN BULK\n" + "".join(f"GRID,{line.replace(',', ',,', 1)}\n" for line in CUBE.splitlines())
BLOCK_OF_NASTRAN += "CHEXA,1,1,1,2,4,3,5,6\n,8,7\n"
ABAQUS = {
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
}
NASTRAN = {
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
}


def read_deck(s, ending, text):
    path = s.folder / f"deck.{ending}"
    path.write_text(text)
    ep.fe_model(path, ep.STEEL)


# Command lines
NO_NUMBER = ("x", "nan", "inf", "-1", "0", "")
NO_MATERIAL = ("gold", "1,2", "1,2,3", "nan,0.3,7800", "210e9,0.3,0", "210e9;0.3;7800", "")
STEP_FILE = file("block.step")
REDUCE = {
    "--material": ("steel",),
    "--at": (0, 0, 0),
    "--radius": (4,),
    "--scale": ("1e-3",),
    "--maxh": ("8e-3",),
    "--f-cut": ("60e3",),
    "-o": (file("out.npz"),),
}


def reduce(*more, source=STEP_FILE, **change):
    """The words of a sound `reduce`, with options that are changed, or left out for None."""
    options = {**REDUCE, **change}
    words = [word for option, values in options.items() if values is not None for word in (option, *values)]
    return ("reduce", source, *words, *more)


def estimate(*more, mass=1, radius=0.01, material="steel", speed=1):
    """The words of an `estimate` of one body."""
    return ("estimate", "--first", mass, radius, material, "--speed", speed, *more)


SOURCES = {
    "missing": "/nowhere/block.step",
    "a folder": the.folder,
    "empty": file("empty.npz"),
    "text": file("text.npz"),
    "a device": "/dev/null",
}
COMMANDS = {
    "nothing": (),
    "unknown": ("reduse",),
    **{
        f"reduce, no {option}": reduce(**{option: None})
        for option in ("--material", "--at", "--radius", "--f-cut", "-o")
    },
    **{
        f"reduce, {option} {wrong!r}": reduce(**{option: (wrong,)})
        for option in ("--radius", "--scale", "--maxh", "--f-cut")
        for wrong in NO_NUMBER
    },
    **{f"reduce, tolerance {wrong!r}": reduce(**{"--f-cut": None, "--tolerance": (wrong,)}) for wrong in NO_NUMBER},
    **{f"reduce, material {wrong!r}": reduce(**{"--material": (wrong,)}) for wrong in NO_MATERIAL},
    **{
        f"reduce, at {wrong}": reduce(**{"--at": wrong})
        for wrong in (("nan", 0, 0), (0, 0), (0, 0, 0, 0), ("x", 0, 0), (0, 0, "inf"), (1, 1, 1))
    },
    **{f"reduce, source {said}": reduce(source=source) for said, source in SOURCES.items()},
    "reduce, source a body": reduce(source=file("body.npz")),
    "reduce, two points and three radii": reduce("--at", 0, 0, 1, "--radius", 1, "--radius", 1),
    "reduce, two names of a point": reduce("--name", "a", "--name", "b"),
    "reduce, tolerance beside f-cut": reduce("--tolerance", "0.1"),
    "reduce, order 3": reduce("--order", 3),
    "reduce, unknown basis": reduce("--basis", "best"),
    "reduce, unknown option": reduce("--size", 1),
    "reduce, over the source": reduce(**{"-o": (file("block.step"),)}),
    "reduce, into no folder": reduce(**{"-o": ("/nowhere/at/all.npz",)}),
    "reduce, into a folder": reduce(**{"-o": (the.folder,)}),
    "reduce, into a device": reduce(**{"-o": ("/dev/full",)}),
    "reduce, into /proc": reduce(**{"-o": ("/proc/body.npz",)}),
    "reduce, millimetres as metres": reduce(**{"--scale": None, "--maxh": (8,), "--f-cut": (60,)}),
    **{f"info of what is {said}": ("info", source) for said, source in SOURCES.items()},
    "info of what is a body": ("info", file("other.npz")),
    "info of half a file": ("info", file("half.npz")),
    **{f"estimate, speed {wrong!r}": estimate(speed=wrong) for wrong in NO_NUMBER},
    **{f"estimate, impedance {wrong!r}": estimate("--impedance", wrong.replace("inf", "-inf")) for wrong in NO_NUMBER},
    **{f"estimate, mass {wrong!r}": estimate(mass=wrong) for wrong in NO_NUMBER if wrong != "inf"},
    **{f"estimate, radius {wrong!r}": estimate(radius=wrong) for wrong in NO_NUMBER if wrong != "inf"},
    **{f"estimate of what is {said}": estimate(mass=source, radius=1) for said, source in SOURCES.items()},
    "estimate of what is missing": estimate(mass=file("none.npz"), radius=1),
    "estimate of what is a body": estimate(mass=file("other.npz"), radius=1),
    **{f"estimate, material {wrong!r}": estimate(material=wrong) for wrong in NO_MATERIAL},
    "estimate of a rigid body": estimate(material="rigid"),
    "estimate of two planes": estimate(radius="inf"),
    "estimate without limits": estimate(mass="inf"),
    "estimate of two values": ("estimate", "--first", 1, 0.01, "--speed", 1),
}


def call_command(s, words):
    """Call a command line; one that returns 0 without a word was taken silently."""
    said, wrong = io.StringIO(), io.StringIO()
    made = [str(word.make(s) if isinstance(word, Made) else word) for word in words]
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


SCENES = {
    **{f"scene({said})": make for said, make in SET_UPS.items()},
    **{f"deck(Abaqus, {k})": partial(read_deck, ending="inp", text=BLOCK_OF_ABAQUS + v) for k, v in ABAQUS.items()},
    **{
        f"deck(Nastran, {k})": partial(read_deck, ending="bdf", text=f"{BLOCK_OF_NASTRAN}{v}ENDDATA\n")
        for k, v in NASTRAN.items()
    },
    **{f"command({said})": partial(call_command, words=words) for said, words in COMMANDS.items()},
}
