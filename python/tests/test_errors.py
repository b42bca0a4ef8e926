"""What is refused, with which words."""

import os

import farfield as ff
import numpy as np
import pytest

X = np.zeros((4, 3)) + np.arange(4)[:, None]
Q = np.ones(4)


@pytest.mark.parametrize(
    "call, kind, words",
    [
        (lambda: ff.sum("1/r", X[:, :2], Q), ff.InputError, r"x has shape \(4, 2\): expected \(N, 3\)"),
        (lambda: ff.sum("1/r", X[0], Q), ff.InputError, r"x has shape \(3,\)"),
        (lambda: ff.sum("1/r", X, Q[:3]), ff.InputError, r"q has shape \(3,\): expected \(4,\), or \(4, k\)"),
        (lambda: ff.sum("1/r", X, np.ones((3, 2))), ff.InputError, r"q has shape \(3, 2\): expected \(4,\)"),
        (lambda: ff.sum("stokeslet", X, Q), ff.InputError, r"q has shape \(4,\): expected \(4, 3\)"),
        (lambda: ff.sum("1/r", X, Q, targets=[1, 2, 3]), ff.InputError, "targets has shape"),
        (lambda: ff.sum("1/r", X, Q * 1j), ff.InputError, "q has elements of type complex128"),
        (lambda: ff.sum("1/r", [["a"] * 3], Q), ff.InputError, "x has elements of type"),
        (lambda: ff.sum("1/r", X * np.nan, Q), ff.InputError, "source 0 is at .*expected finite"),
        (lambda: ff.sum("1/r", X, Q * np.inf), ff.InputError, "charge 0 is .*expected a finite charge"),
        (lambda: ff.sum("1/r", X, Q, tolerance=2), ff.InputError, "tolerance 2: expected a number between"),
        (lambda: ff.sum("1/r", X, Q, tolerance="a"), ff.InputError, "tolerance is 'a': expected a number"),
        (lambda: ff.sum("1/r", X, Q, threads=0), ff.InputError, "threads is 0: expected a whole number"),
        (lambda: ff.sum("1/r", X, Q, coincident="no"), ff.InputError, "coincident is 'no'"),
        (lambda: ff.sum(3, X, Q), ff.KernelError, "kernel is int"),
        (lambda: ff.plan("1/r", X).certificate(np.ones((4, 2))), ff.InputError, r"expected \(4,\), one right-hand side at a time"),
        (lambda: ff.sum("1/r\udc80", X, Q), ff.KernelError, "without lone surrogates"),
        (lambda: ff.sum("1/q", X, Q), ff.KernelError, 'the name "q" is unknown'),
        (lambda: ff.sum("1/r", X, Q, k=1), ff.KernelError, 'the parameter "k" does not occur'),
        (lambda: ff.sum("exp(-k*r)", X, Q, k="a"), ff.InputError, "k is 'a': expected a number"),
        (lambda: ff.sum("exp(-k*r)", X, Q, k=1, parameters={"k": 1}), ff.InputError, "k is given twice"),
        (lambda: ff.plan("exp(-k*r)", X, parameters=[1]), ff.InputError, r"parameters is \[1\]: expected names and their values"),
        (lambda: ff.plan("exp(-k*r)", X, parameters={1: 1}), ff.InputError, "expected names and their values"),
        (lambda: ff.sum("exp(i*r)", X, Q), ff.KernelError, "formulas here are real"),
        (lambda: ff.sum("stokslet", X, Q), ff.KernelError, "stokeslet perhaps"),
        (lambda: ff.sum("gaussian", X, Q, length=-1), ff.KernelError, '"length" of gaussian is -1: expected a number above 0'),
        (lambda: ff.sum("rpy", X, X, gradient=True), ff.InputError, "target 0 and source 0 are at one place, where"),
        (lambda: ff.plan("1/r", X, columns=0), ff.InputError, "columns is 0: expected a whole number"),
    ],
)
def test_input_is_refused_by_name(call, kind, words):
    with pytest.raises(kind, match=words) as caught:
        call()
    assert isinstance(caught.value, ff.Error) and isinstance(caught.value, ValueError)


def test_errors_in_texts_are_pointed_at():
    with pytest.raises(ff.KernelError) as caught:
        ff.sum("exp(-k*r)/q", X, Q, k=1.0)
    _, text, caret = str(caught.value).split("\n")
    assert text.index("q") == caret.index("^")


def test_empty_sets_are_valid():
    assert ff.sum("1/r", np.empty((0, 3)), []).shape == (0,)
    assert ff.sum("1/r", X, Q, targets=np.empty((0, 3))).shape == (0,)
    assert ff.sum("1/r", np.empty((0, 3)), [], targets=X).tolist() == [0] * 4


def test_masks_ragged_lists_and_numbers_beyond_the_precision_are_refused():
    x, q = np.zeros((3, 3)), np.ma.masked_array([1.0, 1e9, 1.0], [False, True, False])
    for arguments, words in [
        ((x, q), "q is a masked array"),
        (([[1, 2, 3], [1, 2]], q.data), "x is no array"),
        ((x.astype(np.float32), np.array([1.0, 1e300, 1.0])), "q has numbers beyond"),
    ]:
        with pytest.raises(ff.InputError, match=words):
            ff.sum("1/r", *arguments)
    with pytest.raises(ff.InputError, match="tolerance is 1000"):
        ff.sum("1/r", x, q.data, tolerance=10**400)


def test_a_forked_process_sums_with_threads_of_its_own():
    x, q = np.random.default_rng(1).random((500, 3)), np.ones(500)
    plan = ff.plan("1/r", x)
    expected = plan(q)

    def child():
        if not np.array_equal(ff.sum("1/r", x, q), expected):
            return 1
        try:
            plan(q)
        except ff.InputError as error:
            return 0 if "forked" in str(error) else 2
        return 3

    process = os.fork()
    if process == 0:
        os._exit(child())
    assert os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 0
