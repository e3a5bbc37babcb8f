"""A rocker with a round nose and a bore, written to files as CAD and mesh programs write them, in millimetres.

What to learn here: a STEP file has a shape, which `ep.fe_model` meshes with the options that it is given. A mesh file
has elements already: they must be fine where contact happens, and nothing can be refined afterwards.
"""

import meshio
import netgen.occ as occ

import exudyn_partition as ep

MILLIMETRE = 1e-3


def shape():
    """The rocker in millimetres: its nose touches z = 0 at the origin, its arm points along x.

    The arm is not above the nose alone, so that the impact bends it, and it rings.
    """
    nose = occ.Cylinder(occ.Pnt(0, 0, 8), occ.Z, r=8, h=12) + occ.Sphere(occ.Pnt(0, 0, 8), 8)
    arm = occ.Box(occ.Pnt(-8, -8, 15), occ.Pnt(72, 8, 25))
    bore = occ.Cylinder(occ.Pnt(60, 0, 0), occ.Z, r=5, h=40)
    return nose + arm - bore


def mesh_options(at, h):
    """Options for Netgen's mesh of a STEP file: finer around the contact, with elements of size h [m] there."""
    return {"scale": MILLIMETRE, "maxh": 5e-3, "refine": [ep.Refine(at, radius=4 * h, h=h)]}


def write_rocker(folder, h):
    """Write the part as rocker.step and, meshed, as rocker.vtu, both in millimetres; returns the paths.

    The elements of the mesh have the size h [m] around the nose.
    """
    step, mesh = folder / "rocker.step", folder / "rocker.vtu"
    shape().WriteStep(str(step))
    fem = ep.fe_model(step, ep.STEEL, **mesh_options((0, 0, 0), h))
    # Any format of meshio works, such as Gmsh, Abaqus or Nastran. It counts in the unit of its writer, not in metres.
    cells = [(f"tetra{fem.cells.shape[1]}", fem.cells)]
    meshio.Mesh(fem.points / MILLIMETRE, cells).write(mesh)
    return [step, mesh]
