"""Hanging chains in other programs: what each does for eigenvalues, on the chains of `scale.py`.

A function builds a chain of rods of 1 m and 1 kg and returns a function of no arguments, which linearizes it and
returns its frequencies (rad/s). All of them describe the chain by its joint angles, so no constraints are left, and
give matrices, not eigenvalues: as R = 0 and K is symmetric, ``scipy.linalg.eigh(M, K)`` is fastest.
"""

import numpy as np

LENGTH, GRAVITY = 1.0, 9.81
MOMENTS = (1 / 12, 1 / 12, 0.00125)
"""Of a rod about its centre (kg m²)."""

STEP = 1e-6
"""Of the angles (rad), where a program takes differences."""

AXES = {"rods": "y", "universal": "xy"}
"""The hinges of each joint, from above."""


def frequencies(M, R, K):
    """Return the frequencies of M ä + R ȧ + K a = 0 (rad/s) of joint angles a, ascending."""
    import scipy.linalg

    assert np.max(np.abs(R)) <= 1e-9 * np.max(np.abs(K)), "damping of a chain that has none"
    # The slowest modes lose most digits; of the two orders this one keeps more of them.
    return 1.0 / np.sqrt(scipy.linalg.eigh((M + M.T) / 2, (K + K.T) / 2, eigvals_only=True)[::-1])


def pinocchio(axes, count):
    """Derivatives of the recursive Newton-Euler algorithm."""
    import pinocchio as pin

    hinges = {"x": pin.JointModelRX, "y": pin.JointModelRY}
    inertia = pin.Inertia(1.0, np.array([0.0, 0.0, -LENGTH / 2]), np.diag(MOMENTS))
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
    joint, place = 0, pin.SE3.Identity()
    for i in range(count):
        for axis in axes:
            joint = model.addJoint(joint, hinges[axis](), place, f"{axis}{i}")
            place = pin.SE3.Identity()
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, -LENGTH]))
    data = model.createData()

    def solved():
        zero = np.zeros(model.nv)
        K, R, _ = pin.computeRNEADerivatives(model, data, zero, zero, zero)
        upper = np.triu(pin.crba(model, data, zero))
        return frequencies(upper + np.triu(upper, 1).T, R, K)

    return solved


def mujoco(axes, count):
    """Differences of the inverse dynamics."""
    import mujoco as mj

    vectors = {"x": "1 0 0", "y": "0 1 0"}
    hinges = "".join(f'<joint type="hinge" axis="{vectors[axis]}"/>' for axis in axes)
    moments = " ".join(map(repr, MOMENTS))
    body = f'{hinges}<inertial pos="0 0 {-LENGTH / 2}" mass="1" diaginertia="{moments}"/>'
    text = "".join(f'<body pos="0 0 {-LENGTH if i else 0}">{body}' for i in range(count)) + "</body>" * count
    option = f'<option gravity="0 0 {-GRAVITY}"/>'
    model = mj.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{text}</worldbody></mujoco>")
    data = mj.MjData(model)

    def solved():
        n = model.nv
        K, R, M = np.zeros((3, n, n))
        mj.mj_forward(model, data)
        data.qacc[:] = 0.0
        mj.mjd_inverseFD(model, data, STEP, False, K, R, M, None, None, None, None)
        return frequencies(M, R, K)  # transposed, but they are symmetric

    return solved


def pydrake(axes, count):
    """Inverse dynamics with automatic differentiation."""
    from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, InitializeAutoDiff
    from pydrake.math import RigidTransform
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import (
        FixedOffsetFrame,
        MultibodyForces_,
        RevoluteJoint,
        SpatialInertia,
        UnitInertia,
    )

    vectors = {"x": [1.0, 0.0, 0.0], "y": [0.0, 1.0, 0.0]}
    plant = MultibodyPlant(time_step=0.0)
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -GRAVITY])
    center = np.array([0.0, 0.0, -LENGTH / 2])
    inertia = SpatialInertia(1.0, center, UnitInertia(*MOMENTS).ShiftFromCenterOfMass(-center))
    above, place = plant.world_body(), RigidTransform()
    for i in range(count):
        for axis in axes:
            last = axis == axes[-1]
            body = plant.AddRigidBody(f"{axis}{i}", inertia if last else SpatialInertia.Zero())
            upper = plant.AddFrame(FixedOffsetFrame(f"end_{axis}{i}", above.body_frame(), place))
            plant.AddJoint(RevoluteJoint(f"hinge_{axis}{i}", upper, body.body_frame(), vectors[axis]))
            above, place = body, RigidTransform()
        place = RigidTransform([0.0, 0.0, -LENGTH])
    plant.Finalize()

    def solved():
        n = plant.num_velocities()
        context = plant.CreateDefaultContext()
        M = plant.CalcMassMatrix(context)
        dual = plant.ToAutoDiffXd()
        there = dual.CreateDefaultContext()
        x = InitializeAutoDiff(np.zeros(2 * n))
        dual.SetPositionsAndVelocities(there, x)
        forces = MultibodyForces_[AutoDiffXd](plant=dual)
        dual.CalcForceElementsContribution(there, forces)
        tau = dual.CalcInverseDynamics(there, 0.0 * x[:n], forces)
        slopes = ExtractGradient(tau)
        return frequencies(M, slopes[:, n:], slopes[:, :n])

    return solved


def exudyn(axes, count):
    """Its kinematic tree, linearized by differences."""
    import exudyn as exu
    from exudyn.itemInterface import NodeGenericODE2, ObjectKinematicTree

    kinds = {"x": exu.JointType.RevoluteX, "y": exu.JointType.RevoluteY}
    n = count * len(axes)
    offsets, centers, turns = exu.Vector3DList(), exu.Vector3DList(), exu.Matrix3DList()
    moments, masses = exu.Matrix3DList(), []
    for i in range(count):
        for axis in axes:
            first, last = axis == axes[0], axis == axes[-1]
            turns.Append(np.eye(3))
            offsets.Append([0.0, 0.0, -LENGTH if i and first else 0.0])
            centers.Append([0.0, 0.0, -LENGTH / 2 if last else 0.0])
            moments.Append(np.diag(MOMENTS) if last else np.zeros((3, 3)))
            masses.append(1.0 if last else 0.0)
    system = exu.SystemContainer()
    mbs = system.AddSystem()
    zero = [0.0] * n
    node = mbs.AddNode(
        NodeGenericODE2(
            referenceCoordinates=zero, initialCoordinates=zero, initialCoordinates_t=zero, numberOfODE2Coordinates=n
        )
    )
    mbs.AddObject(
        ObjectKinematicTree(
            nodeNumber=node,
            jointTypes=[kinds[axis] for axis in axes] * count,
            linkParents=list(range(-1, n - 1)),
            jointTransformations=turns,
            jointOffsets=offsets,
            linkInertiasCOM=moments,
            linkCOMs=centers,
            linkMasses=masses,
            gravity=[0.0, 0.0, -GRAVITY],
        )
    )
    mbs.Assemble()

    def solved():
        M, K, R = mbs.ComputeLinearizedSystem()
        return frequencies(M, R, K)

    return solved


PEERS = {"exudyn": exudyn, "pinocchio": pinocchio, "mujoco": mujoco, "pydrake": pydrake}
"""By the names of their modules."""
