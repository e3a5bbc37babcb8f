"""Flexibility of equal squares on the surface of an elastic half-space, by the integrals of Love and Cerruti.

K.L. Johnson, Contact Mechanics, 1985, sections 3.2 to 3.6: displacements by a point force, integrated over a square.
"""

import numpy as np


def half_space(centers, side, shear, nu, coupled=True):
    """Displacements of the centres by uniform tractions on the squares, (3n, 3n) [m/N].

    Parameters
    ----------
    centers : (n, 2) array
        Centres of the squares [m].
    side : float
        Of the squares, which are parallel to the axes [m].
    shear, nu : float
        Shear modulus [Pa] and Poisson's ratio.
    coupled : bool
        Whether normal forces move the surface sideways, and the reverse. Between two equal bodies they do not.

    Returns
    -------
    (3n, 3n) array
        Each square has a normal, then two tangents. The normal points out of the half-space, forces push into it.
    """
    dx, dy = (centers[:, None, k] - centers[None, :, k] for k in (0, 1))
    xx, yy, xy, x1, y1 = np.zeros((5, *dx.shape))  # integrals of x^2/r^3, y^2/r^3, xy/r^3, x/r^2, y/r^2
    for sx in (1, -1):
        for sy in (1, -1):
            x, y, sign = dx + sx * side / 2, dy + sy * side / 2, sx * sy
            r = np.hypot(x, y)
            xx += sign * y * np.log(x + r)
            yy += sign * x * np.log(y + r)
            xy -= sign * r
            x1 += sign * (x * np.arctan(y / x) + y * np.log(r))
            y1 += sign * (y * np.arctan(x / y) + x * np.log(r))
    F = np.zeros((len(centers), 3, len(centers), 3))
    F[:, 0, :, 0] = (1 - nu) * (xx + yy)
    F[:, 1, :, 1] = xx + (1 - nu) * yy
    F[:, 2, :, 2] = (1 - nu) * xx + yy
    F[:, 1, :, 2] = F[:, 2, :, 1] = nu * xy
    if coupled:
        for k, integral in ((1, x1), (2, y1)):
            F[:, 0, :, k] = (0.5 - nu) * integral
            F[:, k, :, 0] = -F[:, 0, :, k]
    F /= 2 * np.pi * shear * side**2
    return F.reshape(3 * len(centers), -1)


def grid(n, side):
    """Centres of n x n squares around the origin, (n n, 2) [m]."""
    line = side * (np.arange(n) - (n - 1) / 2)
    return np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
