"""Short examples for the API pages: `conf.py` shows each block beneath the names before its first line.

The blocks are one program. `tests/examples/test_site_programs.py` runs it; `tests/house/test_site.py` holds that each
public name has a block.
"""

# %%
import exudyn as exu
import meshio
import netgen.occ as occ
import numpy as np
import scipy.io

import exudyn_partition as ep

R, GRAVITY = 0.01, [0, 0, -9.81]

# %% Material
brass = ep.Material(E=100e9, nu=0.35, rho=8500.0, yield_stress=250e6)
print(f"{brass.bar_wave_speed:.0f} m/s")

# %% STEEL, ALUMINIUM
print(ep.STEEL, ep.ALUMINIUM, sep="\n")

# %% Refine
contact_zone = ep.Refine((0, 0, 0), radius=1e-3, h=0.3e-3)  # elements of 0.3 mm within 1 mm

# %% fe_model
fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, R), R), ep.STEEL, maxh=5e-3, refine=[contact_zone])
print(fem)  # size and mass show whether the unit was right

# %% generate_mesh
mesh = ep.generate_mesh(occ.Box((-R, -R, -R), (R, R, 0)), maxh=6e-3)
anvil_fem = ep.fe_model(mesh, ep.ALUMINIUM)

# %% FEModel
print(f"{fem.total_mass:.4f} kg, {fem.n_dofs} dofs, longest axis {np.ptp(fem.points, axis=0).max():.3f} m")

# %% from_feminterface
# fem = ep.from_feminterface(feminterface, ep.STEEL)  # an exudyn.FEM.FEMinterface with mesh and matrices

# %% read_step, StepAssembly, fe_models
base, pin = occ.Box((0, 0, 0), (40, 20, 5)), occ.Cylinder(occ.Pnt(10, 10, 5), occ.Z, r=4, h=20)
base.name, pin.name = "base", "pin"
occ.Compound([base, pin]).WriteStep("machine.step")  # stands for your own file, in millimetres
machine = ep.read_step("machine.step", scale=1e-3)
print(machine.names)
parts = ep.fe_models(machine, {"base": ep.ALUMINIUM, "pin": ep.STEEL}, maxh=8e-3)

# %% read_bodies, FileBodies
points, tetra = fem.points, fem.cells[:, :4]
two = np.vstack([points, points + np.array([0, 0, 3 * R])]), np.vstack([tetra, tetra + len(points)])
meshio.Mesh(two[0], [("tetra", two[1])]).write("balls.vtu")  # stands for your own deck or mesh
balls = ep.read_bodies("balls.vtu")
print(balls)  # names, sizes and places, and what is tied or touches
both = ep.fe_models(balls, dict.fromkeys(balls.names, ep.STEEL), order=2)

# %% read_matrices, FileMatrices
scipy.io.mmwrite("K.mtx", anvil_fem.stiffness)  # stand for those of another program
scipy.io.mmwrite("M.mtx", anvil_fem.mass)
matrices = ep.read_matrices("K.mtx", "M.mtx")
print(matrices.stiffness.shape)

# %% Partition
part = ep.Partition.ball(fem, (0, 0, 0), radius=1e-3, name="south")  # faces near a point may touch others
anvil_part = ep.Partition.ball(anvil_fem, (0, 0, 0), radius=5e-3, direction=(0, 0, 1))
anvil_part |= ep.Partition.interface(anvil_fem, "foot", np.flatnonzero(anvil_fem.points[:, 2] < -0.99 * R))
ep.plot.selection(anvil_fem, anvil_part)

# %% reduce
body = ep.reduce(fem, part, f_cut=150e3)  # motion below f_cut by modes, all else as a static answer
anvil = ep.reduce(anvil_fem, anvil_part, f_cut=60e3)

# %% ReducedBody, load_body
print(body.table())
body.save("ball.npz")
body = ep.load_body("ball.npz")

# %% reduce_pair, Estimate
pair = ep.reduce_pair((fem, part), (anvil_fem, anvil_part), tolerance=0.1, speed=0.5, duration=50e-6)
print(pair[0].estimate)

# %% mesh_error, with_mesh_error
print(ep.mesh_error((fem, body), ep.RigidPlane(), speed=0.5, duration=50e-6))
(told, _) = ep.with_mesh_error((fem, pair[0]), (anvil_fem, pair[1]))

# %% design_impact, ImpactDesign
design = ep.design_impact(
    (occ.Sphere(occ.Pnt(0, 0, R), R), ep.STEEL), ep.RigidPlane(), speed=0.5, contact=(0, 0, 0), tolerance=0.2
)
print(design)

