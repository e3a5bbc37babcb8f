"""Stiffening and softening by loads: a strut, a rotating blade, and the link of a crank slider near its buckling load.

References: sqrt(1 - P / P_E) of a hinged strut under P, Euler's P_E, also of a body that keeps nodes (basis "free");
beam theory for a free bar with a force on a patch at its end; frequencies of a cantilever that rotates about its
clamped end by Wright et al. (J. Appl. Mech. 49, 1982), and Southwell's sum of squares with the shape at rest; Exudyn's
own beams (ANCFCable2D), 24 of them, in the same crank slider, which presses its link with 0.4 of Euler's load.
Quantity: relative errors of frequencies; L2 error of the deflection of the link's middle; processor time of an implicit
step with geometric stiffness by that without it: of the crank slider, and of a hinged strut with basis "free" in an
inertial frame, whose steps are linear without it; iterations of Newton's method in both, by those without it.
Limits: 1 % up to 0.8 P_E, and up to the speed at which the first frequency across the plane of rotation has doubled,
in the plane (`lag`) and across it (`flap`); 2 % of the link; 1.3 times the time of a step, and the iterations.

    python -m validation.joints.geometric_stiffness
"""

import json
import time
import warnings

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np
import scipy.linalg
from exudyn.beams import GenerateBeamElementsAlongLine

import exudyn_partition as ep
from validation.contact import scenes

LIMITS = {
    "strut": 0.01,
    "strut_with_nodes": 0.01,
    "pressed": 0.01,
    "flap": 0.01,
    "lag": 0.01,
    "southwell": 0.01,
    "link": 0.02,
    "step_ratio": 1.3,
    "iterations": 1.3,
    "step_ratio_with_nodes": 1.3,
    "iterations_with_nodes": 1.3,
}
LENGTH, HEIGHT, WIDTH = 0.3, 0.006, 0.010  # of the strut and the link [m]
EI = ep.ALUMINIUM.E * WIDTH * HEIGHT**3 / 12
EULER = np.pi**2 * EI / LENGTH**2
# Rates of rotation and flapwise frequencies, both times the root of rho A L^4 / E I.
WRIGHT = {0: 3.5160, 1: 3.6816, 2: 4.1373, 3: 4.7973, 4: 5.5850, 5: 6.4495, 6: 7.3604}
FREE_BAR = 4.730040745  # lowest root of cosh(x) cos(x) = 1
SHAPE_AT_REST = 1.193  # Southwell's coefficient of the cantilever's first mode
CRANK, SPEED, RAMP, END, STEP = 0.03, 2 * np.pi * 20, 0.05, 0.15, 1e-4
SHARE, SLIDER = 0.4, 0.2  # of Euler's load; mass [kg]
TURNS = 5  # runs with and without geometric stiffness, of which the least times count


def bar(material, size, *, rotates):
    """A bar along x, with interfaces at one end or both."""
    shape = occ.Box(occ.Pnt(0, -size[1] / 2, -size[2] / 2), occ.Pnt(size[0], size[1] / 2, size[2] / 2))
    shape.faces.Min(occ.X).name, shape.faces.Max(occ.X).name = "foot", "head"
    fem = ep.fe_model(shape, material, maxh=12e-3)
    part = ep.Partition.interface(fem, "foot", "foot")
    return fem, part if rotates else part | ep.Partition.interface(fem, "head", "head")


def marker_at(mbs, *place):
    ground = mbs.AddObject(items.ObjectGround(referencePosition=list(place)))
    return mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground))


