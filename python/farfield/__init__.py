"""Fast sums u(x_i) = sum_j K(x_i, y_j) q_j for any kernel, to the tolerance asked for.

>>> import numpy as np, farfield as ff
>>> x = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
>>> ff.sum("1/r", x, np.array([1.0, 3.0]))
array([6., 2.])

`sum` does it once, `plan` for many charges, and `kernels` lists the kernels that have names. Every other string is a
formula of r, r2 (r squared), d1 d2 d3 (x - y), x1 x2 x3 (the target), y1 y2 y3 (the source) and parameters, with
+ - * / ^, exp log sqrt sin cos tanh erf erfc abs min max, where(a < b, yes, no), and tensors as lists of rows,
"[[a, b], [c, d]]". A pair at one place is skipped, unless `coincident` or a kernel by name says otherwise.
"""

from __future__ import annotations

import os
from typing import Any, Mapping, NamedTuple, Union

import numpy as np

from . import _native, radiosity
from ._arrays import array, count, number
from ._errors import Error, InputError, KernelError, SumError, ToleranceError

__all__ = [
    "Certificate",
    "Error",
    "InputError",
    "KernelError",
    "KernelInfo",
    "Plan",
    "SumError",
    "ToleranceError",
    "kernels",
    "load_operators",
    "plan",
    "radiosity",
    "save_operators",
    "sum",
]


class Certificate(NamedTuple):
    """How far a sum is from the exact one, from direct sums at sampled targets."""

    relative_l2: float
    """With probability `confidence` at least, the relative l2 error over all targets is no more than this."""
    estimate: float
    """The estimate that this bound stands on."""
    confidence: float
    samples: int
    condition: float
    """How far the sums cancel: 1 or more."""


class KernelInfo(NamedTuple):
    """A kernel that has a name."""

    name: str
    about: str
    formula: str
    parameters: dict
    """The parameters and their values, unless others are given."""


def kernels() -> list:
    """All kernels that have names, as a list of `KernelInfo`."""
    return [KernelInfo(name, about, text, dict(given)) for name, about, text, given in _native.kernels()]


def save_operators(folder: Union[str, "os.PathLike[str]"]) -> int:
    """Writes what plans of this process prepared for their kernels to a folder, which is made if need be.

    Another process that calls `load_operators` plans the same kernels at the same tolerances in a fraction of the time, with
    the same results. Returns how many sets of operators were written or were there already. The process keeps half a
    gigabyte of them; files are of one version of farfield and one kind of processor, and several may share a folder.

    Raises OSError for a folder that can't be written.
    """
    return _native.save_operators(os.fspath(folder))


def load_operators(folder: Union[str, "os.PathLike[str]"]) -> int:
    """Reads what `save_operators` wrote to a folder, for later plans. Returns how many sets of operators there were.

    Raises OSError for a folder that can't be read, and `InputError` for a file in it that was changed.
    """
    return _native.load_operators(os.fspath(folder))


def sum(
    kernel: str,
    x: Any,
    q: Any,
    *,
    targets: Any = None,
    tolerance: float = 1e-6,
    gradient: bool = False,
    hessian: bool = False,
    threads: Union[int, None] = None,
    coincident: Union[str, float, None] = None,
    parameters: Union[Mapping[str, float], None] = None,
    **more: float,
) -> Any:
    """The sums u_i = sum_j K(x_i, y_j) q_j over all sources, at all targets.

    kernel: the name of a kernel (see `kernels`) or a formula, such as "exp(-k*r)/r".
    x: the sources, shape (N, 3), float64 or float32; everything is summed in its precision.
    q: the charges: shape (N,), or (N, k) for k right-hand sides of a scalar kernel, or (N, c) for a tensor with c columns.
    targets: where sums are wanted, shape (M, 3); the sources themselves by default.
    tolerance: the relative l2 error to stay below.
    gradient: whether derivatives with respect to the target are wanted too.
    hessian: whether second derivatives are, and first ones.
    threads: how many threads to use; as many as there are cores by default.
    coincident: what holds for a source and a target at one place: "skip", "formula" (what the formula gives there), or a
        number. By default "skip" for a formula, and what a kernel by name is known for.
    parameters: the parameters of the kernel by name, such as {"k": 2.0}; or each by itself, as k=2.0, unless an argument of
        this function has its name.

    Returns u of shape (M,), (M, k), or (M, f) for a tensor with f rows; with `gradient`, a pair (u, du) where du has one
    more axis, of length 3; with `hessian`, three arrays (u, du, ddu) where ddu has two more axes of length 3. Right-hand
    sides are summed together, which takes less than one after the other; their accuracy is that of all together, each
    brought to the same size first.

    Ctrl-C ends it with KeyboardInterrupt.

    Raises `InputError` (a ValueError) that names what is wrong, `KernelError` for a kernel, `ToleranceError` if the
    tolerance is out of reach, and `SumError` if a sum is not finite.
    """
    planned = plan(
        kernel,
        x,
        targets=targets,
        tolerance=tolerance,
        gradient=gradient,
        hessian=hessian,
        threads=threads,
        coincident=coincident,
        applications=1,
        columns=_columns(q),
        parameters=parameters,
        **more,
    )
    return planned(q)


