"""Diffuse light, or radiant heat, between the faces of a mesh, past all that stands between them.

>>> import farfield as ff
>>> vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
>>> faces = [[0, 1, 2, 3], [4, 7, 6, 5]]
>>> ff.radiosity.form_factors(vertices, faces).toarray().round(6)
array([[0.      , 0.199825],
       [0.199825, 0.      ]])

A mesh is an array of vertices, (V, 3), and its faces: an array of the numbers of their corners, (F, 3) or (F, 4), or a list
of rows of any length. Or it is one object that has them: a trimesh.Trimesh, or a pyvista.PolyData. The corners of a face run
counter-clockwise around its front, which radiates and receives. Its back only hides: a sheet that is lit on both sides is two
faces, one with its corners in reverse order.
"""

from __future__ import annotations

import warnings
from typing import Any, NamedTuple, Tuple, Union

import numpy as np

from . import _native
from ._arrays import array, count, number
from ._errors import InputError

__all__ = ["AccuracyWarning", "MeshWarning", "Solution", "form_factors", "sky_view_factors", "solve"]


# The error of all light together that goes without saying.
_LEVEL = 0.05


class MeshWarning(UserWarning):
    """A mesh was mended, or may be meant otherwise than it was taken."""


class AccuracyWarning(UserWarning):
    """A result is further off than the tolerance. The message says by how much."""


class Solution(NamedTuple):
    """The light on all faces: the means over each of them. Of faces that were dropped it is NaN."""

    radiosity: Any
    """B, what leaves a face, in the units of the emission: shape (F,), or (F, k) for k bands."""
    irradiance: Any
    """H, what arrives at it, alike."""
    row_sums: Any
    """The sum of the form factors of a face to all others, shape (F,): 1 in a closed room, before it is closed exactly."""
    areas: Any
    """The areas of faces, shape (F,); 0 for faces that were dropped."""
    elements: int
    """Into how many elements the faces were cut."""
    iterations: int
    residual: float
    """The relative residual of B = E + rho H."""
    element_error: Union[float, None]
    """The relative l2 error of taking the light to be constant on each element; None if it isn't known."""
    factor_error: float
    """By how much the form factors of an element are off in all, from rays; 0 where rays can't tell, below about 3e-4."""
    reflections: float
    """How often light is reflected, on average, where some of it leaves the scene: as often, that error comes in."""


def solve(
    vertices: Any,
    faces: Any = None,
    reflectance: Any = 0.5,
    emission: Any = 0.0,
    *,
    tolerance: float = 1e-2,
    elements: int = 200_000,
    threads: Union[int, None] = None,
) -> Solution:
    """Solves B = E + rho H(B): what faces emit and how often it is reflected, until it is absorbed or leaves.

    vertices, faces: the mesh; see `farfield.radiosity`.
    reflectance: rho, from 0 to 1: one number, one for each face, or shape (F, k) for k bands. With 1, a face is adiabatic.
    emission: E, the exitance of faces, alike. For heat it is (1 - rho) sigma T^4.
    tolerance: the relative l2 error of the irradiance to stay below.
    elements: faces are cut into as many elements as the tolerance takes, but into no more than this.
    threads: how many threads to use; as many as there are cores by default.

    Faces that close a room without gaps keep all light in it. Ctrl-C ends it with KeyboardInterrupt.

    Warns with `MeshWarning` of what was mended, and with `AccuracyWarning` if the tolerance is missed.
    Raises `InputError` that names what is wrong, and `SumError` if the light doesn't settle.
    """
    points, corners, sizes = _mesh(vertices, faces)
    rho = _optics("reflectance", reflectance, len(sizes))
    e = _optics("emission", emission, len(sizes))
    bands = max(rho.shape[1], e.shape[1])
    for name, values in (("reflectance", rho), ("emission", e)):
        if values.shape[1] not in (1, bands):
            raise InputError(f"{name} has {values.shape[1]} bands: expected {bands}, or one number for each face")
    _check("reflectance", rho, (rho >= 0) & (rho <= 1), "0 to 1")
    _check("emission", e, (e >= 0) & np.isfinite(e), "a finite number, 0 or more")
    if not e.any():
        raise InputError("emission is 0 everywhere: expected a face that emits")
    shape = (len(sizes), bands)
    room = _room(points, corners, sizes, np.hstack([np.broadcast_to(rho, shape), np.broadcast_to(e, shape)]), threads)
    tolerance = number("tolerance", tolerance)
    found = room.solve(count("elements", elements), tolerance)
    lost = found["areas"] == 0
    flat = np.ndim(reflectance) < 2 and np.ndim(emission) < 2
    for name in ("radiosity", "irradiance"):
        light = found[name].reshape(shape)
        light[lost] = np.nan
        found[name] = light[:, 0] if flat else light
    found["row_sums"][lost] = np.nan
    solution = Solution(**found)
    if len(sizes) >= 4 and not found["row_sums"][~lost].any():
        _warn(MeshWarning, "no face sees the front of another, so nothing is exchanged: a room has to look inwards")
    if solution.element_error is None:
        _warn(AccuracyWarning, f"it isn't known how far constants on {solution.elements} elements are off")
    elif solution.element_error > tolerance:
        _warn(AccuracyWarning, f"constants on {solution.elements} elements are off by {solution.element_error:.1e}")
    level = solution.factor_error * max(1.0, solution.reflections)
    if level > max(tolerance, _LEVEL):
        _warn(
            AccuracyWarning,
            f"form factors of an element are off by {solution.factor_error:.1e} in all, and light is reflected "
            f"{solution.reflections:.1f} times before it leaves: all of it may be off by {min(level, 1.0):.0%}",
        )
    return solution


