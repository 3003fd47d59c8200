"""PyBullet is touched here and by the pictures, in workers only: it holds the interpreter's lock while it computes."""

import re
import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from sim.arm_model import ArmModel, Floats
from sim.drivers.pybullet.suppress_output import silent
from sim.planning.kinematics import kinematics

with silent():
    import pybullet

POSITION_GAIN, VELOCITY_GAIN = 0.5, 1.0
AT_REST = 1e-4


def mesh_folder() -> Path:
    """Return the folder that the meshes of the arms' descriptions are in."""
    found = find_spec("pybullet_data")
    if found is None or found.origin is None:
        raise FileNotFoundError("the meshes of the arms come with pybullet, which is not installed")
    return Path(found.origin).parent


def load_arm(model: ArmModel, client: int) -> int:
    """Load an arm's description with a fixed base and return the body; raises what PyBullet raises."""
    folder = mesh_folder()
    text = re.sub(r'filename="([^"]+)"', lambda found: f'filename="{folder / found.group(1)}"', model.urdf)
    flags = pybullet.URDF_USE_INERTIA_FROM_FILE | pybullet.URDF_USE_IMPLICIT_CYLINDER
    with tempfile.TemporaryDirectory() as place:
        file = Path(place) / f"{model.name}.urdf"
        file.write_text(text, "utf-8")
        with silent():
            return pybullet.loadURDF(str(file), useFixedBase=True, flags=flags, physicsClientId=client)


class BulletWorld:
    """One arm in one PyBullet world of its own, without a window."""

    def __init__(self, model: ArmModel) -> None:
        self.model = model
        self.client = pybullet.connect(pybullet.DIRECT)
        pybullet.setGravity(0.0, 0.0, -9.81, physicsClientId=self.client)
        self.body = load_arm(model, self.client)
        count = pybullet.getNumJoints(self.body, physicsClientId=self.client)
        known = {
            info[1].decode(): info
            for info in (pybullet.getJointInfo(self.body, k, physicsClientId=self.client) for k in range(count))
        }
        # What moves beside the chain to the tip, a gripper's fingers say, stays where it is.
        moving = [known[joint.name] for joint in kinematics(model).joints if joint.axis is not None]
        self.joints = [info[0] for info in moving]
        self.forces = [info[10] for info in moving]
        self._gains = [POSITION_GAIN] * len(moving), [VELOCITY_GAIN] * len(moving)
        for link in range(-1, count):
            pybullet.changeDynamics(
                self.body, link, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0, physicsClientId=self.client
            )
        self.place(np.array(model.home))
        self._fresh = pybullet.saveState(physicsClientId=self.client)

    def place(self, joints: Floats) -> None:
        """Put the arm somewhere, at rest. Bullet would accept any number here: limits are checked before."""
        if not np.isfinite(joints).all():
            raise ValueError("joints hold NaN or infinity")
        for index, value in zip(self.joints, joints, strict=True):
            pybullet.resetJointState(self.body, index, float(value), 0.0, physicsClientId=self.client)

    def begin(self, joints: Floats, dt: float) -> None:
        """Make ready for a run from joints (dof,): the same state, bit for bit, whatever was run before."""
        pybullet.restoreState(self._fresh, physicsClientId=self.client)
        self.place(joints)
        pybullet.setTimeStep(dt, physicsClientId=self.client)

    def step(self, start: Floats, end: Floats, dt: float) -> None:
        """Simulate one tick in which the joints are to go from ``start`` to ``end``.

        Bullet's motor adds the velocity wanted to a share of the position error at the tick's start. So it gets where
        the arm should be then, not where it should be afterwards: the usual form runs ahead by one tick.
        """
        pybullet.setJointMotorControlArray(
            self.body,
            self.joints,
            pybullet.POSITION_CONTROL,
            targetPositions=start,
            targetVelocities=(end - start) / dt,
            positionGains=self._gains[0],
            velocityGains=self._gains[1],
            forces=self.forces,
            physicsClientId=self.client,
        )
        pybullet.stepSimulation(physicsClientId=self.client)

    def measure(self) -> tuple[Floats, Floats]:
        """Return joint positions and velocities (dof,)."""
        states = pybullet.getJointStates(self.body, self.joints, physicsClientId=self.client)
        return np.array([state[0] for state in states]), np.array([state[1] for state in states])

    def tip(self) -> Floats:
        """Return where Bullet itself says the nozzle tip is (3,): the second opinion on our kinematics."""
        count = pybullet.getNumJoints(self.body, physicsClientId=self.client)
        names = [
            pybullet.getJointInfo(self.body, index, physicsClientId=self.client)[12].decode() for index in range(count)
        ]
        link = names.index(kinematics(self.model).joints[-1].child)
        state = pybullet.getLinkState(self.body, link, computeForwardKinematics=1, physicsClientId=self.client)
        return np.array(state[4])

    def close(self) -> None:
        """Let go of the world: worlds left open are never refused and fill the memory."""
        pybullet.disconnect(physicsClientId=self.client)
