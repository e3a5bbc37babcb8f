"""The parts of cam and follower: shapes, meshes, partitions with contact patches of whole faces, and the drive.

What to learn here: `Partition.surface` makes the whole rim of the cam, and the whole face of the follower, a contact
patch. The size of the elements there decides how smoothly contact wanders.
"""

from dataclasses import dataclass

import netgen.occ as occ
import numpy as np

import exudyn_partition as ep

RADIUS, ECCENTRICITY, WIDTH, BORE = 0.020, 0.005, 0.004, 0.006  # of the cam [m]
FACE, DEPTH, HEIGHT = 0.024, 0.024, 0.080  # of the follower, along x, z and y [m]
F_CUT = 20e3  # [Hz]


@dataclass
class Drive:
    """The shaft's motion: from rest at angle `start` [rad] to `speed` [rad/s] within the time `ramp` [s]."""

    speed: float
    ramp: float
    start: float = -np.pi / 2
    turning: bool = False  # it stands still while the follower comes to rest

    def turn(self, t):
        """Angle since the start [rad], angular velocity [rad/s] and acceleration [rad/s2] at times t [s]."""
        share = np.pi * np.minimum(t, self.ramp) / self.ramp
        late = np.maximum(t - self.ramp, 0)
        angle = self.speed * ((share - np.sin(share)) * self.ramp / (2 * np.pi) + late)
        velocity = self.speed * (1 - np.cos(share)) / 2
        return angle, velocity, self.speed * np.pi / (2 * self.ramp) * np.sin(share)


def cam_part(rim, rest, axes="normal"):
    """FE model and partition of the cam, with elements of size `rim` on its rim and `rest` elsewhere [m]."""
    disc = occ.Cylinder(occ.Pnt(ECCENTRICITY, 0, -WIDTH / 2), occ.Z, r=RADIUS, h=WIDTH)
    for face in disc.faces:
        face.name = "rim" if abs(face.center.z) < WIDTH / 4 else "side"
    bore = occ.Cylinder(occ.Pnt(0, 0, -WIDTH), occ.Z, r=BORE, h=2 * WIDTH)
    bore.faces.name = "bore"
    shape = disc - bore
    for face in shape.faces:
        if face.name == "rim":
            face.maxh = rim
    fem = ep.fe_model(shape, ep.STEEL, maxh=rest)
    return fem, ep.Partition.surface(fem, "rim", axes=axes) | ep.Partition.interface(fem, "bore", "bore")


def follower_part(face_size, rest, axes="normal"):
    """FE model and partition of the follower, whose face is at y = 0."""
    shape = occ.Box(occ.Pnt(-FACE / 2, 0, -DEPTH / 2), occ.Pnt(FACE / 2, HEIGHT, DEPTH / 2))
    lower, upper = shape.faces.Min(occ.Y), shape.faces.Max(occ.Y)
    lower.name, lower.maxh, upper.name = "face", face_size, "back"
    fem = ep.fe_model(shape, ep.STEEL, maxh=rest)
    return fem, ep.Partition.surface(fem, "face", axes=axes) | ep.Partition.interface(fem, "back", "back")