def form_factors(
    vertices: Any, faces: Any = None, *, tolerance: float = 1e-4, threads: Union[int, None] = None
) -> Any:
    """The form factors F_ij between all faces: the share of the light that leaves face i and arrives at face j.

    vertices, faces: the mesh; see `farfield.radiosity`.
    tolerance: by how much a factor may be off, about. Where nothing stands between two faces, theirs is exact.
    threads: how many threads to use; as many as there are cores by default.

    Returns a scipy.sparse.csr_array of shape (F, F). What a row lacks to 1 goes to the sky and to the backs of faces. It takes
    time in proportion to the pairs of faces: for more than some ten thousand, `solve` does without the matrix.

    Warns with `MeshWarning`, raises `InputError`, and is ended by Ctrl-C, as `solve`.
    """
    from scipy.sparse import coo_array

    points, corners, sizes = _mesh(vertices, faces)
    tolerance = number("tolerance", tolerance)
    if not 0 < tolerance < 1:
        raise InputError(f"tolerance is {tolerance}: expected a number between 0 and 1, both excluded")
    room = _room(points, corners, sizes, np.zeros((len(sizes), 2)), threads)
    rows, columns, values = room.form_factors(tolerance)
    return coo_array((values, (rows, columns)), shape=(len(sizes), len(sizes))).tocsr()


def sky_view_factors(
    vertices: Any,
    faces: Any = None,
    *,
    zenith: Any = (0.0, 0.0, 1.0),
    overcast: bool = False,
    rays: int = 4096,
    threads: Union[int, None] = None,
) -> Tuple[Any, Any]:
    """What each face sees of the sky above the horizon, and of the ground around the mesh below it.

    vertices, faces: the mesh; see `farfield.radiosity`.
    zenith: which way is up, a vector of any length.
    overcast: whether the sky is the overcast one of the CIE, three times as bright in the zenith as at the horizon. The
        first result is then the irradiance of a face over that of an open horizontal plane.
    rays: how many rays leave each face. Results are off by 0.5 / sqrt(rays) at most, about, and by less as a rule.
    threads: how many threads to use; as many as there are cores by default.

    Returns two arrays of shape (F,): sky and ground, from 0 to 1; NaN for faces that were dropped.

    Warns with `MeshWarning`, raises `InputError`, and is ended by Ctrl-C, as `solve`.
    """
    points, corners, sizes = _mesh(vertices, faces)
    up = array("zenith", zenith)
    if up.shape != (3,) or up.dtype.kind not in "fiu":
        raise InputError(f"zenith is {zenith!r}: expected three numbers")
    room = _room(points, corners, sizes, np.zeros((len(sizes), 2)), threads)
    return room.daylight([float(x) for x in up], bool(overcast), count("rays", rays, 2**24))


