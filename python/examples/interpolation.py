"""A smooth function from its values at scattered points, by radial basis functions and conjugate gradients."""

import farfield as ff
import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

random = np.random.default_rng(1)
points = random.random((1000, 3))


def function(x):
    return np.sin(3 * x[:, 0]) * np.cos(2 * x[:, 1]) + x[:, 2] ** 2


values = function(points)

# A little smoothing keeps the system well conditioned.
kernel, smoothing = dict(kernel="matern32", length=0.3), 1e-2
plan = ff.plan(x=points, tolerance=1e-7, applications=200, **kernel)
matrix = plan.as_linear_operator()
system = LinearOperator(matrix.shape, matvec=lambda w: matrix @ w + smoothing * w, dtype=matrix.dtype)
steps = []
weights, state = cg(system, values, rtol=1e-5, maxiter=1000, callback=steps.append)
assert state == 0, "conjugate gradients did not converge"

# Between the points, away from the border.
between = 0.1 + 0.8 * random.random((500, 3))
found = ff.sum(x=points, q=weights, targets=between, **kernel)
error = np.linalg.norm(found - function(between)) / np.linalg.norm(function(between))
print(f"{len(steps)} steps, relative error between the points: {error:.1e}")
assert error < 1e-2
