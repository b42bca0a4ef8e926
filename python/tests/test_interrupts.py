"""Ctrl-C while something is summed."""

import os
import signal
import threading

import farfield as ff
import numpy as np
import pytest

RANDOM = np.random.default_rng(1)
X = RANDOM.random((200_000, 3))
Q = np.ones(200_000)
SLOW = "erfc(r)/r + sin(30*x1)*cos(3*y2)*exp(-3*r)"


def interrupted(work, after):
    """Does work, and sends SIGINT some time after its begin."""
    timer = threading.Timer(after, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            work()
    finally:
        timer.cancel()
        timer.join()


@pytest.mark.parametrize("after", [0.2, 0.6])
def test_sums_end_on_ctrl_c(after):
    # A position in the formula, and all digits: minutes of work.
    interrupted(lambda: ff.sum(SLOW, X, Q, tolerance=1e-12), after)


def test_plans_serve_after_ctrl_c():
    # Directly, since it is not smooth: minutes of work.
    x, q = X[:60_000], Q[:60_000]
    plan = ff.plan("sin(1e5*r)*erfc(r)*exp(-r)/r", x)
    interrupted(lambda: plan(q), 0.3)
    interrupted(lambda: plan(np.stack([q] * 40, axis=1)), 0.3)
    small = ff.plan("laplace", X[:20_000])
    exact = small(Q[:20_000])
    assert (small(Q[:20_000]) == exact).all()
