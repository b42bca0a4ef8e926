"""Sums against NumPy."""

import threading
import time

import farfield as ff
import numpy as np
import pytest

RANDOM = np.random.default_rng(1)
X = RANDOM.random((3000, 3))
Y = RANDOM.random((400, 3)) + 0.1
Q = RANDOM.random(3000)


def differences(x, y):
    """d = x - y and r for all pairs; r is infinite where points coincide."""
    d = x[:, None, :] - y[None, :, :]
    r = np.sqrt((d**2).sum(-1))
    return d, np.where(r == 0, np.inf, r)


def error(found, exact):
    return np.linalg.norm(found - exact) / np.linalg.norm(exact)


def test_names_and_texts_are_summed():
    _, r = differences(X, X)
    assert error(ff.sum("laplace", X, Q), (1 / r) @ Q) < 1e-6
    assert error(ff.sum("1/r", X, Q), (1 / r) @ Q) < 1e-6
    yukawa = np.where(np.isinf(r), 0, np.exp(-2 * r) / r) @ Q
    assert error(ff.sum("exp(-k*r)/r", X, Q, k=2.0, tolerance=1e-9), yukawa) < 1e-9
    assert error(ff.sum("yukawa", X, Q, k=2), yukawa) < 1e-6


def test_targets_and_gradients():
    d, r = differences(Y, X)
    u, du = ff.sum("1/r", X, Q, targets=Y, gradient=True)
    assert u.shape == (400,) and du.shape == (400, 3)
    assert error(u, (1 / r) @ Q) < 1e-6
    assert error(du, np.einsum("ijk,j->ik", -d / r[..., None] ** 3, Q)) < 1e-6


def test_columns_are_sums_of_their_own():
    plan = ff.plan("r", X, targets=Y)
    columns = np.stack([Q, 2 * Q, -Q], axis=1)
    found = plan(columns)
    assert found.shape == (400, 3)
    for k in range(3):
        assert (found[:, k] == plan(columns[:, k])).all()
    assert plan(columns[:, :0]).shape == (400, 0)
    u, du = ff.plan("r", X, targets=Y, gradient=True)(columns)
    assert u.shape == (400, 3) and du.shape == (400, 3, 3)
    assert error(u, found) < 2e-6 and (du[:, 1] == 2 * du[:, 0]).all()


def test_tensors():
    d, r = differences(Y, X)
    forces = RANDOM.random((3000, 3)) - 0.5
    stokes = np.eye(3) / r[..., None, None] + d[..., :, None] * d[..., None, :] / r[..., None, None] ** 3
    exact = np.einsum("ijab,jb->ia", stokes, forces) / (8 * np.pi)
    u = ff.sum("stokeslet", X, forces, targets=Y)
    assert u.shape == (400, 3) and error(u, exact) < 1e-6
    u, du = ff.sum("stokeslet", X, forces, targets=Y, gradient=True)
    assert du.shape == (400, 3, 3) and error(u, exact) < 1e-6
    step = np.array([1e-4, 0, 0])
    sides = [ff.sum("stokeslet", X[:50], forces[:50], targets=Y + s * step) for s in (1, -1)]
    _, du = ff.sum("stokeslet", X[:50], forces[:50], targets=Y, gradient=True)
    assert error(du[:, :, 0], (sides[0] - sides[1]) / 2e-4) < 1e-4
    dipoles = ff.sum("laplace_dipole", X, forces, targets=Y)
    assert dipoles.shape == (400, 1)
    assert error(dipoles[:, 0], np.einsum("ija,ja->i", d / r[..., None] ** 3, forces)) < 1e-6


def test_points_at_one_place():
    x = np.array([[0.0, 0, 0], [0, 0, 0], [1, 0, 0]])
    q = np.array([1.0, 10.0, 100.0])
    assert ff.sum("1/r", x, q).tolist() == [100, 100, 11]
    assert ff.sum("1/r", x, q, coincident=2).tolist() == [122, 122, 211]
    assert ff.sum("2 - r", x, q, coincident="formula").tolist() == [122, 122, 211]
    assert ff.sum("gaussian", x, q)[2] == pytest.approx(100 + 11 * np.exp(-1))
    with pytest.raises(ff.SumError, match="sum at target 0"):
        ff.sum("1/r", x, q, coincident="formula")


def test_layouts_and_types_change_nothing():
    exact = ff.sum("1/r", X, Q)
    assert (ff.sum("1/r", np.asfortranarray(X), Q) == exact).all()
    assert (ff.sum("1/r", np.repeat(X, 2, axis=0)[::2], np.repeat(Q, 3)[::3]) == exact).all()
    assert (ff.sum("1/r", X.tolist(), Q.tolist()) == exact).all()
    single = ff.sum("1/r", X.astype(np.float32), Q.astype(np.float32), tolerance=1e-4)
    assert single.dtype == np.float32 and error(single, exact) < 1e-3
    assert ff.sum("r", [[0, 0, 0], [2, 0, 0]], [1, 1]).tolist() == [2, 2]


def test_threads_change_no_bit():
    sums = [ff.sum("exp(-r)", X, Q, threads=threads) for threads in (None, 1, 3)]
    assert (sums[0] == sums[1]).all() and (sums[0] == sums[2]).all()


def test_plans_tell_about_themselves():
    plan = ff.plan("laplace", X, targets=Y, tolerance=1e-5)
    assert plan.shape == (400, 3000) and plan.dtype == np.float64
    certificate = plan.certificate(Q)
    assert 0 <= certificate.relative_l2 < 1e-5 and certificate.confidence >= 0.99
    report = plan.report()
    assert report["sources"] == 3000 and report["targets"] == 400
    assert report["direct_pairs"] + report["expansion_pairs"] + report["left_out_pairs"] == 1_200_000
    assert "3000 sources" in report["text"]
    assert ff.plan("stokeslet", X).shape == (9000, 9000)


def test_ready_kernels_are_listed():
    kernels = {kernel.name: kernel for kernel in ff.kernels()}
    assert kernels["yukawa"].parameters == {"k": 1.0}
    assert kernels["laplace"].formula == "1/r" and len(kernels) >= 20
    for kernel in kernels.values():
        assert kernel.about
        charge = np.ones((2, 3))
        plan = ff.plan(kernel.name, X[:2])
        plan(charge if plan.shape[1] == 6 else charge[:, 0])


def test_linear_operators_solve():
    linalg = pytest.importorskip("scipy.sparse.linalg")
    operator = ff.plan("exp(-10*r)", X[:300], coincident="formula", tolerance=1e-9).as_linear_operator()
    solution, state = linalg.cg(operator, Q[:300], rtol=1e-8, maxiter=2000)
    assert state == 0 and error(operator @ solution, Q[:300]) < 1e-6
    vectors = ff.plan("stokeslet", X[:10]).as_linear_operator()
    assert (vectors @ np.ones(30)).shape == (30,)
    with pytest.raises(ff.InputError, match="gradient"):
        ff.plan("r", X[:10], gradient=True).as_linear_operator()


def test_other_threads_go_on():
    x, q = RANDOM.random((20000, 3)), np.ones(20000)
    plan = ff.plan("erfc(r)/r + cos(r)", x, threads=1)
    ticks, done = [], threading.Event()

    def tick():
        while not done.is_set():
            ticks.append(time.perf_counter())
            time.sleep(0.001)

    thread = threading.Thread(target=tick)
    thread.start()
    start = time.perf_counter()
    plan(q)
    end = time.perf_counter()
    done.set()
    thread.join()
    # Were they held up, there would be none between start and end.
    assert any(start < t < end for t in ticks)