def strut(basis):
    """Shares of Euler's load, and lowest frequencies by that without load, from equilibria in Exudyn."""
    fem, part = bar(ep.ALUMINIUM, (LENGTH, HEIGHT, WIDTH), rotates=False)
    patch = ep.Partition.ball(fem, (LENGTH / 2, HEIGHT / 2, 0), 13e-3)
    body = ep.reduce(fem, part | patch, f_cut=5e3, basis=basis, geometric_stiffness=True)
    shares, found = [-1.0, -0.5, 0.0, 0.2, 0.4, 0.6, 0.8], []
    for share in shares:
        mbs = exu.SystemContainer().AddSystem()
        item = ep.CreatePartitionBody(mbs, body, name="strut", frame="floating")
        foot, head = (item.CreateInterfaceMarker(mbs, name) for name in ("foot", "head"))
        for place, marker, axes in ((0, foot, [1, 1, 1, 1, 0, 0]), (LENGTH, head, [0, 1, 1, 0, 0, 0])):
            mbs.AddObject(items.GenericJoint(markerNumbers=[marker_at(mbs, place, 0, 0), marker], constrainedAxes=axes))
        mbs.AddLoad(items.LoadForceVector(markerNumber=head, loadVector=[-share * EULER, 0, 0]))
        mbs.Assemble()
        ep.solve_static(mbs, load_steps=1, update_initial=True)
        values = mbs.ComputeODE2Eigenvalues(convert2Frequencies=True)[0]
        found.append(np.sort(values[np.isfinite(values)])[0])
    return shares, [value / found[shares.index(0.0)] for value in found]


def pressed():
    """Error of the change of the lowest squared frequency of a free bar, by a force on a patch at one end.

    Inertia balances the force: the compression falls to zero at the other end. By beam theory, with the shape w of the
    unloaded bar, the square changes by half the force times the integral of w'^2, by that of rho A w^2. The reduced
    body has no axial mode below its truncation frequency.
    """
    fem = ep.fe_model(occ.Box(occ.Pnt(0, -HEIGHT / 2, 0), occ.Pnt(LENGTH, HEIGHT / 2, WIDTH)), ep.ALUMINIUM, maxh=12e-3)
    patch = ep.Partition.ball(fem, (LENGTH, 0, WIDTH / 2), 3e-3)
    body = ep.reduce(fem, patch, f_cut=3e3, geometric_stiffness=True)
    (own,), force = patch.patches, 1.0
    stiffness = body.geometric_stiffness(
        body.rows(own.nodes).T @ np.tile([-force / len(own.nodes), 0, 0], len(own.nodes))
    )
    motions = scipy.linalg.eigh(body.stiffness.toarray(), body.mass.toarray())[1]
    change = motions[:, 6] @ stiffness @ motions[:, 6]
    x = np.linspace(0, FREE_BAR, 20001)
    shape, slope = free_bar(x, FREE_BAR)
    theory = -force / 2 * np.trapezoid(slope**2, x) / np.trapezoid(shape**2, x) * (FREE_BAR / LENGTH) ** 2
    return float(change / (theory / (ep.ALUMINIUM.rho * WIDTH * HEIGHT)) - 1)


def free_bar(x, root):
    """Lowest bending shape of a free bar at x, from 0 to the root of cosh(x) cos(x) = 1, and its slope by x."""
    ratio = (np.cosh(root) - np.cos(root)) / (np.sinh(root) - np.sin(root))
    shape = np.cosh(x) + np.cos(x) - ratio * (np.sinh(x) + np.sin(x))
    return shape, np.sinh(x) - np.sin(x) - ratio * (np.cosh(x) + np.cos(x))


