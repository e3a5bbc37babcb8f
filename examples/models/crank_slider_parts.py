"""The parts of the crank slider: dimensions, motion as rigid bodies, FE models and partitions of link and blocks.

The paper gives crank, speed, spring and damper, shapes and duration. Lengths, sections and the place of block 4 are
reconstructed, because Table 4 is missing in our copy of the paper (crank angle at first contact: 150 degrees).

What to learn here: faces that get a name in the shape become interfaces of the partition, where joints are attached. A
body with interfaces may also have an impact region.
"""

import math
from dataclasses import dataclass

import netgen.occ as occ
import numpy as np

import exudyn_partition as ep

CRANK, CRANK_MASS, SPEED = 0.150, 0.234, 10 * math.pi  # [m], [kg], [rad/s]
LINK, WIDTH, THICKNESS = 0.300, 0.020, 0.010  # [m]
RADIUS, LENGTHS = 0.010, (0.071, 0.058)  # of the blocks 3 and 4 and their heads [m]
STIFFNESS, DAMPING = 1e5, 1e3  # of the spring-damper [N/m], [N s/m]
CONTACT_ANGLE = math.radians(150)  # of the crank from the inner dead centre
TURN = 2 * math.pi / SPEED  # [s]
STEEL = ep.Material(E=210e9, nu=0.3, rho=7800.0)
LINK_SIZE = 8e-3  # of its elements [m]
# Element size at the head, radius of this region, element size elsewhere [m]. About 11000 nodes,
# as many as the paper's blocks have.
FULL_MESH, QUICK_MESH = (0.22e-3, 1.1e-3, 4e-3), (0.3e-3, 1.2e-3, 6e-3)
PAPER_MESH = 0.4e-3, 1e-3, 4e-3  # about 150 nodes in each impact region


def slider(angle):
    """Place of the slider [m] and its derivative by the crank's angle, from the inner dead centre."""
    root = np.sqrt(LINK**2 - (CRANK * np.sin(angle)) ** 2)
    return root - CRANK * np.cos(angle), CRANK * np.sin(angle) * (1 - CRANK * np.cos(angle) / root)


@dataclass
class Start:
    """Where all parts are with the crank at `angle` [rad], and how they move as rigid bodies.

    Block 4 stands where block 3 reaches it with the crank at `contact_angle` [rad].
    """

    angle: float
    contact_angle: float = CONTACT_ANGLE

    def __post_init__(self):
        self.pin = -CRANK * np.array([math.cos(self.angle), math.sin(self.angle), 0.0])
        self.place, rate = slider(self.angle)
        self.speed = SPEED * rate  # of block 3
        self.heads = self.place + LENGTHS[0], slider(self.contact_angle)[0] + LENGTHS[0]
        arm = np.array([self.place, 0, 0]) - self.pin
        self.centre, c, s = self.pin + arm / 2, arm[0] / LINK, arm[1] / LINK
        self.axes = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])  # of the link
        self.turning = np.array([0, 0, SPEED * CRANK * math.cos(self.angle) / arm[0]])
        self.velocity = np.cross([0, 0, SPEED], self.pin) + np.cross(self.turning, arm / 2)


def block_shape(number):
    """Shape of block 3 or 4: head at the origin, towards the other block; the face at its back has a name."""
    side, length = (1, LENGTHS[0]) if number == 3 else (-1, LENGTHS[1])
    centre = occ.Pnt(-side * RADIUS, 0, 0)
    shape = occ.Cylinder(centre, occ.Vec(-side, 0, 0), r=RADIUS, h=length - RADIUS) + occ.Sphere(centre, RADIUS)
    (shape.faces.Min(occ.X) if number == 3 else shape.faces.Max(occ.X)).name = "back"
    return shape


def block(number, h, region, maxh):
    """FE model and partition of block 3 or 4, with an interface at its back."""
    refined = [ep.Refine((0, 0, 0), region, h)]
    fem = ep.fe_model(block_shape(number), STEEL, maxh=maxh, refine=refined, grading=0.5)
    head = ep.Partition.ball(fem, (0, 0, 0), region, direction=(1 if number == 3 else -1, 0, 0))
    return fem, head | ep.Partition.interface(fem, "back", "back", kind="averaged")


def link_shape():
    """Shape of the link, along x about the origin; the faces at its pins have names."""
    half = np.array([LINK, WIDTH, THICKNESS]) / 2
    shape = occ.Box(occ.Pnt(*-half), occ.Pnt(*half))
    shape.faces.Min(occ.X).name, shape.faces.Max(occ.X).name = "crank pin", "slider pin"
    return shape


def link():
    """FE model and partition of the link, with interfaces for its two pins."""
    fem = ep.fe_model(link_shape(), STEEL, maxh=LINK_SIZE)
    pins = [ep.Partition.interface(fem, name, name, kind="averaged") for name in ("crank pin", "slider pin")]
    return fem, pins[0] | pins[1]