def plan(
    kernel: str,
    x: Any,
    *,
    targets: Any = None,
    tolerance: float = 1e-6,
    gradient: bool = False,
    hessian: bool = False,
    threads: Union[int, None] = None,
    coincident: Union[str, float, None] = None,
    applications: int = 1,
    columns: int = 1,
    parameters: Union[Mapping[str, float], None] = None,
    **more: float,
) -> "Plan":
    """A plan for sums between fixed points, which is applied to any number of charges.

    applications: how often it will be applied, about: set-up that pays for itself by then is done.
    columns: to how many right-hand sides at once, about. Any number may be given, but with another one the first
        application sets up more.

    The other arguments and the errors are those of `sum`.
    """
    derivatives = 2 if hessian else int(bool(gradient))
    given = _parameters(parameters, more)
    return Plan(kernel, x, targets, tolerance, derivatives, threads, coincident, applications, columns, given)


class Plan:
    """A plan made by `plan`. Call it with charges."""

    def __init__(
        self,
        kernel: str,
        x: Any,
        targets: Any,
        tolerance: float,
        derivatives: int,
        threads: Union[int, None],
        coincident: Union[str, float, None],
        applications: int,
        columns: int,
        parameters: dict,
    ) -> None:
        if not isinstance(kernel, str):
            raise KernelError(f"kernel is {type(kernel).__name__}: expected a name or a formula, as a str")
        try:
            kernel.encode()
        except UnicodeEncodeError as error:
            raise KernelError(f"kernel is {kernel!a}: expected a name or a formula, without lone surrogates") from error
        sources = _points("x", x, None)
        self.dtype = sources.dtype
        targets = sources if targets is None else _points("targets", targets, self.dtype)
        rule, value = _rule(coincident)
        given = [(name, number(name, value)) for name, value in parameters.items()]
        parsed = _native.Kernel(kernel, given, rule, value)
        native = _native.PlanF64 if self.dtype == np.float64 else _native.PlanF32
        self._fields, self._densities = parsed.shape
        self._sources, self._targets = len(sources), len(targets)
        self._derivatives = derivatives
        self._transposed: Union[Plan, None] = None
        self._native = native(
            parsed,
            sources.reshape(-1),
            targets.reshape(-1),
            number("tolerance", tolerance),
            derivatives,
            count("applications", applications),
            # A tensor takes one right-hand side at a time.
            count("columns", columns) if self._densities == 1 else 1,
            None if threads is None else count("threads", threads, 512),
        )

    @property
    def _numbers(self) -> int:
        """How many numbers there are for one value: itself, 3 first and 6 second derivatives."""
        return (1, 4, 10)[self._derivatives]

    @property
    def gradient(self) -> bool:
        """Whether first derivatives are summed."""
        return self._derivatives > 0

    @property
    def hessian(self) -> bool:
        """Whether second derivatives are summed."""
        return self._derivatives > 1

    @property
    def T(self) -> "Plan":
        """The plan for the transposed matrix: sums at the sources, of K(x_i, y_j) transposed, for numbers at the targets.

        It is made when it is first asked for, and is a plan of its own: both matrices are as near to the exact ones as
        the tolerance says. They are the transposes of each other but for rounding where both sum directly.
        """
        if self._derivatives:
            raise InputError("a plan with derivatives gives more than a matrix: expected gradient=False, hessian=False")
        if self._transposed is None:
            other = object.__new__(Plan)
            other.dtype, other._derivatives, other._transposed = self.dtype, 0, self
            other._fields, other._densities = self._densities, self._fields
            other._sources, other._targets = self._targets, self._sources
            other._native = self._native.transposed()
            self._transposed = other
        return self._transposed

    @property
    def shape(self) -> tuple:
        """Of the matrix that the plan applies: numbers of all targets, numbers of all sources."""
        return (self._targets * self._fields, self._sources * self._densities)

    def __repr__(self) -> str:
        more = ("", ", gradient=True", ", hessian=True")[self._derivatives]
        return f"<farfield.Plan: {self._sources} sources, {self._targets} targets, {self.dtype}{more}>"

    def __call__(self, q: Any) -> Any:
        """The sums for charges q, as `sum` returns them."""
        charges = array("q", q)
        if self._densities > 1 or charges.ndim == 1:
            return self._apply(self._charges(charges))
        return self._apply_columns(charges)

    apply = __call__

    def certificate(self, q: Any) -> Certificate:
        """How far the sums for charges q, of one right-hand side, are from the exact ones. Sums once more."""
        charges = array("q", q)
        if self._densities == 1 and charges.ndim == 2:
            expected = f"({self._sources},), one right-hand side at a time"
            raise InputError(f"q has shape {charges.shape}: expected {expected}")
        return Certificate(**self._native.certificate(self._charges(charges).reshape(-1)))

    def report(self) -> dict:
        """What the plan consists of: sizes, pairs of each kind, and a table as "text"."""
        return self._native.report()

    def as_linear_operator(self) -> Any:
        """The plan as a scipy.sparse.linalg.LinearOperator of `shape`, for conjugate gradients and the like.

        Products with the transposed matrix, as least squares ask for, are those of `T`.
        """
        from scipy.sparse.linalg import LinearOperator

        if self._derivatives:
            raise InputError("a plan with gradients gives more than a matrix: expected gradient=False")

        def product(q: Any) -> Any:
            return self._flat(q)

        def transposed(w: Any) -> Any:
            return self.T._flat(w)

        operator_of = dict(matvec=product, rmatvec=transposed, dtype=self.dtype)
        if self._fields == self._densities == 1:
            # Columns of a matrix together take less than one after the other.
            operator_of.update(matmat=self, rmatmat=lambda w: self.T(w))
        return LinearOperator(self.shape, **operator_of)

    def _flat(self, q: Any) -> Any:
        """The sums for charges in one row, in one row."""
        shape = (self._sources, self._densities) if self._densities > 1 else (self._sources,)
        return self(np.reshape(q, shape)).reshape(-1)

    def _charges(self, charges: Any) -> Any:
        """Charges of one right-hand side as a contiguous array."""
        tensor = self._densities > 1
        expected = (self._sources, self._densities) if tensor else (self._sources,)
        if charges.shape != expected:
            columns = "" if tensor else f", or ({self._sources}, k) for k right-hand sides"
            raise InputError(f"q has shape {charges.shape}: expected {expected}{columns}")
        return np.ascontiguousarray(_real("q", charges, self.dtype))

    def _apply(self, charges: Any) -> Any:
        values = self._native.apply(charges.reshape(-1), 1)
        tensor = (self._fields,) if self._fields > 1 or self._densities > 1 else ()
        return self._parts(values.reshape(self._targets, self._numbers, self._fields), tensor)

    def _apply_columns(self, charges: Any) -> Any:
        if charges.ndim != 2 or len(charges) != self._sources:
            expected = f"({self._sources},), or ({self._sources}, k) for k right-hand sides"
            raise InputError(f"q has shape {charges.shape}: expected {expected}")
        k = charges.shape[1]
        charges = np.ascontiguousarray(_real("q", charges, self.dtype))
        values = self._native.apply(charges.reshape(-1), k) if k else np.empty(0, self.dtype)
        values = values.reshape(self._targets, self._numbers, self._fields, k).transpose(0, 1, 3, 2)
        return self._parts(values, (k, self._fields) if self._fields > 1 else (k,))

    def _parts(self, values: Any, tail: tuple) -> Any:
        """Values and derivatives from rows of all of them, each with the axes `tail`."""
        shape = (self._targets, *tail)
        u = values[:, 0].reshape(shape).copy()
        if not self._derivatives:
            return u
        du = np.moveaxis(values[:, 1:4], 1, -1).reshape((*shape, 3)).copy()
        if self._derivatives == 1:
            return u, du
        # The second derivatives along axes 11, 12, 13, 22, 23, 33.
        second = values[:, [4, 5, 6, 5, 7, 8, 6, 8, 9]]
        return u, du, np.moveaxis(second, 1, -1).reshape((*shape, 3, 3)).copy()