def blade():
    """Lowest frequencies across the plane of rotation and in it, by those at rest, from reduced matrices."""
    fem, part = bar(ep.STEEL, (0.5, 0.010, 0.008), rotates=True)
    body = ep.reduce(fem, part, f_cut=1e3, geometric_stiffness=True)
    root, shapes = body.interface_rows("foot"), body.rows(np.arange(fem.n_nodes)).reshape(-1, 3, body.n_dofs)
    free, mass = scipy.linalg.null_space(root), fem.mass[::3, ::3]
    in_plane = sum(shapes[:, axis].T @ (mass @ shapes[:, axis]) for axis in (0, 1))
    xy = shapes[:, 0].T @ (mass @ shapes[:, 1])
    M, gyroscopic = free.T @ body.mass @ free, 2 * free.T @ (xy.T - xy) @ free

    def lowest(omega):
        reaction = -root[0] * body.total_mass * omega**2 * body.centre_of_mass[0]
        stiffness = body.geometric_stiffness(body.centrifugal_load([0, 0, omega]) + reaction)
        K, n = free.T @ (body.stiffness + stiffness - omega**2 * in_plane) @ free, free.shape[1]
        system = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, np.hstack([K, omega * gyroscopic]))]])
        values, vectors = np.linalg.eig(system)
        tip = abs(np.einsum("an,nm->am", shapes[fem.points[:, 0].argmax()] @ free, vectors[:n]))
        rises = values.imag > 0
        return [values.imag[rises & (tip.argmax(axis=0) == axis)].min() for axis in (2, 1)]

    at_rest = lowest(0.0)
    flap = [lowest(rate / WRIGHT[0] * at_rest[0])[0] / at_rest[0] for rate in WRIGHT]
    lag = [lowest(rate / WRIGHT[0] * at_rest[1])[1] / at_rest[1] for rate in WRIGHT]
    return flap, lag


def angle(t):
    """Of the crank [rad]: its speed grows smoothly."""
    x = min(t / RAMP, 1.0)
    return SPEED * (RAMP * (x**3 - x**4 / 2) + max(t - RAMP, 0.0))


def crank_slider(mbs):
    """Crank that turns as `angle` says, and a slider that is pressed: markers of both pins."""
    crank = mbs.AddNode(items.NodeRigidBodyRxyz(referenceCoordinates=[0.0] * 6))
    inertia = [1e-4, 1e-4, 1e-4, 0, 0, 0]
    wheel = mbs.AddObject(items.ObjectRigidBody(mass=0.1, inertia=inertia, nodeNumber=crank))
    nothing = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(items.NodePointGround()), coordinate=0))
    for i in range(6):
        own = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=crank, coordinate=i))
        turned = {"offsetUserFunction": lambda mbs, t, number, offset: angle(t)} if i == 5 else {}
        mbs.AddObject(items.CoordinateConstraint(markerNumbers=[nothing, own], **turned))
    slider = mbs.AddNode(items.NodePoint(referenceCoordinates=[CRANK + LENGTH, 0, 0]))
    mass = mbs.AddObject(items.MassPoint(mass=SLIDER, nodeNumber=slider))
    for i in (1, 2):
        own = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=slider, coordinate=i))
        mbs.AddObject(items.CoordinateConstraint(markerNumbers=[nothing, own]))
    pin = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=wheel, localPosition=[CRANK, 0, 0]))
    end = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=mass))

    def pressed(mbs, t, vector):
        return [-SHARE * EULER * (1 - np.cos(np.pi * min(t / RAMP, 1.0))) / 2, 0, 0]

    mbs.AddLoad(items.LoadForceVector(markerNumber=end, loadVector=[1, 0, 0], loadVectorUserFunction=pressed))
    return pin, end


