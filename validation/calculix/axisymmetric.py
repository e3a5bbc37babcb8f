"""Decks of a ball that falls on a round plate for CalculiX, of quadrilaterals with eight nodes (CAX8R)."""

import numpy as np

from validation.calculix import deck

SECTORS = 180  # CalculiX makes elements of 2 degrees of them, whose forces it prints
PUSH = 1e-9  # s, in which the ball gets its velocity: initial velocities of such elements are not heard
ARC = np.pi / 4  # of the ball's surface that one side of its mesh has
COARSEST = 0.15, 0.08, 0.8e-3  # spacing along the ball's arc [rad], up the ball (of its diameter), in the plate [m]


def graded(length, h, flat, growth, most):
    """Places from 0 to a length: h apart up to `flat`, then further and further, at most `most`."""
    places, step = [0.0], h
    while places[-1] < length:
        if places[-1] >= flat:
            step = min(step * growth, most)
        places.append(places[-1] + step)
    s = np.array(places)
    return np.where(s > flat, flat + (s - flat) * (length - flat) / (s[-1] - flat), s)


def grid(place, s, t):
    """Nodes, (n, 2) [m], elements, (m, 8), and their number along t, of a grid that `place` maps."""
    S, T = np.meshgrid(*(np.interp(np.arange(2 * len(x) - 1) / 2, np.arange(len(x)), x) for x in (s, t)), indexing="ij")
    kept = np.ones(S.shape, dtype=bool)
    kept[1::2, 1::2] = False  # the middle of an element is no node
    number = np.cumsum(kept).reshape(S.shape) - 1
    i, j = (x.ravel() for x in np.mgrid[0 : S.shape[0] - 1 : 2, 0 : S.shape[1] - 1 : 2])
    around = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1))
    return place(S, T)[kept], np.stack([number[i + a, j + b] for a, b in around], axis=1), j // 2


def in_ball(radius):
    """Map of a grid, angles 0 to `ARC` and 0 to 1, to half a disc that touches the origin from above."""

    def arc(angle):
        angle = np.asarray(angle)
        return np.stack([radius * np.sin(angle), radius - radius * np.cos(angle)], axis=-1)

    def place(S, T):
        bottom, top = arc(S), arc(np.pi - S)
        axis, right = np.stack([0 * T, 2 * radius * T], axis=-1), arc(ARC + (np.pi - 2 * ARC) * T)
        s, t = (S / ARC)[..., None], T[..., None]
        corners = (1 - s) * (1 - t) * arc(0.0) + s * (1 - t) * arc(ARC)
        corners = corners + (1 - s) * t * arc(np.pi) + s * t * arc(np.pi - ARC)
        return (1 - t) * bottom + t * top + (1 - s) * axis + s * right - corners

    return place


def impact_input(materials, sizes, speed, pair, a, elements, growth, end_time, steps, alpha=deck.ALPHA):
    """Input of a ball that falls on a free round plate.

    Parameters
    ----------
    materials : two Material
        Of ball and plate.
    sizes : tuple of float
        Radius of the ball, radius and thickness of the plate [m].
    speed : float
        Of the ball [m/s].
    pair : deck.Pair
    a : float
        Largest contact radius [m].
    elements : float
        In the contact radius.
    growth : float
        Of the spacing from element to element, outside the contact.
    end_time : float
        [s]
    steps : int
    """
    radius, width, thickness = sizes
    h, (turn, up, far) = a / elements, COARSEST
    ball, cells, level = grid(
        in_ball(radius),
        graded(ARC, h / radius, 1.5 * a / radius, growth, turn),
        graded(1.0, h / (2 * radius), a / (2 * radius), growth, up),
    )
    depth = graded(thickness, h, 1.6 * a, growth, far)
    plate, others, height = grid(
        lambda S, T: np.stack([S, T], axis=-1), graded(width, h, 1.6 * a, growth, far), -depth[::-1]
    )
    under = np.flatnonzero((level == 0) & (ball[cells[:, 0], 0] < 2.5 * a))
    upon = np.flatnonzero((height == height.max()) & (plate[others[:, 0], 0] < 3.25 * a))
    points, n = np.vstack([ball + np.array([0, speed * PUSH / 2]), plate]), len(ball)
    on_axis = np.flatnonzero(abs(points[:, 0]) < 1e-12) + 1
    times = (PUSH, PUSH, 0.0), (end_time, end_time / steps, alpha)
    begin, go_on = (deck.dynamic_cards(*each, option=", NLGEOM=NO") for each in times)
    lines = [
        *deck.node_cards(np.column_stack([points, np.zeros(len(points))])),
        *deck.element_cards("CAX8R", 1, cells + 1, 0),
        *deck.element_cards("CAX8R", 2, others + n + 1, len(cells)),
        "*SURFACE, NAME=S1, TYPE=ELEMENT",
        *(f"{cell + 1}, S1" for cell in under),
        "*SURFACE, NAME=S2, TYPE=ELEMENT",
        *(f"{len(cells) + cell + 1}, S3" for cell in upon),
        "*BOUNDARY",
        *(f"{node}, 1, 1" for node in on_axis),
        *(line for number, material in enumerate(materials, 1) for line in deck.material_cards(number, material)),
        *pair.cards(),
        *begin, "*DLOAD", f"B1, GRAV, {speed / PUSH:.12g}, 0., -1., 0.", "*END STEP",
        *go_on, "*DLOAD, OP=NEW", *deck.FORCE, "*END STEP",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"
