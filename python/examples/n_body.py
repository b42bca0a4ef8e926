"""Stars that attract each other, by the leapfrog; energy hardly drifts."""

import farfield as ff
import numpy as np

random = np.random.default_rng(1)
n, softening, step = 4000, 0.05, 0.005
masses = np.full(n, 1 / n)
# A ball that turns and collapses.
x = random.normal(size=(n, 3))
x *= (random.random(n) ** (1 / 3) / np.linalg.norm(x, axis=1))[:, None]
v = 0.5 * np.stack([-x[:, 1], x[:, 0], np.zeros(n)], axis=1)


def field(x):
    """The potential and the acceleration at all stars."""
    u, du = ff.sum("softened_coulomb", x, masses, eps=softening, gradient=True, tolerance=1e-5)
    return -u, du


def energy(v, potential):
    return 0.5 * (masses * (v**2).sum(1)).sum() + 0.5 * (masses * potential).sum()


potential, acceleration = field(x)
before = energy(v, potential)
for _ in range(10):
    v += 0.5 * step * acceleration
    x += step * v
    potential, acceleration = field(x)
    v += 0.5 * step * acceleration
drift = abs(energy(v, potential) / before - 1)
print(f"10 steps of {n} stars, relative drift of the energy: {drift:.1e}")
assert drift < 1e-4