def beams():
    """Deflection of the middle of Exudyn's beams from the line between the pins, at the times of steps [m]."""
    mbs = exu.SystemContainer().AddSystem()
    pin, end = crank_slider(mbs)
    area, n = WIDTH * HEIGHT, 24
    cable = items.ObjectANCFCable2D(
        massPerLength=ep.ALUMINIUM.rho * area,
        bendingStiffness=EI,
        axialStiffness=ep.ALUMINIUM.E * area,
    )
    nodes = GenerateBeamElementsAlongLine(mbs, [CRANK, 0, 0], [CRANK + LENGTH, 0, 0], n, cable)["nodes"]
    for marker, node in ((pin, nodes[0]), (end, nodes[-1])):
        own = mbs.AddMarker(items.MarkerNodePosition(nodeNumber=node))
        mbs.AddObject(items.SphericalJoint(markerNumbers=[marker, own], constrainedAxes=[1, 1, 0]))
    kind = exu.OutputVariableType.Position
    sensors = [
        mbs.AddSensor(items.SensorNode(nodeNumber=nodes[i], storeInternal=True, outputVariableType=kind))
        for i in (0, n // 2, n)
    ]
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.timeIntegration.numberOfSteps, settings.timeIntegration.endTime = round(END / STEP), END
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.9
    settings.timeIntegration.verboseMode = 0
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = STEP
    mbs.SolveDynamic(settings)
    first, middle, last = (mbs.GetSensorStoredData(sensor)[:, 1:3] for sensor in sensors)
    return mbs.GetSensorStoredData(sensors[0])[:, 0], aside(first, middle, last)


def aside(first, middle, last):
    way, away = last - first, middle - (first + last) / 2
    return (way[:, 0] * away[:, 1] - way[:, 1] * away[:, 0]) / np.linalg.norm(way, axis=1)


def link(body):
    """Times, deflection of the middle of a reduced link [m], processor time of a step [s], and iterations a step."""
    mbs = exu.SystemContainer().AddSystem()
    pin, end = crank_slider(mbs)
    item = ep.CreatePartitionBody(mbs, body, name="link", frame="floating", referencePosition=[CRANK, 0, 0])
    foot, head = (item.CreateInterfaceMarker(mbs, name) for name in ("foot", "head"))
    mbs.AddObject(items.GenericJoint(markerNumbers=[pin, foot], constrainedAxes=[1, 1, 1, 1, 1, 0]))
    mbs.AddObject(items.SphericalJoint(markerNumbers=[end, head], constrainedAxes=[1, 1, 0]))
    mbs.Assemble()
    begin = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of compression, without geometric stiffness
        result = ep.solve_dynamic(mbs, end_time=END, step=STEP, method="implicit")
    spent, iterations = np.array([time.process_time() - begin, result.work.newton_iterations]) / result.steps
    nodes = [body.partition.find_interface(name).nodes for name in ("foot", "head")]
    nodes.insert(
        1, np.array([body.nearest_node((LENGTH / 2, HEIGHT / 2, 0)), body.nearest_node((LENGTH / 2, -HEIGHT / 2, 0))])
    )
    q = item.coordinates(result)
    places = [item.kinematics.at(own).place(q).mean(axis=1)[:, :2] for own in nodes]
    deflection = aside(*places)
    return result.t, deflection - deflection[0], spent, iterations


def pressed_strut(body):
    """Processor time of a step [s], and iterations a step, of a strut that half of Euler's load presses."""
    mbs, steps = exu.SystemContainer().AddSystem(), 1500
    item = ep.CreatePartitionBody(mbs, body, name="strut", gravity=[0, 100.0, 0])
    foot, head = (item.CreateInterfaceMarker(mbs, name) for name in ("foot", "head"))
    for place, marker, axes in ((0, foot, [1, 1, 1, 1, 0, 0]), (LENGTH, head, [0, 1, 1, 0, 0, 0])):
        mbs.AddObject(items.GenericJoint(markerNumbers=[marker_at(mbs, place, 0, 0), marker], constrainedAxes=axes))

    def pressed(mbs, t, load):
        return [-0.5 * EULER * min(t / 5e-3, 1.0), 0, 0]

    mbs.AddLoad(items.LoadForceVector(markerNumber=head, loadVector=[1, 0, 0], loadVectorUserFunction=pressed))
    mbs.Assemble()
    begin = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of compression, without geometric stiffness
        result = ep.solve_dynamic(mbs, end_time=steps * 2e-5, step=2e-5, method="implicit", sample_period=1e-3)
    spent, iterations = np.array([time.process_time() - begin, result.work.newton_iterations]) / result.steps
    return spent, iterations


def compared(run, bodies):
    """Ratios of the time of a step and of iterations with geometric stiffness by those without it."""
    spent = {name: [] for name in bodies}
    for _ in range(TURNS):  # by turns, since other work on the machine comes and goes
        for name, body in bodies.items():
            spent[name].append(run(body)[-2:])
    with_it, without = (np.min(spent[name], axis=0) for name in ("with", "without"))
    return [float(ratio) for ratio in with_it / without]


def main():
    shares, loaded = strut("contact-adapted")
    _, with_nodes = strut("free")
    flap, lag = blade()
    rates = np.array([*WRIGHT])
    wright = np.array([*WRIGHT.values()]) / WRIGHT[0]
    in_plane = np.sqrt(wright**2 - (rates / WRIGHT[0]) ** 2)
    southwell = np.sqrt(1 + SHAPE_AT_REST * (rates / WRIGHT[0]) ** 2)
    doubled = wright <= wright[wright >= 2][0]
    t, reference = beams()
    model = bar(ep.ALUMINIUM, (LENGTH, HEIGHT, WIDTH), rotates=False)
    both = {"without": False, "with": True}
    bodies = {name: ep.reduce(*model, f_cut=2e3, geometric_stiffness=own) for name, own in both.items()}
    runs = {name: link(body) for name, body in bodies.items()}  # compiles
    patch = ep.Partition.ball(model[0], (LENGTH / 2, HEIGHT / 2, 0), 13e-3)
    struts = {
        name: ep.reduce(model[0], model[1] | patch, f_cut=5e3, basis="free", geometric_stiffness=own)
        for name, own in both.items()
    }
    of_link, of_strut = compared(link, bodies), compared(pressed_strut, struts)
    errors = {
        name: float(np.linalg.norm(np.interp(t, own[0], own[1]) - reference) / np.linalg.norm(reference))
        for name, own in runs.items()
    }
    found = {
        **{
            name: float(max(abs(f / np.sqrt(1 - p) - 1) for p, f in zip(shares, own, strict=True)))
            for name, own in (("strut", loaded), ("strut_with_nodes", with_nodes))
        },
        "pressed": abs(pressed()),
        "flap": float(abs(flap / wright - 1)[doubled].max()),
        "lag": float(abs(lag / in_plane - 1)[doubled].max()),
        "southwell": float(abs(flap / southwell - 1)[wright <= 2].max()),
        "link": errors["with"],
        "step_ratio": of_link[0],
        "iterations": of_link[1],
        "step_ratio_with_nodes": of_strut[0],
        "iterations_with_nodes": of_strut[1],
    }
    print(json.dumps(found, indent=1), f"link without geometric stiffness: {errors['without']:.3g}", sep="\n")
    path, (figure, (left, middle, right)) = scenes.figure(__file__, ncols=3, figsize=(13, 4))
    p = np.linspace(-1, 0.99, 200)
    left.plot(p, np.sqrt(1 - p), "k-", shares, loaded, "o")
    left.set(xlabel="load by Euler's", ylabel="frequency by that without load", title="strut")
    middle.plot(rates, wright, "k-", rates, flap, "o", rates, in_plane, "k--", rates, lag, "s")
    middle.set(xlabel="rate of rotation (reduced)", ylabel="frequency by that at rest", title="rotating blade")
    right.plot(t * 1e3, reference * 1e3, "k-", label="Exudyn's beams")
    for name, own in runs.items():
        right.plot(own[0] * 1e3, own[1] * 1e3, label=f"{name} geometric stiffness")
    right.set(xlabel="t [ms]", ylabel="deflection of the middle [mm]", title="link at 0.4 of its buckling load")
    right.legend()
    figure.savefig(path, dpi=110)
    failed = [key for key, limit in LIMITS.items() if not found[key] <= limit]
    scenes.finish(__file__, {"found": found, "limits": LIMITS, "link_without": errors["without"]}, failed)


if __name__ == "__main__":
    main()
