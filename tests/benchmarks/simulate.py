"""Ten seconds of four examples: how long until the end is known to 1e-6.

Against SciPy's DOP853 on equations that SymPy generates (Lagrange's, with constraints in index-1 form; accelerations
and multipliers from numpy.linalg.solve; no projections), and, for pendulum and top, against the generalized-alpha
method of Exudyn where that is installed (``pip install exudyn``). Each program runs with tolerances or steps that
shrink until the error at the end is below 1e-6: the least CPU time counts. Errors are differences of places (in the
size of the scene) and of entries of rotation matrices from a run of mbstab with the smallest tolerance.

Columns (CPU time, s): the integration by mbstab step by step, by its compiled steps (with the extra fast) and by SciPy,
each without the generation of equations, which stands beside it: everything else that follows the loading of the model
is counted. With the global error controlled (``tol=1e-6``: several runs, compiled, generation and all). Exudyn without
the set-up. Ratios: SciPy or Exudyn over mbstab step by step, and over its compiled steps.

Then 60 s of a top at 601 and at 60 001 output times, with controlled error: CPU time, evaluations, ratio of times.
"""

import math
import sys
import time
import warnings
from functools import partial
from importlib.util import find_spec

import numpy as np
import scipy.integrate
import sympy as sp

import mbstab
from mbstab.analysis.simulate.steppers import compiled as marching
from mbstab.compiler import fused

GOAL, END = 1e-6, 10.0
MOTIONS = {
    "pendulum": {"rod.theta": math.pi / 4},
    "top": {"top.theta": 0.3},
    "rolling_disk": {"disk.phi": 0.02, "rate(disk.theta)": 0.1},
    "governor": {"right_crank.psi": 0.2},
}
TOLERANCES = [10.0 ** -(0.5 * k) for k in range(4, 25)]
t = sp.Symbol("t")


# --- equations by SymPy ---------------------------------------------------------------------------------------------


def turn(axis, angle):
    c, s = sp.cos(angle), sp.sin(angle)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    A = sp.eye(3)
    A[j, j], A[j, k], A[k, j], A[k, k] = c, -s, s, c
    return A


class Body:
    """A rigid body in space with Euler angles about three axes, in the order given."""

    def __init__(self, name, sequence, mass, inertia, center=(0, 0, 0)):
        self.q = sp.symbols(" ".join(f"{name}_{x}" for x in ("x", "y", "z", "a", "b", "c")))
        self.u = sp.symbols(" ".join(f"{name}_{x}t" for x in ("x", "y", "z", "a", "b", "c")))
        self.sequence, self.mass, self.inertia = sequence, mass, sp.diag(*inertia)
        first, second, third = (turn(axis, angle) for axis, angle in zip(sequence, self.q[3:], strict=True))
        unit = [sp.eye(3)[:, axis] for axis in sequence]
        self.A = first * second * third
        self.G = sp.Matrix.hstack(third.T * second.T * unit[0], third.T * unit[1], unit[2])
        self.r = sp.Matrix(self.q[:3])
        self.center = sp.Matrix(center)

    def at(self, *point):
        return self.r + self.A * sp.Matrix(point)

    def axis(self, k):
        return self.A[:, k]

    def lagrange(self, gravity):
        """Return M (6, 6) and the other forces h (6)."""
        q, u = sp.Matrix(self.q), sp.Matrix(self.u)
        spin = self.G * u[3:, :]
        v = sp.Matrix(self.u[:3]) + self.A * spin.cross(self.center)
        T = self.mass * v.dot(v) / 2 + spin.dot(self.inertia * spin) / 2
        V = -self.mass * sp.Matrix(gravity).dot(self.at(*self.center))
        p = sp.Matrix([T]).jacobian(u).T
        return p.jacobian(u), p.jacobian(q) * u - sp.Matrix([T - V]).jacobian(q).T


class Flat(Body):
    """A rigid body in the plane."""

    def __init__(self, name, mass, inertia):
        self.q = sp.symbols(" ".join(f"{name}_{x}" for x in "xya"))
        self.u = sp.symbols(" ".join(f"{name}_{x}t" for x in "xya"))
        self.sequence, self.mass, self.inertia = (), mass, inertia
        c, s = sp.cos(self.q[2]), sp.sin(self.q[2])
        self.A, self.r = sp.Matrix([[c, -s], [s, c]]), sp.Matrix(self.q[:2])

    def lagrange(self, gravity):
        return sp.diag(self.mass, self.mass, self.inertia), -sp.Matrix([*(self.mass * x for x in gravity), 0])


