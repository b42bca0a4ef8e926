"""Sums against NumPy."""

import subprocess
import sys
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


def test_parameters_may_have_the_names_of_arguments():
    expected = ff.sum("exp(-k*r)/(r + a)", X, Q, k=2.0, a=0.5)
    assert (ff.sum("exp(-q*r)/(r + x)", X, Q, parameters={"q": 2.0, "x": 0.5}) == expected).all()
    assert (ff.sum("exp(-q*r)/(r + a)", X, Q, parameters={"q": 2.0}, a=0.5) == expected).all()
    assert (ff.plan("exp(-x*r)/(r + tolerance)", X, parameters={"x": 2.0, "tolerance": 0.5})(Q) == expected).all()


def test_ready_kernels_are_listed():
    kernels = {kernel.name: kernel for kernel in ff.kernels()}
    assert kernels["yukawa"].parameters == {"k": 1.0}
    assert kernels["laplace"].formula == "1/r" and len(kernels) >= 20
    for kernel in kernels.values():
        assert kernel.about
        charge = np.ones((2, 3))
        plan = ff.plan(kernel.name, X[:2])
        plan(charge if plan.shape[1] == 6 else charge[:, 0])


def test_second_derivatives():
    d, r = differences(Y, X)
    exact = 3 * d[..., :, None] * d[..., None, :] / r[..., None, None] ** 5 - np.eye(3) / r[..., None, None] ** 3
    for kernel in ("laplace", "1/r"):
        u, du, ddu = ff.sum(kernel, X, Q, targets=Y, hessian=True)
        assert u.shape == (400,) and du.shape == (400, 3) and ddu.shape == (400, 3, 3)
        assert error(u, (1 / r) @ Q) < 1e-6
        assert error(ddu, np.einsum("ijab,j->iab", exact, Q)) < 1e-6
    forces = RANDOM.random((50, 3)) - 0.5
    _, du, ddu = ff.sum("stokeslet", X[:50], forces, targets=Y, hessian=True)
    assert ddu.shape == (400, 3, 3, 3)
    # Central differences of fourth order.
    step = np.array([0, 1e-3, 0])
    sides = [ff.sum("stokeslet", X[:50], forces, targets=Y + s * step, gradient=True)[1] for s in (2, 1, -1, -2)]
    slope = (-sides[0] + 8 * sides[1] - 8 * sides[2] + sides[3]) / 12e-3
    far = r[:, :50].min(axis=1) > 0.1
    assert error(ddu[far][..., 1], slope[far]) < 1e-6
    plan = ff.plan("r", X, targets=Y, hessian=True)
    found = plan(np.stack([Q, 2 * Q], axis=1))
    assert [part.shape for part in found] == [(400, 2), (400, 2, 3), (400, 2, 3, 3)]
    assert plan.hessian and (found[2][:, 1] == 2 * found[2][:, 0]).all()


def test_columns_of_any_size_are_summed_together():
    q = RANDOM.random((3000, 20)) * 10.0 ** np.arange(-10, 10)
    exact = (1 / differences(Y, X)[1]) @ q
    for x, bound in ((X, 1e-6), (X.astype(np.float32), 2e-3)):
        found = ff.sum("1/r", x, q.astype(x.dtype), targets=Y.astype(x.dtype), tolerance=bound)
        assert found.shape == (400, 20) and found.dtype == x.dtype
        assert all(error(found[:, k], exact[:, k]) < bound for k in range(20))


def test_extreme_extents():
    exact = ff.sum("1/r", X, Q, targets=Y)
    for scale in (2.0**80, 2.0**-80):
        x, y = (X * scale).astype(np.float32), (Y * scale).astype(np.float32)
        found = ff.sum("1/r", x, Q.astype(np.float32), targets=y, tolerance=1e-4)
        assert error(found.astype(float) * scale, exact) < 2e-4
    for scale in (2.0**700, 2.0**-700):
        assert error(ff.sum("1/r", X * scale, Q, targets=Y * scale) * scale, exact) < 2e-6
    with pytest.raises(ff.InputError, match="too small for f32"):
        ff.sum("1/r2^2", X.astype(np.float32) * np.float32(1e18), Q.astype(np.float32))


