"""Compiled runs against Exudyn's, of bodies that rub while they turn, in the random scenes of `compiled_runs`.

With even seeds the upper body flies at a rigid plane, sphere, cylinder or bore, in a floating frame with a random spin
of some thousand rad/s, or in an inertial frame on a curved surface. With odd seeds it flies at the lower body, and one
of them or both spin in floating frames. There is friction, which falls as contact slips in every third scene, and the
upper body flies aside with up to 0.7 of its speed. Reference, quantities and limit are those of `compiled_runs`; of two
bodies the limit is 1e-8: where they nearly roll, friction is a tenth of the normal force, and has that one's rounding.

    python -m validation.stability.rubbing_runs [--count N] [--out FILE]
"""

from dataclasses import replace

import numpy as np

from validation.stability import compiled_runs

COUNT, LIMITS = 200, {"difference": 1e-9, "on each other": 1e-8}


def rubbing(number):
    """A scene with friction, and some motion aside."""
    scene, rng = compiled_runs.drawn(number), np.random.default_rng([number, 1])
    mu = float(rng.uniform(0.05, 0.6)) if scene.friction is None else scene.friction
    aside = np.linalg.norm(scene.velocity) * np.r_[rng.uniform(-0.7, 0.7, 2), 0.0]
    return replace(scene, friction=mu, velocity=tuple(np.add(scene.velocity, aside).tolist()))


def checked(seed):
    """The row of a seed."""
    number = seed // 2
    scene = rubbing(number)
    if seed % 2:
        return compiled_runs.row_of(seed, scene, compiled_runs.of_two_that_move(number, scene), " on each other")
    return compiled_runs.row_of(seed, scene, compiled_runs.on_surface(number, scene=scene), " on a rigid surface")


def main():
    given = compiled_runs.options(__doc__, COUNT)
    compiled_runs.compare(checked, given, __file__, LIMITS, lambda seed: "on each other" if seed % 2 else "difference")


if __name__ == "__main__":
    main()