class Equations:
    """q̈ of bodies with rows C(q, t) = 0 and D(q, u, t) = 0, as a function for SciPy."""

    def __init__(self, bodies, gravity, holonomic, nonholonomic=(), forces=lambda q, u: 0):
        began = time.process_time()
        self.bodies = bodies
        q, u = (sp.Matrix([x for body in bodies for x in getattr(body, key)]) for key in "qu")
        parts = [body.lagrange(gravity) for body in bodies]
        M, h = sp.diag(*(part[0] for part in parts)), sp.Matrix.vstack(*(part[1] for part in parts))
        extra = forces(q, u)
        h = h + extra if extra != 0 else h
        rows = []
        if holonomic:
            C = sp.Matrix(holonomic)
            J = C.jacobian(q)
            rows.append((J, J * u + C.diff(t)))
        if nonholonomic:
            D = sp.Matrix(nonholonomic)
            rows.append((D.jacobian(u), D))
        J = sp.Matrix.vstack(*(row[0] for row in rows))
        V = sp.Matrix.vstack(*(row[1] for row in rows))
        B = V.jacobian(q) * u + V.diff(t)
        self.n, self.c = len(q), len(V)
        function = sp.lambdify((list(q), list(u), t), [M, h, J, B], "numpy", cse=True)
        self.place = sp.lambdify((list(q),), [body.A for body in bodies], "numpy", cse=True)
        n, left, right = self.n, np.zeros((self.n + self.c,) * 2), np.zeros(self.n + self.c)

        def slope(time, y):
            M, h, J, B = function(y[:n].tolist(), y[n:].tolist(), time)
            left[:n, :n], left[:n, n:], left[n:, :n] = M, J.T, J
            right[:n], right[n:] = -h[:, 0], -B[:, 0]
            return np.concatenate([y[n:], np.linalg.solve(left, right)[:n]])

        self.slope = slope
        self.generation = time.process_time() - began

    def start(self, sim):
        """Return the state at which a simulation of mbstab starts, in the angles of these bodies."""
        q, u = [], []
        for i, body in enumerate(self.bodies):
            A, spin = sim.rotations[0, i], sim.spins[0, i]
            if not body.sequence:
                q += [*sim.positions[0, i], math.atan2(A[1, 0], A[0, 0])]
                u += [*sim.velocities[0, i], spin[2]]
                continue
            if body.sequence == (2, 0, 2):
                angles = [math.atan2(A[0, 2], -A[1, 2]), math.acos(A[2, 2]), math.atan2(A[2, 0], A[2, 1])]
            else:
                angles = [math.atan2(-A[1, 2], A[2, 2]), math.asin(A[0, 2]), math.atan2(-A[0, 1], A[0, 0])]
            G = np.array((body.A * body.G).subs(dict(zip(body.q[3:], angles, strict=True))), dtype=float)
            q += [*sim.positions[0, i], *angles]
            u += [*sim.velocities[0, i], *np.linalg.solve(G, spin)]
        return np.array([*q, *u])

    def run(self, y, tol):
        """Return the end and how long it took."""
        began = time.process_time()
        found = scipy.integrate.solve_ivp(self.slope, (0.0, END), y, "DOP853", rtol=tol, atol=tol)
        seconds = time.process_time() - began
        q, d = found.y[: self.n, -1], len(self.bodies[0].r)
        starts = np.cumsum([0, *(len(body.q) for body in self.bodies)])[:-1]
        return np.array([q[k : k + d] for k in starts]), np.array(self.place(q.tolist())), seconds


def pendulum(p):
    rod = Flat("rod", p["m"], p["m"] * p["L"] ** 2 / 3)
    return Equations([rod], (0, -9.81), list(rod.at(-p["L"], 0)))


def top(p):
    body = Body("top", (0, 1, 2), p["m"], (p["I_x"], p["I_x"], p["I_z"]))
    return Equations([body], (0, 0, -p["g"]), [*body.at(0, 0, -p["H"]), body.q[5] - p["omega"] * t])