def _mesh(vertices: Any, faces: Any) -> Tuple[Any, Any, Any]:
    """Vertices, the numbers of the corners of all faces, and how many each face has."""
    if faces is None:
        vertices, faces = _parts(vertices)
    points = array("vertices", vertices)
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":
        raise InputError(f"vertices have shape {points.shape} and type {points.dtype}: expected real numbers, (V, 3)")
    points = np.ascontiguousarray(points, np.float64)
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if bad.size:
        raise InputError(f"vertices[{bad[0]}] is {points[bad[0]].tolist()}: expected finite coordinates")
    corners, sizes = _corners(faces)
    missing = np.flatnonzero((corners < 0) | (corners >= len(points)))
    if missing.size:
        face = np.searchsorted(np.cumsum(sizes), missing[0], side="right")
        raise InputError(f"faces[{face}] has a corner at vertex {corners[missing[0]]}: expected 0 to {len(points) - 1}")
    return points, corners, sizes


def _corners(faces: Any) -> Tuple[Any, Any]:
    """The corners of all faces, one face after the other, and how many each has."""
    if isinstance(faces, np.ndarray) and faces.ndim == 2 and faces.shape[1] >= 3 and faces.dtype.kind in "iu":
        return np.asarray(faces).reshape(-1), np.full(len(faces), faces.shape[1])
    try:
        polygons = [np.asarray(corners) for corners in faces]
    except (TypeError, ValueError):
        raise InputError(f"faces is {type(faces).__name__}: expected rows of numbers of vertices") from None
    for face, corners in enumerate(polygons):
        if corners.ndim != 1 or len(corners) < 3 or corners.dtype.kind not in "iu":
            raise InputError(f"faces[{face}] is {corners.tolist()}: expected the numbers of three vertices or more")
    flat = np.concatenate(polygons) if polygons else np.empty(0, np.int64)
    return flat, np.array([len(corners) for corners in polygons], np.int64)


def _parts(mesh: Any) -> Tuple[Any, Any]:
    """Vertices and faces of an object that has both."""
    faces = getattr(mesh, "faces", None)
    if faces is not None and hasattr(mesh, "vertices"):
        return mesh.vertices, faces
    if faces is not None and hasattr(mesh, "points"):
        # Each face is its number of corners, and then they.
        rows, flat = [], np.asarray(faces).reshape(-1)
        while flat.size:
            rows.append(flat[1 : 1 + flat[0]])
            flat = flat[1 + flat[0] :]
        return mesh.points, rows
    raise InputError(
        f"a {type(mesh).__name__} without faces: expected vertices and faces, or a mesh of trimesh or pyvista that has both"
    )


def _optics(name: str, given: Any, faces: int) -> Any:
    """Numbers of all faces as columns of bands."""
    values = array(name, given)
    if values.dtype.kind not in "fiu":
        raise InputError(f"{name} has elements of type {values.dtype}: expected real numbers")
    values = np.asarray(values, np.float64)
    if values.ndim == 0:
        return np.full((faces, 1), float(values))
    if values.ndim > 2 or len(values) != faces or (values.ndim == 2 and values.shape[1] == 0):
        raise InputError(f"{name} has shape {values.shape}: expected one number, ({faces},), or ({faces}, k) for k bands")
    return values if values.ndim == 2 else values[:, None]


def _check(name: str, values: Any, right: Any, expected: str) -> None:
    bad = np.argwhere(~right)
    if len(bad):
        face, band = bad[0]
        raise InputError(f"the {name} of face {face} is {values[face, band]} in band {band}: expected {expected}")


def _room(points: Any, corners: Any, sizes: Any, optics: Any, threads: Any) -> Any:
    room = _native.Room(
        points.reshape(-1),
        corners.astype(np.uint32),
        sizes.astype(np.uint32),
        np.ascontiguousarray(optics, np.float64).reshape(-1),
        optics.shape[1] // 2,
        None if threads is None else count("threads", threads, 512),
    )
    for note in room.notes():
        _warn(MeshWarning, note, 4)
    return room


def _warn(kind: Any, message: str, level: int = 3) -> None:
    # At the line that called `solve` or its like.
    warnings.warn(message, kind, stacklevel=level)
