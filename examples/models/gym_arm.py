"""A flexible arm on a hinge, whose nose hits an anvil, as an environment of gymnasium (`pip install ".[learning]"`)."""

import warnings

import exudyn as exu
import exudyn.itemInterface as items
import gymnasium
import netgen.occ as occ
import numpy as np

import exudyn_partition as ep

LENGTH, RADIUS = 0.2, 0.02  # of the arm, of its nose [m]
NOSE = np.array([LENGTH - RADIUS, -RADIUS, 0.0])  # where it hits [m]
GAP, TORQUE, CONTROL, MOST = 0.5e-3, 6.0, 1e-3, 20  # [m], largest [N m], time of an action [s], actions at most
TARGET = 1500.0  # force of the blow [N]


def arm(quick):
    """FE model and body: a bar with a round nose, which hangs on the face root."""
    bar = occ.Box((0, -0.01, -0.01), (NOSE[0], 0.01, 0.01)) + occ.Sphere((NOSE[0], 0, 0), RADIUS)
    bar.faces.Min(occ.X).name = "root"
    fem = ep.fe_model(bar, ep.STEEL, maxh=12e-3, refine=[ep.Refine(NOSE, 0.8e-3, 0.4e-3 if quick else 0.25e-3)])
    part = ep.Partition.ball(fem, NOSE, 1.2e-3) | ep.Partition.interface(fem, "root", nodes="root")
    return fem, ep.reduce(fem, part, f_cut=6e3)


def inertia(fem):
    """Moment of inertia about the hinge [kg m2]."""
    return fem.inertia_tensor[2, 2] + fem.total_mass * fem.centre_of_mass[0] ** 2


class HittingArm(gymnasium.Env):
    """Observation: angle [rad], its rate [rad/s], and the largest force on the anvil so far, by the target.

    An episode ends when the arm has hit and left. Its reward is minus the miss, by the target.
    """

    def __init__(self, fem, body):
        self.body, self.inertia = body, inertia(fem)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)  # by TORQUE
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (3,), np.float32)

    def reset(self, *, seed=None, options=None):
        """Build the model anew, with a gap that differs a little each time."""
        super().reset(seed=seed)
        self.mbs, self.run, self.peak = exu.SystemContainer().AddSystem(), None, 0.0
        self.arm = ep.CreatePartitionBody(self.mbs, self.body, name="arm", frame="floating", damping=0.02)
        root = self.arm.CreateInterfaceMarker(self.mbs, "root")
        ground = self.mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=self.mbs.CreateGround()))
        self.mbs.AddObject(items.ObjectJointRevoluteZ(markerNumbers=[ground, root]))
        self.torque = self.mbs.AddLoad(items.LoadTorqueVector(markerNumber=root, loadVector=[0, 0, 0]))
        anvil = ep.RigidPlane(NOSE - [0, GAP * self.np_random.uniform(0.95, 1.05), 0], normal=(0, 1, 0))
        self.contact = ep.CreatePartitionContact(self.mbs, self.arm, anvil, name="blow")
        self.mbs.Assemble()
        return np.zeros(3, np.float32), {}

    def step(self, action):
        """One action: the run goes on for CONTROL."""
        self.mbs.SetLoadParameter(self.torque, "loadVector", [0, 0, TORQUE * float(action[0])])
        end = CONTROL + (0.0 if self.run is None else self.run.t[-1])
        how = {"method": "implicit", "step": 5e-6, "spectral_radius": 0.9, "progress": lambda share: None}
        with warnings.catch_warnings():  # an action that ends within a blow sees only its first steps
            warnings.filterwarnings("ignore", "contact 'blow' .* is over within", ep.errors.ModelLimitWarning)
            self.run = ep.solve_dynamic(self.mbs, end_time=end, go_on=self.run is not None, **how)
        force = self.contact.force(self.run)
        self.peak = max(self.peak, force.max() / TARGET)
        angle = self.arm.rigid_motion(self.arm.coordinates(self.run))[-1, 5]
        rate = self.arm.angular_momentum(self.run)[-1, 2] / self.inertia
        left = bool(self.peak and not force[-1])
        reward = -abs(self.peak - 1.0) if left else 0.0
        return np.array([angle, rate, self.peak], np.float32), reward, left, end > (MOST - 0.5) * CONTROL, {}
