"""The same motion problem handed to other optimal-control tools, as their users would write it.

Every peer returns (trajectory or None, CPU seconds of the solve alone). Set-up (symbolic dynamics,
transcription, compilation) is never counted, for nobody.
"""

import time

import casadi as ca
import numpy as np

from dmoc.motion.cost import Cost
from dmoc.motion.motion import MotionProblem
from dmoc.motion.trajectory import JointTrajectory
from dmoc.physics.dynamics import lagrangian_gradients
from dmoc.programme.builder import arm_of
from dmoc.programme.guess import straight_guess
from dmoc.robot.robot import Robot


def forward_dynamics(robot: Robot) -> ca.Function:
    """q̈(q, q̇, u) as CasADi SX: M⁻¹(u + f − Ṁ q̇) with M = ∂p/∂q̇."""
    n = robot.num_joints
    q, v, u = (ca.SX.sym(name, n) for name in "qvu")
    p, f = lagrangian_gradients(arm_of(robot), q, v)
    mass = ca.jacobian(p, v)
    rhs = u + f - ca.jtimes(p, q, v)
    diagonal, factor, order = ca.ldl(mass)
    return ca.Function("fd", [q, v, u], [ca.ldl_solve(rhs, diagonal, factor, order)], {"cse": True})


class Rockit:
    """rockit DirectCollocation, free time, Ipopt with MUMPS, expanded to scalars (several times
    faster than its default here). Changing a guess after the transcription takes rockit longer
    than a transcription, so every problem is transcribed and the second solve is the one timed.
    """

    name = "rockit collocation"
    free_time = True
    most_pairs = 3

    def __init__(self, robot: Robot, cost: Cost, num_intervals: int) -> None:
        import rockit

        self.rockit, self.robot, self.cost, self.count = rockit, robot, cost, num_intervals
        self.acceleration = forward_dynamics(robot)

    def _problem(self, problem: MotionProblem) -> tuple:
        rockit, robot, cost, n = self.rockit, self.robot, self.cost, self.robot.num_joints
        guess = straight_guess(problem)
        total = guess.step_s * self.count
        ocp = rockit.Ocp(T=rockit.FreeTime(total))
        q, v = [ocp.state() for _ in range(n)], [ocp.state() for _ in range(n)]
        u = [ocp.control() for _ in range(n)]
        acceleration = self.acceleration(*(ca.vertcat(*x) for x in (q, v, u)))
        s = ocp.t / total
        share, rate = s**3 * (10 - 15 * s + 6 * s**2), 30 * s**2 * (1 - s) ** 2 / total
        hold = robot.gravity_torque_nm(guess.q_rad[[0, -1]])
        for j, distance in enumerate(problem.goal_rad - problem.start_rad):
            ocp.set_der(q[j], v[j])
            ocp.set_der(v[j], acceleration[j])
            ocp.subject_to(-robot.torque_limit_nm[j] <= (u[j] <= robot.torque_limit_nm[j]))
            limit = robot.velocity_limit_rad_s[j]
            ocp.subject_to(-limit <= (v[j] <= limit), include_first=False, include_last=False)
            lower, upper = robot.q_lower_rad[j], robot.q_upper_rad[j]
            ocp.subject_to(lower <= (q[j] <= upper), include_first=False, include_last=False)
            ocp.subject_to(ocp.at_t0(q[j]) == problem.start_rad[j])
            ocp.subject_to(ocp.at_tf(q[j]) == problem.goal_rad[j])
            ocp.subject_to(ocp.at_t0(v[j]) == 0)
            ocp.subject_to(ocp.at_tf(v[j]) == 0)
            ocp.set_initial(q[j], problem.start_rad[j] + share * distance)
            ocp.set_initial(v[j], rate * distance)
            ocp.set_initial(u[j], hold[0, j] + s * (hold[1, j] - hold[0, j]))
        ocp.subject_to(ocp.T >= 0.05)
        price = (
            cost.time + cost.effort * sum(x**2 for x in u) + cost.velocity * sum(x**2 for x in v)
        )
        ocp.add_objective(ocp.integral(price))
        quiet = {"expand": True, "print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
        ocp.solver("ipopt", quiet)
        ocp.method(rockit.DirectCollocation(N=self.count))
        return ocp, ca.vertcat(*q, *v, *u)

    def solve(self, problem: MotionProblem) -> tuple[JointTrajectory | None, float]:
        ocp, signals = self._problem(problem)
        try:
            ocp.solve()
            start = time.process_time()
            solution = ocp.solve()
            spent = time.process_time() - start
        except RuntimeError:  # how CasADi reports that Ipopt failed
            return None, float("nan")
        n = self.robot.num_joints
        t, every = solution.sample(signals, grid="control")
        q, v, u = every[:, :n], every[:, n : 2 * n], every[:-1, 2 * n :]
        return JointTrajectory(t, q, v, u, self.robot), spent


class Crocoddyl:
    """crocoddyl BoxFDDP with RK4, fixed time, goal by terminal penalty; no speed limits."""

    name = "crocoddyl BoxFDDP"
    free_time = False
    most_pairs = None

    def __init__(self, robot: Robot, cost: Cost, num_intervals: int) -> None:
        import crocoddyl

        self.crocoddyl, self.robot, self.cost = crocoddyl, robot, cost

    def _problem(self, problem: MotionProblem, duration: float):
        croc, robot, cost = self.crocoddyl, self.robot, self.cost
        model = robot.model.copy()
        armature = np.array(model.armature)
        model.armature = np.zeros(model.nv)  # else counted twice or not at all
        state = croc.StateMultibody(model)
        actuation = croc.ActuationModelFull(state)
        n, h = model.nv, duration / problem.num_intervals

        def stage(terminal: bool):
            costs = croc.CostModelSum(state)
            goal = np.concatenate([problem.goal_rad, np.zeros(n)])
            speed = croc.ActivationModelWeightedQuad(np.concatenate([np.zeros(n), np.ones(n)]))
            if terminal:
                costs.addCost(
                    "goal",
                    croc.CostModelResidual(state, croc.ResidualModelState(state, goal, n)),
                    1e6,
                )
            else:
                costs.addCost(
                    "v",
                    croc.CostModelResidual(
                        state, speed, croc.ResidualModelState(state, np.zeros(2 * n), n)
                    ),
                    2 * cost.velocity,
                )
                costs.addCost(
                    "u",
                    croc.CostModelResidual(state, croc.ResidualModelControl(state, n)),
                    2 * cost.effort,
                )
            dynamics = croc.DifferentialActionModelFreeFwdDynamics(state, actuation, costs)
            dynamics.armature = armature
            dynamics.u_lb, dynamics.u_ub = -robot.torque_limit_nm, robot.torque_limit_nm
            if terminal:
                return croc.IntegratedActionModelEuler(dynamics, 0.0)
            model_rk = croc.IntegratedActionModelRK(dynamics, croc.RKType.four, h)
            model_rk.u_lb, model_rk.u_ub = -robot.torque_limit_nm, robot.torque_limit_nm
            return model_rk

        x0 = np.concatenate([problem.start_rad, np.zeros(n)])
        running = stage(False)
        return croc.ShootingProblem(x0, [running] * problem.num_intervals, stage(True)), h

    def solve(
        self, problem: MotionProblem, duration: float
    ) -> tuple[JointTrajectory | None, float]:
        shooting, h = self._problem(problem, duration)
        solver = self.crocoddyl.SolverBoxFDDP(shooting)
        solver.th_stop = 1e-6
        guess = straight_guess(problem.replace(duration_s=duration))
        rates = np.gradient(guess.q_rad, h, axis=0)
        xs = [np.concatenate(x) for x in zip(guess.q_rad, rates)]
        start = time.process_time()
        done = solver.solve(xs, list(guess.torque_nm), 200, False)
        spent = time.process_time() - start
        x, n = np.array(solver.xs), self.robot.num_joints
        t = h * np.arange(len(x))
        motion = JointTrajectory(t, x[:, :n], x[:, n:], np.array(solver.us), self.robot)
        return (motion if done else None), spent


class Drake:
    """Drake DirectCollocation (cubic collocation) with SNOPT, free time, on half the grid.

    The plant is built from the same numbers; its derivatives are taken by automatic
    differentiation, which is what makes it slow. Feasible to SNOPT's default tolerance.
    """

    name = "Drake collocation, N = 20"
    free_time = True
    most_pairs = 1

    def __init__(self, robot: Robot, cost: Cost, num_intervals: int) -> None:
        import pydrake.all as drake

        self.drake, self.robot, self.cost, self.count = drake, robot, cost, num_intervals // 2
        self.plant = self._plant()

    def _plant(self):
        drake, robot, model = self.drake, self.robot, self.robot.model
        arm = arm_of(robot)
        plant = drake.MultibodyPlant(time_step=0.0)
        plant.mutable_gravity_field().set_gravity_vector(model.gravity.linear)
        parent = plant.world_body()
        for j in range(robot.num_joints):
            inertia, place = model.inertias[j + 1], model.jointPlacements[j + 1]
            turn = inertia.inertia
            body = plant.AddRigidBody(
                f"body{j}",
                drake.SpatialInertia.MakeFromCentralInertia(
                    inertia.mass,
                    inertia.lever,
                    drake.RotationalInertia(
                        turn[0, 0], turn[1, 1], turn[2, 2], turn[0, 1], turn[0, 2], turn[1, 2]
                    ),
                ),
            )
            mount = drake.RigidTransform(drake.RotationMatrix(place.rotation), place.translation)
            frame = drake.FixedOffsetFrame(f"frame{j}", parent.body_frame(), mount)
            joint = plant.AddJoint(
                drake.RevoluteJoint(
                    f"joint{j}",
                    plant.AddFrame(frame),
                    body.body_frame(),
                    np.array(arm.joints[j].axis),
                )
            )
            motor = plant.AddJointActuator(f"motor{j}", joint, robot.torque_limit_nm[j])
            motor.set_default_rotor_inertia(robot.armature_kg_m2[j])
            motor.set_default_gear_ratio(1.0)
            parent = body
        plant.Finalize()
        return plant

    def solve(self, problem: MotionProblem) -> tuple[JointTrajectory | None, float]:
        drake, robot, cost, n = self.drake, self.robot, self.cost, self.robot.num_joints
        guess = straight_guess(problem.replace(num_intervals=self.count))
        step, zero = guess.step_s, np.zeros(n)
        port = self.plant.get_actuation_input_port().get_index()
        motion = drake.DirectCollocation(
            self.plant,
            self.plant.CreateDefaultContext(),
            self.count + 1,
            0.2 * step,
            5 * step,
            port,
        )
        motion.AddEqualTimeIntervalsConstraints()
        x, u = motion.state(), motion.input()
        high = np.concatenate([robot.q_upper_rad, robot.velocity_limit_rad_s])
        low = np.concatenate([robot.q_lower_rad, -robot.velocity_limit_rad_s])
        for a, lower, upper in ((x, low, high), (u, -robot.torque_limit_nm, robot.torque_limit_nm)):
            for variable, least, most in zip(a, lower, upper):
                motion.AddConstraintToAllKnotPoints(variable >= least)
                motion.AddConstraintToAllKnotPoints(variable <= most)
        program = motion.prog()
        for state, q in (
            (motion.initial_state(), problem.start_rad),
            (motion.final_state(), problem.goal_rad),
        ):
            at = np.concatenate([q, zero])
            program.AddBoundingBoxConstraint(at, at, state)
        motion.AddRunningCost(cost.time + cost.effort * u.dot(u) + cost.velocity * x[n:].dot(x[n:]))
        t = step * np.arange(self.count + 1)
        rates = np.gradient(guess.q_rad, step, axis=0)
        torque = np.vstack([guess.torque_nm, guess.torque_nm[-1:]])
        motion.SetInitialTrajectory(
            drake.PiecewisePolynomial.FirstOrderHold(t, torque.T),
            drake.PiecewisePolynomial.FirstOrderHold(t, np.hstack([guess.q_rad, rates]).T),
        )
        start = time.process_time()
        result = drake.SnoptSolver().Solve(program)
        spent = time.process_time() - start
        if not result.is_success():
            return None, spent
        t = motion.GetSampleTimes(result)
        x, u = motion.GetStateSamples(result), motion.GetInputSamples(result)
        return JointTrajectory(t, x[:n].T, x[n:].T, u[:, :-1].T, robot), spent


class Toppra:
    """toppra on the straight line: time-optimal under speed and torque limits."""

    name = "toppra straight line"
    free_time = True
    most_pairs = None

    def __init__(self, robot: Robot, cost: Cost, num_intervals: int) -> None:
        import pinocchio as pin

        self.robot, self.data, self.pin = robot, robot.model.createData(), pin

    def solve(self, problem: MotionProblem) -> tuple[JointTrajectory | None, float]:
        import toppra
        import toppra.algorithm
        import toppra.constraint

        robot, pin = self.robot, self.pin

        def inverse(q, v, a):
            return pin.rnea(robot.model, self.data, q, v, a).copy()

        start = time.process_time()
        path = toppra.SplineInterpolator([0, 1], np.stack([problem.start_rad, problem.goal_rad]))
        v, u = robot.velocity_limit_rad_s, robot.torque_limit_nm
        limits = [
            toppra.constraint.JointVelocityConstraint(np.stack([-v, v], axis=1)),
            toppra.constraint.JointTorqueConstraint(
                inverse, np.stack([-u, u], axis=1), np.zeros(robot.num_joints)
            ),
        ]
        gridpoints = np.linspace(0, 1, 101)
        parametrised = toppra.algorithm.TOPPRA(limits, path, gridpoints).compute_trajectory(0, 0)
        spent = time.process_time() - start
        if parametrised is None:
            return None, spent
        t = np.linspace(0, parametrised.duration, 201)
        q, rate = parametrised(t), parametrised(t, 1)
        rate[[0, -1]] = 0.0
        return JointTrajectory(t, q, rate, np.zeros((200, robot.num_joints)), robot), spent
