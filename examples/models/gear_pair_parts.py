"""Spur gears with involute teeth: their profile, mesh, and partition with flanks as contact patch.

What to learn here: one formula has the involute and the fillet at its root, what a rack cuts that rolls along the gear.
The mesh is that of a thin gear, which is then stretched: its elements are longer along the teeth than across.
"""

from dataclasses import dataclass

import netgen.occ as occ
import ngsolve as ngs
import numpy as np

import exudyn_partition as ep

MODULE, ANGLE, WIDTH, BACKLASH = 4e-3, np.radians(20), 8e-3, 60e-6  # [m], of pressure, [m], at the pitch circle [m]
ADDENDUM, DEDENDUM, TOOL_TIP = MODULE, 1.25 * MODULE, 0.38 * MODULE  # of the rack; the last is a radius
RELIEF, RELIEVED = 25e-6, 0.3 * MODULE  # what is taken off the flanks at their tips, and how far down the rack [m]
STRETCH = 4.0  # length of elements along the teeth by that across
FLANKS = [f"upper {tooth}" for tooth in (-2, -1, 0, 1)] + [f"lower {tooth}" for tooth in (-1, 0, 1)]  # that may touch
F_CUT = 20e3  # [Hz]


@dataclass(frozen=True)
class Gear:
    """A spur gear. The gap at angle 0 lies between the teeth -1 and 0; their numbers grow with their angle."""

    teeth: int
    bore: float  # radius [m]

    @property
    def pitch(self):
        """Radius of the pitch circle [m]."""
        return MODULE * self.teeth / 2

    @property
    def base(self):
        """Radius of the base circle [m]; normals of the flanks are its tangents."""
        return self.pitch * np.cos(ANGLE)

    @property
    def tip(self):
        """Radius of the tip circle [m]."""
        return self.pitch + ADDENDUM

    def _cut(self, x, y, normal):
        """Points of the gap, x + iy [m], that points of a rack cut when their normals pass through the pitch point."""
        way = x + y / np.tan(normal)  # of the gear, which rolls along the rack
        return (x - way + 1j * (y + self.pitch)) * np.exp(-1j * (np.pi / 2 + way / self.pitch))

    def flank(self, n=30):
        """The upper flank of tooth -1, an involute relieved at its tip, from its fillet upward, (n,) complex [m]."""
        square = np.sin(ANGLE) ** 2
        top = square * (np.sqrt(self.pitch**2 + (self.tip**2 - self.pitch**2) / square) - self.pitch)
        y = np.linspace(TOOL_TIP * (1 - np.sin(ANGLE)) - DEDENDUM, top, n)
        involute = self._cut(MODULE * np.pi / 4 + BACKLASH / 4 + y * np.tan(ANGLE), y, ANGLE)
        relief = RELIEF * np.maximum(1 - (y[-1] - y) / RELIEVED, 0) ** 2
        return involute * np.exp(-1j * relief / self.base)

    def fillet(self, n=12):
        """The fillet below that flank, from the root circle, (n,) complex [m]."""
        normal, y = np.linspace(np.pi / 2, ANGLE, n), TOOL_TIP - DEDENDUM
        x = MODULE * np.pi / 4 + BACKLASH / 4 + y * np.tan(ANGLE) - TOOL_TIP / np.cos(ANGLE)
        return self._cut(x + TOOL_TIP * np.cos(normal), y - TOOL_TIP * np.sin(normal), normal)

    def shape(self, width, flanks, fine):
        """OCC shape of a width [m], with elements of size `fine` on some flanks, such as "upper 0", "lower -1" [m]."""
        edges, names, pitch = [], [], 2 * np.pi / self.teeth
        for tooth in range(-(self.teeth // 2), self.teeth - self.teeth // 2):
            before, after = np.exp(1j * pitch * tooth), np.exp(1j * pitch * (tooth + 1))
            gap = np.concatenate([self.fillet()[::-1], self.fillet().conj()]) * before
            lower, upper = self.flank().conj() * before, self.flank()[::-1] * after
            top = [lower[-1], self.tip * before * np.exp(0.5j * pitch), upper[0]]
            splines = [occ.SplineInterpolation(_points(places, width)) for places in (gap, lower, upper)]
            edges += [*splines[:2], occ.ArcOfCircle(*_points(top, width)), splines[2]]
            names += ["gap", f"lower {tooth}", "top", f"upper {tooth}"]
        outline = occ.Face(occ.Wire(edges))
        for edge, name in zip(outline.edges, names, strict=True):
            edge.name = name
        bore = occ.Cylinder(occ.Pnt(0, 0, -width), occ.Z, r=self.bore, h=2 * width)
        bore.faces.name = "bore"
        shape = outline.Extrude(width * occ.Z) - bore
        for face in shape.faces:
            if face.name in flanks:
                face.maxh = fine
        return shape


def _points(places, width):
    return [occ.Pnt(place.real, place.imag, -width / 2) for place in places]


def teeth_of(gear, points):
    """Tooth of each point of flanks, (n, 3) [m], and whether its flank is the upper one: two (n,) arrays."""
    place = np.arctan2(points[:, 1], points[:, 0]) * gear.teeth / (2 * np.pi)
    return np.floor(place).astype(int), place % 1 > 0.5


def play():
    """Way along the line of contact from amid the backlash until teeth touch [m]."""
    return BACKLASH * np.cos(ANGLE) / 2


def poses(gears, turn, way=0.0):
    """Angle [rad] and place [m] of both gears, after a turn of the pinion and its way to the teeth above it [m]."""
    pinion, wheel = gears
    angles = turn - np.pi / pinion.teeth + way / pinion.base, np.pi - turn * pinion.teeth / wheel.teeth
    return list(zip(angles, ([0, 0, 0], [pinion.pitch + wheel.pitch, 0, 0]), strict=True))


def gear_part(gear, fine, flanks=FLANKS, axes="normal", angle=0.0, **sizes):
    """FE model and partition of a gear turned by `angle` [rad]; `fine` [m] are its flanks; `sizes` are Netgen's."""
    geometry = occ.OCCGeometry(gear.shape(WIDTH / STRETCH, flanks, fine))
    mesh = ngs.Mesh(geometry.GenerateMesh(**sizes))
    mesh.Curve(2)
    stretch = ngs.GridFunction(ngs.VectorH1(mesh, order=2))
    cos, sin = np.cos(angle), np.sin(angle)
    stretch.Set(ngs.CF(((cos - 1) * ngs.x - sin * ngs.y, sin * ngs.x + (cos - 1) * ngs.y, (STRETCH - 1) * ngs.z)))
    mesh.SetDeformation(stretch)
    fem = ep.fe_model(mesh, ep.STEEL)
    return fem, ep.Partition.surface(fem, flanks, axes=axes) | ep.Partition.interface(fem, "bore", "bore")
