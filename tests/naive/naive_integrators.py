"""Plain integrators of M q̈ + b = u on `pinocchio`: what the variational rule is compared with."""

import numpy as np
import pinocchio as pin
from scipy.optimize import root


def euler(model, q, v, u, h, steps):
    data = model.createData()
    for _ in range(steps):
        a = pin.aba(model, data, q, v, u).copy()
        q, v = q + h * v, v + h * a
    return q, v


def runge_kutta(model, q, v, u, h, steps):
    data = model.createData()

    def f(x):
        n = len(x) // 2
        return np.concatenate([x[n:], pin.aba(model, data, x[:n], x[n:], u)])

    x = np.concatenate([q, v])
    for _ in range(steps):
        k1 = f(x)
        k2 = f(x + h / 2 * k1)
        k3 = f(x + h / 2 * k2)
        k4 = f(x + h * k3)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x[: len(q)], x[len(q) :]


def trapezoid(model, q, v, u, h, steps):
    """Implicit trapezoidal rule, Newton by scipy."""
    data, n = model.createData(), len(q)
    for _ in range(steps):
        a = pin.aba(model, data, q, v, u).copy()

        def rest(x, q=q, v=v, a=a):
            new = pin.aba(model, data, x[:n], x[n:], u)
            return np.concatenate([x[:n] - q - h / 2 * (v + x[n:]), x[n:] - v - h / 2 * (a + new)])

        x = root(rest, np.concatenate([q + h * v, v + h * a]), tol=1e-12).x
        q, v = x[:n], x[n:]
    return q, v