def _columns(q: Any) -> int:
    """How many right-hand sides charges have, if they are such."""
    shape: Any = getattr(q, "shape", ())
    return max(1, min(int(shape[1]), 2**31)) if len(shape) == 2 else 1


def _points(name: str, points: Any, dtype: Any) -> Any:
    points = array(name, points)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{name} has shape {points.shape}: expected (N, 3)")
    if dtype is None:
        dtype = np.dtype(np.float32 if points.dtype == np.float32 else np.float64)
    return np.ascontiguousarray(_real(name, points, dtype))


def _real(name: str, array: Any, dtype: Any) -> Any:
    if array.dtype.kind not in "fiu":
        raise InputError(f"{name} has elements of type {array.dtype}: expected real numbers, float64 or float32")
    with np.errstate(over="ignore"):
        numbers = array.astype(dtype, copy=False)
    if dtype == np.float32 and np.any(np.isinf(numbers) & np.isfinite(array)):
        raise InputError(f"{name} has numbers beyond the largest of float32, the precision of x")
    return numbers


def _parameters(parameters: Any, more: dict) -> dict:
    """The parameters of a kernel, wherever they are given."""
    if parameters is None:
        return more
    if not isinstance(parameters, Mapping) or not all(isinstance(name, str) for name in parameters):
        raise InputError(f"parameters is {parameters!r}: expected names and their values, such as {{'k': 2.0}}")
    twice = sorted(parameters.keys() & more.keys())
    if twice:
        raise InputError(f"{twice[0]} is given twice: expected it in parameters, or by itself")
    return {**parameters, **more}


def _rule(coincident: Any) -> tuple:
    if coincident is None:
        return None, 0.0
    if isinstance(coincident, str):
        if coincident in ("skip", "formula"):
            return coincident, 0.0
        raise InputError(f'coincident is {coincident!r}: expected "skip", "formula" or a number')
    return "value", number("coincident", coincident)