def test_transposes_solve_least_squares():
    linalg = pytest.importorskip("scipy.sparse.linalg")
    plan = ff.plan("exp(-10*r)", X[:60], targets=Y, tolerance=1e-9)
    assert plan.T.T is plan and plan.T.shape == (60, 400)
    assert repr(plan) == "<farfield.Plan: 60 sources, 400 targets, float64>"
    operator = plan.as_linear_operator()
    w, q = RANDOM.random(400), RANDOM.random(60)
    assert abs(w @ (operator @ q) - q @ (operator.T @ w)) < 1e-12 * np.linalg.norm(w) * np.linalg.norm(operator @ q)
    dense = np.exp(-10 * differences(Y, X[:60])[1])
    exact = np.linalg.solve(dense.T @ dense + 0.01 * np.eye(60), dense.T @ w)
    rules = {"damp": 0.1, "atol": 1e-12, "btol": 1e-12, "conlim": 0}
    assert error(linalg.lsqr(operator, w, iter_lim=1000, **rules)[0], exact) < 1e-6
    assert error(linalg.lsmr(operator, w, maxiter=1000, **rules)[0], exact) < 1e-6
    large = ff.plan("laplace_dipole", X, targets=Y).as_linear_operator()
    w, q = RANDOM.random(400), RANDOM.random(9000)
    u = large @ q
    assert abs(w @ u - q @ (large.T @ w)) < 2e-6 * np.linalg.norm(w) * np.linalg.norm(u)
    with pytest.raises(ff.InputError, match="derivatives"):
        ff.plan("r", X[:10], gradient=True).T


def test_linear_operators_solve():
    linalg = pytest.importorskip("scipy.sparse.linalg")
    operator = ff.plan("exp(-10*r)", X[:300], coincident="formula", tolerance=1e-9).as_linear_operator()
    solution, state = linalg.cg(operator, Q[:300], rtol=1e-8, maxiter=2000)
    assert state == 0 and error(operator @ solution, Q[:300]) < 1e-6
    several = RANDOM.random((300, 4))
    products = operator @ several
    assert products.shape == (300, 4)
    assert all(error(products[:, k], operator @ several[:, k]) < 1e-9 for k in range(4))
    assert error(operator.T @ several, products) < 1e-9, "the kernel is symmetric"
    vectors = ff.plan("stokeslet", X[:10]).as_linear_operator()
    assert (vectors @ np.ones((30, 2))).shape == (30, 2)
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


def test_operators_are_brought_to_another_process(tmp_path):
    folder = tmp_path / "operators"
    text = "plan = ff.plan('exp(-k*r)/(r+0.1)', X, k=3.0, tolerance=1e-3, applications=1000)"
    points = "import sys, farfield as ff, numpy as np; X = np.random.default_rng(5).random((4000, 3)); Q = np.ones(4000)"
    first = f"{points}; {text}; u = plan(Q); assert ff.save_operators(sys.argv[1]) == 1; print(u.tobytes().hex())"
    second = f"{points}; assert ff.load_operators(sys.argv[1]) == 1; {text}; print(plan(Q).tobytes().hex())"

    def run(code):
        # Not from the folder of the sources, which have no native part.
        command = [sys.executable, "-c", code, str(folder)]
        return subprocess.run(command, check=True, capture_output=True, cwd=tmp_path).stdout

    assert run(first) == run(second)
    file = next(folder.iterdir())
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)
    with pytest.raises(ff.InputError, match="is damaged"):
        ff.load_operators(folder)
    with pytest.raises(OSError, match="nowhere"):
        ff.load_operators(tmp_path / "nowhere")