def rolling_disk(p):
    body = Body("disk", (0, 1, 2), p["m"], (p["I_t"], p["I_t"], p["I_a"]))
    axle, up = body.axis(2), sp.Matrix([0, 0, 1])
    tilt = sp.sqrt(1 - axle[2] ** 2)
    down = (axle * axle[2] - up) / tilt  # from the centre to the lowest point of the rim
    spin = body.A * body.G * sp.Matrix(body.u[3:])
    slip = sp.Matrix(body.u[:3]) + spin.cross(p["R"] * down)
    rows = [body.q[2] - p["R"] * tilt, body.q[5] - p["omega"] * t]
    return Equations([body], (0, 0, -p["g"]), rows, [slip[0], slip[1]])


def governor(p):
    L, R, H, e = (p[key] for key in ("L", "R", "H", "e"))
    crank = (p["m_b"] + p["m_c"], (p["I_axial"], p["I_crank"], p["I_crank"]))
    crank += ((2 * L * p["m_c"] / (p["m_b"] + p["m_c"]), 0, 0),)
    rod = (p["m_b"], (p["I_axial"], p["I_rod"], p["I_rod"]), (L, 0, 0))
    m_s, m_p = p["m_s"], p["m_p"]
    middle = 2 * L * m_p / (m_s + m_p)
    across = m_s * (R**2 / 4 + (4 * L) ** 2 / 12 + middle**2) + m_p * (H**2 / 4 + (2 * L - middle) ** 2)
    own = (m_s + m_p, (across, across, m_s * R**2 / 2 + m_p * H**2 / 2), (0, 0, middle))
    round_ = m_p * (H**2 / 4 + (2 * H) ** 2 / 12)
    shaft = Body("shaft", (0, 1, 2), *own)
    right_crank, right_rod = Body("rc", (2, 0, 2), *crank), Body("rr", (2, 0, 2), *rod)
    slider = Body("slider", (0, 1, 2), m_p, (round_, round_, m_p * H**2 / 2))
    left_rod, left_crank = Body("lr", (2, 0, 2), *rod), Body("lc", (2, 0, 2), *crank)
    rows = [*shaft.at(0, 0, -2 * L), shaft.axis(2)[0], shaft.axis(2)[1]]
    for arm, bar, side, point in ((right_crank, right_rod, 1, e), (left_crank, left_rod, -1, -e)):
        rows += [*(shaft.at(side * e, 0, 2 * L) - arm.at(-2 * L, 0, 0))]
        rows += [shaft.axis(k).dot(arm.axis(2)) for k in (0, 2)]
        rows += [*(arm.r - bar.at(2 * L, 0, 0)), arm.axis(0).dot(bar.axis(2))]
        rows += [*(bar.r - slider.at(point, 0, 0))]
    gap = slider.r - shaft.at(0, 0, -2 * L)
    rows += [shaft.axis(0).dot(gap), shaft.axis(1).dot(gap)]
    rows += [shaft.axis(2).dot(slider.axis(0)), shaft.axis(2).dot(slider.axis(1)), shaft.axis(0).dot(slider.axis(1))]
    span = shaft.at(0, 0, 2 * L) - slider.r
    length = sp.sqrt(span.dot(span))

    def spring(q, u):
        slope = sp.Matrix([length]).jacobian(q)
        return slope.T * (p["k"] * (length - p["l_0"]) + p["sigma"] * (slope * u)[0])

    bodies = [shaft, right_crank, right_rod, slider, left_rod, left_crank]
    return Equations(bodies, (0, 0, -p["g"]), rows, [shaft.u[5] - p["omega"]], spring)


# --- Exudyn ---------------------------------------------------------------------------------------------------------


