"""Equilibria with contact: pressed spheres, a clamped stack of bars, and its natural frequencies.

Reference: two spheres of steel that loads over their mass press together, by the series for whole elastic spheres
(contact/elastic_sphere.py), and by Hertz. A bar of steel on one of aluminium whose outer faces are moved together: the
force is the travel over the sum of L / (E A). Two bars without lateral strain that are pressed together at
their outer faces: they vibrate along their axis like one free bar of double length, at j c / (4 L).
Quantity: relative errors of the force at an approach, of the largest pressure at a force, of the force of the stack in
each load step, and of the first three longitudinal frequencies by Exudyn's eigenvalues at the equilibrium. Also how far
the force of a dynamic run from the preloaded state moves.
Limits: 0.7 % for spheres, 2 % for pressure, 0.1 % for the stack, 0.5 % for frequencies, 1e-4 for the preloaded run.

    python -m validation.inelastic.statics
"""

import time

import exudyn as exu
import exudyn.itemInterface as items
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep
from validation.contact import scenes
from validation.contact.elastic_sphere import ElasticSphere

RADIUS, LOAD, LOAD_STEPS = 0.010, 400.0, 20
SIDE, LENGTH, TRAVEL, PRELOAD = 0.010, 0.060, 10e-6, 1000.0
MODES, BAR_F_CUT = 3, 90e3
UNIFORM = ep.Material(E=210e9, nu=0.0, rho=7850.0)  # bar theory is exact
LIMITS = {"spheres": 7e-3, "pressure": 0.02, "stack": 1e-3, "frequencies": 5e-3, "preloaded": 1e-4}


def spring(mbs, item, stiffness):
    """Springs on the rigid motion, (6,) [N/m and N m]."""
    body = item.body
    momentum = np.asarray(body.mass @ body.rigid)
    to_motion = momentum @ np.linalg.inv(body.rigid.T @ momentum)
    matrix = exu.MatrixContainer(to_motion @ np.diag(stiffness) @ to_motion.T)
    hidden = items.VObjectGenericODE2(show=False)
    mbs.AddObject(items.ObjectGenericODE2(nodeNumbers=item.nodes, stiffnessMatrix=matrix, visualization=hidden))


def press(mbs, item, force):
    """Load along z [N], spread over the mass."""
    load = np.asarray(item.body.mass @ item.body.rigid)[:, 2] * force / item.body.total_mass
    for i in np.flatnonzero(abs(load) > 1e-9 * abs(load).max()):
        marker = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=item.nodes[0], coordinate=int(i)))
        mbs.AddLoad(items.LoadCoordinate(markerNumber=marker, load=load[i]))


def spheres():
    """Two spheres, held softly and pressed together: curves and errors."""
    R, material = RADIUS, scenes.STEEL
    a = ep.hertz.contact_radius(LOAD, R, R, material, material)
    models = [
        scenes.sphere(R, material, a, 0.24 * a),
        scenes.sphere(R, material, a, 0.27 * a, up=False, spare=0.4 * a),
    ]
    bodies = [ep.reduce(*model, f_cut=200e3) for model in models]
    mbs = exu.SystemContainer().AddSystem()
    upper, lower = (
        ep.CreatePartitionBody(mbs, body, name=name) for body, name in zip(bodies, ("upper", "lower"), strict=True)
    )
    contact = ep.CreatePartitionContact(mbs, upper, lower)
    for item, sign in ((upper, -1), (lower, 1)):
        spring(mbs, item, [1e7, 1e7, 1e4, 1e3, 1e3, 1e3])
        press(mbs, item, sign * LOAD)
    mbs.Assemble()
    result = ep.solve_static(mbs, load_steps=LOAD_STEPS, update_initial=True)
    force = contact.force(result)
    approach = lower.rigid_motion(lower.coordinates(result))[:, 2] - upper.rigid_motion(upper.coordinates(result))[:, 2]
    series = ElasticSphere(R, material).force(approach / 2)  # each of two equal spheres meets a plane
    hertz = 4 / 3 * material.plane_strain_modulus / 2 * np.sqrt(R / 2) * np.maximum(approach, 0) ** 1.5
    stress = contact.largest_stress(result)
    p0 = (6 * stress.force * (material.plane_strain_modulus / 2) ** 2 / np.pi**3 / (R / 2) ** 2) ** (1 / 3)
    after = contact.force(ep.solve_dynamic(mbs, end_time=20e-6))
    large = force > 0.25 * force.max()
    return {
        "nodes": sum(fem.n_nodes for fem, _ in models),
        "closed_rows": int(contact.closed_rows(result).max()),
        "largest_force_N": force.max(),
        "against_hertz": force[-1] / hertz[-1] - 1,
        "online_s": result.time_s,
        "newton_iterations": result.work.newton_iterations,
        "errors": {
            "spheres": abs(force[large] / series[large] - 1).max(),
            "pressure": stress.pressure / p0 - 1,
            "preloaded": abs(after / force[-1] - 1).max(),
        },
        "curves": {"approach_m": list(approach), "force_N": list(force), "series_N": list(series)},
    }