# %% CreatePartitionBody, PartitionBody
mbs = exu.SystemContainer().AddSystem()
ball = ep.CreatePartitionBody(mbs, body, name="ball", initialVelocity=[0, 0, -0.3], gravity=GRAVITY)
block = ep.CreatePartitionBody(mbs, anvil, name="block", damping=ep.Rayleigh(beta=1e-8))

# %% Rayleigh
damping = ep.Rayleigh(alpha=0.0, beta=1e-8)  # alpha M + beta K

# %% CreatePartitionContact, PartitionContact
contact = ep.CreatePartitionContact(mbs, ball, block, name="ball on block")

# %% RigidPlane, RigidSphere, RigidCylinder
floor = ep.RigidPlane(point=(0, 0, -R), normal=(0, 0, 1))
cap = ep.RigidSphere((0, 0, -0.05), 0.05)
bore = ep.RigidCylinder(point=(0, 0, 0), axis=(0, 1, 0), radius=0.05, hollow=True)

# %% RigidProfile
angle = np.linspace(0, 2 * np.pi, 120, endpoint=False)
cam = ep.RigidProfile(0.02 * np.column_stack([1.2 * np.cos(angle), np.sin(angle)]), axis=(0, 1, 0), first=(1, 0, 0))

# %% RigidMesh
tool = ep.RigidMesh.of(occ.Box((-0.02, -0.02, -0.03), (0.02, 0.02, -0.01)), maxh=0.02)

# %% CreatePartitionView
ep.CreatePartitionView(mbs, scale=100)  # what Exudyn's renderer shows, before mbs.Assemble()

# %% CreateWorkSensor, WorkSensor
sensor = ep.CreateWorkSensor(mbs)  # after all items, before mbs.Assemble()

# %% stability_limit, time_to_contact
mbs.Assemble()
print(f"explicit steps: at most {ep.stability_limit(mbs):.2g} s")
q_t = np.concatenate([ball.kinematics.weight([0, 0, -1]) / ball.kinematics.mass, np.zeros(anvil.n_dofs)])
print(f"closed after {ep.time_to_contact(contact, np.zeros(len(q_t)), q_t):.2g} s at 1 m/s")

# %% natural_modes
frequencies, modes = ep.natural_modes(mbs)  # of contact as it is in the initial state: closed after solve_static

# %% solve_dynamic, Result
result = ep.solve_dynamic(mbs, end_time=80e-6)
print(result, f"peak {contact.force(result).max():.0f} N")
result.scene("run.html")
work = sensor.work(result)  # by the name of the item

# %% collect
settings = exu.SimulationSettings()
settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = 80e-6, 400
settings.solution.file.write = False
mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.VelocityVerlet)  # Exudyn's own call
same = ep.collect(mbs)

# %% History
history = result.history(contact, {"top": (ball, (0, 0, 2 * R))})
print(f"{history.peak_force:.0f} N, {1e6 * history.contact_duration:.0f} us, {history.impulse:.4f} N s")

# %% compare, Comparison
comparison = ep.compare(same.history(contact, {"top": (ball, (0, 0, 2 * R))}), history)
print(comparison.error)

# %% versions, progress
print(ep.versions())
with ep.progress("my own loop") as report:
    report(0.5)

# %% StrainGauge
gauge = ep.StrainGauge((R, 0, R), direction=(0, 0, 1), length=3e-3)
strain = ball.recover(result, ep.recovery.gauge_rows(fem, [gauge]))

# %% truncation_frequency, amplitude_spectrum
f, amplitude = ep.amplitude_spectrum(history.t, history.force)
print(f"f_cut for 1 %: {ep.truncation_frequency(history.t, history.force, tolerance=1e-2):.3g} Hz")

# %% CreateDistributedLoad
plate = occ.Box((-R, -R, 0), (R, R, 2e-3))
plate.faces.Max(occ.Z).name = "top"
plate_fem = ep.fe_model(plate, ep.STEEL, maxh=5e-3)
loaded = ep.reduce(plate_fem, ep.Partition.load(plate_fem, "pressure", "top"), f_cut=30e3)
mbs = exu.SystemContainer().AddSystem()
pressed = ep.CreatePartitionBody(mbs, loaded)
ep.CreateDistributedLoad(mbs, pressed, "pressure", 1e5, loadUserFunction=lambda mbs, t, p: p * min(1, t / 1e-3))

# %% solve_static, settle
mbs = exu.SystemContainer().AddSystem()
ball = ep.CreatePartitionBody(mbs, body, gravity=GRAVITY, referencePosition=[0, 0, 1e-4])
on_floor = ep.CreatePartitionContact(mbs, ball, ep.RigidPlane())
mbs.Assemble()
at_rest = ep.settle(mbs)  # as solve_static, after the ball has fallen on the floor
print(f"{on_floor.force(at_rest)[-1]:.3f} N")