def exudyn_pendulum(p):
    import exudyn
    import exudyn.itemInterface as items

    system = exudyn.SystemContainer()
    mbs = system.AddSystem()
    L, m = p["L"], p["m"]
    angle = 1.5 * math.pi + MOTIONS["pendulum"]["rod.theta"]
    at = [L * math.cos(angle), L * math.sin(angle), angle]
    node = mbs.AddNode(items.NodeRigidBody2D(referenceCoordinates=at))
    rod = mbs.AddObject(items.ObjectRigidBody2D(physicsMass=m, physicsInertia=m * L**2 / 3, nodeNumber=node))
    ground = mbs.AddObject(items.ObjectGround())
    ends = [
        mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=b, localPosition=x))
        for b, x in ((ground, [0, 0, 0]), (rod, [-L, 0, 0]))
    ]
    mbs.AddObject(items.ObjectJointRevolute2D(markerNumbers=ends))
    middle = mbs.AddMarker(items.MarkerBodyMass(bodyNumber=rod))
    mbs.AddLoad(items.LoadMassProportional(markerNumber=middle, loadVector=[0, -9.81, 0]))
    mbs.Assemble()

    def end():
        q = mbs.GetNodeOutput(node, exudyn.OutputVariableType.Coordinates) + np.array(at)
        c, s = math.cos(q[2]), math.sin(q[2])
        return q[None, :2], np.array([[[c, -s], [s, c]]])

    return exudyn, mbs, end


def exudyn_top(p):
    import exudyn
    import exudyn.itemInterface as items

    system = exudyn.SystemContainer()
    mbs = system.AddSystem()
    H, tilt, omega = p["H"], MOTIONS["top"]["top.theta"], p["omega"]
    at = [H * math.sin(tilt), 0.0, H * math.cos(tilt), 0.0, tilt, 0.0]
    node = mbs.AddNode(
        items.NodeRigidBodyRxyz(referenceCoordinates=at, initialVelocities=[0.0, 0.0, 0.0, 0.0, 0.0, omega])
    )
    inertia = [p["I_x"], p["I_x"], p["I_z"], 0.0, 0.0, 0.0]
    body = mbs.AddObject(items.ObjectRigidBody(physicsMass=p["m"], physicsInertia=inertia, nodeNumber=node))
    ground = mbs.AddObject(items.ObjectGround())
    ends = [
        mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=b, localPosition=x))
        for b, x in ((ground, [0, 0, 0]), (body, [0, 0, -H]))
    ]
    mbs.AddObject(items.ObjectJointSpherical(markerNumbers=ends))
    fixed = mbs.AddNode(items.NodePointGround())
    coordinates = [
        mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=n, coordinate=k)) for n, k in ((fixed, 0), (node, 5))
    ]
    # The rate of the last angle, as the angle itself needs a Python function at every evaluation.
    mbs.AddObject(items.ObjectConnectorCoordinate(markerNumbers=coordinates, offset=omega, velocityLevel=True))
    middle = mbs.AddMarker(items.MarkerBodyMass(bodyNumber=body))
    mbs.AddLoad(items.LoadMassProportional(markerNumber=middle, loadVector=[0, 0, -p["g"]]))
    mbs.Assemble()

    def end():
        place = mbs.GetNodeOutput(node, exudyn.OutputVariableType.Position)
        turned = mbs.GetNodeOutput(node, exudyn.OutputVariableType.RotationMatrix)
        return place[None], turned.reshape(1, 3, 3)

    return exudyn, mbs, end


EXUDYN = {"pendulum": exudyn_pendulum, "top": exudyn_top}


def exudyn_times(name, parameters, off):
    """Return the least time of the generalized-alpha method with an error below the goal, and its steps."""
    for steps in (2000, 5000, 10_000, 20_000, 50_000, 100_000, 200_000, 500_000, 1_000_000):
        module, mbs, end = EXUDYN[name](parameters)
        settings = module.SimulationSettings()
        settings.timeIntegration.numberOfSteps = steps
        settings.timeIntegration.endTime = END
        settings.timeIntegration.verboseMode = 0
        settings.timeIntegration.newton.useModifiedNewton = True
        settings.timeIntegration.newton.relativeTolerance = 1e-10
        settings.timeIntegration.newton.absoluteTolerance = 1e-12
        settings.timeIntegration.generalizedAlpha.spectralRadius = 0.9
        settings.solutionSettings.writeSolutionToFile = False
        settings.solutionSettings.sensorsWritePeriod = END
        settings.displayStatistics = False
        began = time.process_time()
        mbs.SolveDynamic(settings, solverType=module.DynamicSolverType.GeneralizedAlpha)
        seconds = time.process_time() - began
        if off(*end()) <= GOAL:
            return seconds, steps
    return math.nan, 0


# --- the table ------------------------------------------------------------------------------------------------------