def bars(materials):
    """A bar above z = 0 and one below, whose outer faces are interfaces."""
    found = []
    for sign, material, maxh in zip((1, -1), materials, (3.5e-3, 2.8e-3), strict=True):
        low, high = sorted((0, sign * LENGTH))
        shape = occ.Box((-SIDE / 2, -SIDE / 2, low), (SIDE / 2, SIDE / 2, high))
        (shape.faces.Max(occ.Z) if sign > 0 else shape.faces.Min(occ.Z)).name = "end"
        fem = ep.fe_model(shape, material, maxh=maxh)
        part = ep.Partition.ball(fem, (0, 0, 0), SIDE)
        part |= ep.Partition.interface(fem, "end", "end", kind="averaged")
        found.append(ep.reduce(fem, part, f_cut=BAR_F_CUT))
    return found


def stack(materials):
    """Upper bar on lower bar, with markers of their outer faces."""
    mbs = exu.SystemContainer().AddSystem()
    upper, lower = (ep.CreatePartitionBody(mbs, body) for body in bars(materials))
    contact = ep.CreatePartitionContact(mbs, upper, lower)
    return mbs, (upper, lower), contact, [item.CreateInterfaceMarker(mbs, "end") for item in (upper, lower)]


def clamped():
    """Force of the stack, whose outer faces are moved together."""
    materials = (ep.STEEL, ep.ALUMINIUM)
    mbs, _, contact, ends = stack(materials)
    ground = mbs.CreateGround()
    for end, height, travel in zip(ends, (LENGTH, -LENGTH), (TRAVEL, 0.0), strict=True):
        place = np.eye(4)
        place[2, 3] = height
        fixed = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground, localHT=place))
        joint = items.GenericJoint(markerNumbers=[fixed, end])
        joint.offsetUserFunction = lambda mbs, t, i, parameters, way=travel: [0, 0, -way * t, 0, 0, 0]
        mbs.AddObject(joint)
    mbs.Assemble()
    result = ep.solve_static(mbs, load_steps=5)
    yields = sum(LENGTH / (material.E * SIDE**2) for material in materials)
    force, expected = contact.force(result), TRAVEL * result.t / yields
    return {
        "force_N": force[-1],
        "expected_N": expected[-1],
        "online_s": result.time_s,
        "errors": {"stack": abs(force[1:] / expected[1:] - 1).max()},
    }


def frequencies():
    """Longitudinal frequencies of two bars that are pressed together at their outer faces, and held softly."""
    mbs, pair, contact, ends = stack((UNIFORM, UNIFORM))
    for item, end, sign in zip(pair, ends, (-1, 1), strict=True):
        spring(mbs, item, [1e5, 1e5, 1e4, 1e2, 1e2, 1e2])
        mbs.AddLoad(items.LoadForceVector(markerNumber=end, loadVector=[0, 0, sign * PRELOAD]))
    mbs.Assemble()
    result = ep.solve_static(mbs, load_steps=5, update_initial=True)
    found, modes = mbs.ComputeODE2Eigenvalues(convert2Frequencies=True)
    head = pair[0].body.interface_rows("end")[2] @ np.asarray(modes)[: pair[0].body.n_dofs]
    mass = sum(item.body.total_mass for item in pair)
    expected = (1 + np.arange(MODES)) * UNIFORM.bar_wave_speed / (4 * LENGTH)
    # The end of a bar moves by sqrt(2 / mass) in its longitudinal modes, and does not in others; rigid motion is slow.
    axial = (head**2 * mass / 2 > 0.5) & (np.asarray(found) > 0.5 * expected[0])
    own = np.asarray(found)[axial][:MODES]
    return {
        "preload_N": contact.force(result)[-1],
        "closed_rows": int(contact.closed_rows(result)[-1]),
        "rows": contact.n_rows,
        "found_Hz": list(own),
        "expected_Hz": list(expected),
        "online_s": result.time_s,
        "errors": {"frequencies": abs(own / expected - 1).max()},
    }


def draw(pressed):
    path, (figure, axes) = scenes.figure(__file__)
    curves = {key: np.array(values) for key, values in pressed["curves"].items()}
    axes.plot(1e6 * curves["approach_m"], curves["series_N"], label="whole elastic spheres")
    axes.plot(1e6 * curves["approach_m"], curves["force_N"], "k.", label="solve_static")
    axes.set(xlabel="approach [µm]", ylabel="force [N]", title="two steel spheres of 20 mm, pressed")
    axes.legend()
    figure.savefig(path, dpi=150)


def main():
    begin = time.perf_counter()
    parts = {"spheres": spheres(), "stack": clamped(), "frequencies": frequencies()}
    draw(parts["spheres"])
    found = {key: float(error) for part in parts.values() for key, error in part.pop("errors").items()}
    for key, error in found.items():
        print(f"{key:12} {error:.2e}, limit {LIMITS[key]:g}")
    failed = [key for key, error in found.items() if not abs(error) <= LIMITS[key]]
    result = {**parts, "found": found, "limits": LIMITS, "time_s": time.perf_counter() - begin}
    scenes.finish(__file__, result, failed)


if __name__ == "__main__":
    main()