# %% Coulomb, FrictionResults
grips = ep.reduce(fem, ep.Partition.ball(fem, (0, 0, 0), radius=1e-3, axes="xyz"), f_cut=150e3)
mbs = exu.SystemContainer().AddSystem()
slider = ep.CreatePartitionBody(mbs, grips, initialVelocity=[0.3, 0, -0.3])
rubbing = ep.CreatePartitionContact(mbs, slider, ep.RigidPlane(), friction=ep.Coulomb(0.3, 0.2, decay=0.1))
mbs.Assemble()
slid = ep.solve_dynamic(mbs, end_time=50e-6)
print(f"friction took {rubbing.friction.work(slid)[-1]:.2g} J")

# %% PlasticResults, PlasticState
soft = ep.Material(E=70e9, nu=0.33, rho=2700.0, yield_stress=100e6, hardening=500e6)
soft_fem = ep.fe_model(occ.Sphere(occ.Pnt(0, 0, R), R), soft, maxh=5e-3, refine=[contact_zone])
yields = ep.Partition.ball(soft_fem, (0, 0, 0), 1e-3, plastic_radius=1.2e-3)
mbs = exu.SystemContainer().AddSystem()
dented = ep.CreatePartitionBody(mbs, ep.reduce(soft_fem, yields, f_cut=150e3), initialVelocity=[0, 0, -0.5])
hit = ep.CreatePartitionContact(mbs, dented, ep.RigidPlane())
mbs.Assemble()
after = ep.solve_dynamic(mbs, end_time=80e-6)
states = hit.plastic.states(after)  # the next run begins with the dent: plasticStates= of CreatePartitionBody
print(hit.plastic.dents(after))


# %% study, Study
def approach(speed, radius):
    """How far a ball of steel and a rigid plane approach [m]."""
    return ep.hertz.impact(0.03, speed, radius, np.inf, ep.STEEL).approach


runs = ep.study(
    approach, {"speed": [0.1, 0.2], "radius": [0.01, 0.02, 0.03]}, file="runs.jsonl"
)  # workers=2: processes
print(runs["value"].shape, len(ep.Study.load("runs.jsonl")))

# %% sample_parameters
points = ep.sample_parameters({"speed": (0.1, 0.5), "radius": (0.01, 0.03)}, 16)  # Sobol points
print(ep.study(approach, points)["value"].mean())

# %% run_many, ManyRuns
mbs = exu.SystemContainer().AddSystem()
ball = ep.CreatePartitionBody(mbs, body, referencePosition=[0, 0, 1e-6])
ep.CreatePartitionContact(mbs, ball, ep.RigidPlane())
mbs.Assemble()
runs = ep.run_many(mbs, end_time=20e-6, vary={ball: {"initialVelocity": [[0, 0, -0.2], [0, 0, -0.5]]}})
print(runs, runs.peak[:, 0], runs.failures)

# %% sensitivity, Sensitivity
slope = ep.sensitivity(mbs, end_time=20e-6, of="velocity", at=ball)
print(slope.value, slope.by[ball]["gravity"], slope.by[ball]["rho"])

# %% restitution_map, RestitutionMap, RestitutionLaw
found = ep.restitution_map((body, ep.RigidPlane()), speed=(0.2, 0.5))
print(found["restitution"].ravel(), found.law().error)

# %% errors
try:
    ep.reduce(fem, part, f_cut=-1.0)
except ep.errors.InputError as error:  # all are PartitionError
    print(error)

# %% hertz
mass = 4 / 3 * np.pi * R**3 * ep.STEEL.rho
impact = ep.hertz.impact(mass, 0.3, R, np.inf, ep.STEEL)
print(f"{impact.peak_force:.0f} N for {1e6 * impact.duration:.0f} us")

# %% output
ep.output.write_paraview("frames", result, times=3)

# %% plot
ep.plot.force(None, result).figure.savefig("force.png")

# %% recovery
stress = ep.recovery.stress_rows(fem, [(0, 0, R)])  # times the nodes' displacements: stress at the middle

# %% reference
full = [ep.reference.FullBody(fem, part, velocity=(0, 0, -0.3)), ep.reference.FullBody(anvil_fem, anvil_part)]
truth = ep.reference.simulate(full, end_time=5e-6, step=0.5e-6)

# %% report
print(ep.report.compare(history, history).error)

# %% view
image = ep.view.picture(result, size=(320, 240))

# %% pyvista_view
# ep.pyvista_view.turntable("turn.gif", result)  # pip install "exudyn-partition[pictures]"