def least(run):
    """Return the least time with an error below the goal, and that for writing the equations.

    Tolerances shrink until the goal is met twice, each is tried five times.
    """
    times = []
    for tol in TOLERANCES:
        error, *seconds = run(tol)
        if error <= GOAL:
            times.append(min(seconds, *(run(tol)[1:] for _ in range(4)), key=lambda x: x[0]))
        if len(times) == 2:
            break
    return min(times, key=lambda x: x[0])


class Written:
    """Counts the time in which mbstab writes equations."""

    def __init__(self):
        self.seconds = 0.0
        for where, name in ((marching, "machine_of"), (fused.Fused, "augmented"), (fused.Fused, "dynamics")):
            self.watch(where, name)

    def watch(self, where, name):
        function = getattr(where, name)

        def timed(*arguments):
            began = time.process_time()
            result = function(*arguments)
            # A function that is there takes microseconds.
            seconds = time.process_time() - began
            self.seconds += seconds if seconds > 5e-4 else 0.0
            return result

        setattr(where, name, timed)


def main():
    written = Written()
    machine = find_spec("numba") is not None
    heads = (("", 14), ("steps", 9), ("written", 9), ("compiled", 9), ("written", 9), ("SciPy", 9), ("written", 9))
    heads += (("ratios", 12), ("controlled", 12), ("Exudyn", 9), ("ratios", 12))
    print("".join(f"{head:>{width}}" for head, width in heads))
    for name in sys.argv[1:] or list(MOTIONS):
        model, perturb = mbstab.load(f"{name}.yaml"), MOTIONS[name]
        exact = model.simulate(END, perturb=perturb, tol=1e-13, once=True, points=2)
        size = float(np.max(exact.sizes))

        def off(places, turned, exact=exact, size=size):
            return max(
                np.max(np.abs(places - exact.positions[-1])) / size, np.max(np.abs(turned - exact.rotations[-1]))
            )

        def own(tol, model=model, perturb=perturb, off=off, compiled=False):
            began, before = time.process_time(), written.seconds
            sim = model.simulate(END, perturb=perturb, tol=tol, once=True, points=2, compiled=compiled)
            writing = written.seconds - before
            return off(sim.positions[-1], sim.rotations[-1]), time.process_time() - began - writing, writing

        equations = globals()[name](model.parameters())
        y = equations.start(exact)

        def scipys(tol, equations=equations, y=y, off=off):
            *end, seconds = equations.run(y, tol)
            return off(*end), seconds, equations.generation

        ours, theirs, quick = least(own), least(scipys), (math.nan, math.nan)
        if machine:
            own(1e-3, compiled=True)  # the first time it is compiled
            quick = least(partial(own, compiled=True))
        began = time.process_time()
        sim = model.simulate(END, perturb=perturb, tol=GOAL, points=2, compiled=machine)
        controlled = time.process_time() - began
        assert off(sim.positions[-1], sim.rotations[-1]) <= 3.0 * GOAL
        exudyn, steps = math.nan, 0
        if name in EXUDYN and find_spec("exudyn"):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)  # of names that older versions need
                exudyn, steps = exudyn_times(name, model.parameters(), off)
        row = f"{name:14}" + "".join(f"{x:9.4f}" for pair in (ours, quick, theirs) for x in pair)
        row += "".join(f"{theirs[0] / x[0]:6.1f}" for x in (ours, quick)) + f"{controlled:12.4f}{exudyn:9.4f}"
        row += "".join(f"{exudyn / x[0]:6.1f}" for x in (ours, quick))
        print(row + (f"  ({steps} steps)" if steps else ""), flush=True)


def outputs():
    """Print what a hundred times as many output times cost."""
    model, found = mbstab.load("top.yaml").at(omega=6.0), []
    print(f"\n{'outputs':14}{'CPU':>9}{'evaluations':>14}")
    for points in (601, 60_001):
        began = time.process_time()
        sim = model.simulate(60.0, perturb={"top.theta": math.pi / 36}, points=points)
        found.append(time.process_time() - began)
        print(f"{points:<14}{found[-1]:9.3f}{sim.evaluations:14}", flush=True)
    print(f"{'ratio':14}{found[1] / found[0]:9.2f}")


if __name__ == "__main__":
    main()
    if len(sys.argv) == 1:
        outputs()
