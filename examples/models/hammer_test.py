"""A bar that a steel head taps, measured modal data of such a bar, and spectra of what an accelerometer shows.

The data are those that the Showcase notebook of sdypy-EMA prints. It does not tell what its beam is: sizes are assumed.
"""

import exudyn as exu
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep

FREQUENCIES = np.array([177.0, 477.4, 933.1, 1535.5, 2286.9, 3162.4, 4181.2])  # [Hz]
RATIOS = np.array([0.0086, 0.0020, 0.0015, 0.0020, 0.0028, 0.0018, 0.0015])
LENGTH, WIDTH, HEIGHT, RHO = 0.600, 0.040, 0.012, 7850.0
GUESS = 190e9, 0.003  # modulus [Pa], and ratio of each mode
HIT, ACCELEROMETER = np.array([-0.29, 0.0, 0.0]), np.array([0.29, 0.0, 0.0])
BEGIN, WINDOW, DELAY = 2e-3, 25e-3, 5e-3  # of the windows [s]; half a turn of phase in DELAY is 100 Hz


def tapped(quick):
    """Model of the beam and the head that taps it, and the beam."""
    guess = ep.Material(E=GUESS[0], nu=0.3, rho=RHO)
    bar = occ.Box((-LENGTH / 2, -WIDTH / 2, -HEIGHT), (LENGTH / 2, WIDTH / 2, 0))
    head = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=0.010, h=0.040) * occ.Sphere((0, 0, 0.050), 0.050)
    bodies = []
    for shape, material, centre in ((bar, guess, HIT), (head, ep.STEEL, np.zeros(3))):
        fine = ep.Refine(centre, 0.8e-3, 0.4e-3 if quick else 0.2e-3)
        fem = ep.fe_model(shape, material, maxh=15e-3, refine=[fine], grading=0.6 if quick else 0.3)
        bodies.append(ep.reduce(fem, ep.Partition.ball(fem, centre, 0.9e-3), f_cut=7e3))
    mbs = exu.SystemContainer().AddSystem()
    beam = ep.CreatePartitionBody(mbs, bodies[0], name="beam", damping=GUESS[1])
    at = {"referencePosition": HIT + np.array([0, 0, 1e-7]), "initialVelocity": [0, 0, -0.05]}
    ep.CreatePartitionContact(mbs, ep.CreatePartitionBody(mbs, bodies[1], name="head", **at), beam)
    mbs.Assemble()
    return mbs, beam


def spectra():
    """Times, (m,), and weights of velocities there, (14, 2, m), that give spectra of the acceleration by parts."""
    u = (np.arange(1500) + 0.5) / 1500
    hann, slope = 1 - np.cos(2 * np.pi * u), 2 * np.pi / WINDOW * np.sin(2 * np.pi * u)
    window, slope = hann**2, 2 * hann * slope  # a mode hardly shows in the spectrum of another one
    times = BEGIN + np.r_[u * WINDOW, u * WINDOW + DELAY]
    weights = np.zeros((len(FREQUENCIES), 2, len(times)), dtype=complex)
    for mode, omega in enumerate(2 * np.pi * FREQUENCIES):
        for part in np.split(np.arange(len(times)), 2):
            wave = np.exp(-1j * omega * times[part]) / len(u)
            weights[mode, int(part[0] > 0), part] = (1j * omega * window - slope) * wave
    return times, np.concatenate([weights.real, weights.imag])
