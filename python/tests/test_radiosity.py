"""Light between the faces of meshes, held against what is known in closed form."""

import numpy as np
import pytest

import farfield as ff
from farfield import radiosity

CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
# The faces of a cube as they look inwards: bottom, top, front, back, left, right.
ROOM = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
# Of unit squares that face each other at a distance of 1, and that share an edge.
OPPOSITE, BESIDE = 0.199824895698387, 0.200043776075403


def test_factors_of_a_cube():
    factors = radiosity.form_factors(CORNERS, ROOM)
    expected = np.full((6, 6), BESIDE)
    for face in range(6):
        expected[face, face ^ 1], expected[face, face] = OPPOSITE, 0
    assert factors.shape == (6, 6) and factors.nnz == 30
    assert np.abs(factors.toarray() - expected).max() < 1e-12
    # Triangles are other faces, and see as much together.
    triangles = [half for a, b, c, d in ROOM for half in ([a, b, c], [a, c, d])]
    halves = radiosity.form_factors(CORNERS, triangles).toarray()
    whole = 0.5 * halves.reshape(6, 2, 6, 2).sum(axis=(1, 3))
    assert np.abs(whole - expected).max() < 1e-12


def test_factors_of_what_is_partly_hidden():
    blocker = [[0, 0, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0.5], [0, 0.5, 0.5]]
    vertices = np.vstack([CORNERS, blocker])
    faces = [ROOM[0], ROOM[1], [8, 9, 10, 11], [11, 10, 9, 8]]
    factors = radiosity.form_factors(vertices, faces).toarray()
    assert abs(factors[0, 1] - 0.75 * OPPOSITE) < 2e-4
    assert factors[2, 3] == factors[3, 2] == 0
    areas = np.array([1, 1, 0.25, 0.25])
    assert np.allclose(areas[:, None] * factors, (areas[:, None] * factors).T, rtol=0, atol=1e-15)


@pytest.mark.parametrize("bands", [1, 3, 4])
def test_a_furnace_glows_evenly(bands):
    rho = np.linspace(0.2, 0.8, bands)
    e = 1 + np.arange(bands)
    found = radiosity.solve(CORNERS, ROOM, np.tile(rho, (6, 1)), np.tile(e, (6, 1)), elements=600)
    assert found.radiosity.shape == (6, bands)
    assert np.abs(found.radiosity / (e / (1 - rho)) - 1).max() < 1e-3
    assert np.abs(found.row_sums - 1).max() < 1e-2 and np.allclose(found.areas, 1)


def test_a_lamp_lights_the_floor_as_its_form_factor_says():
    with pytest.warns(radiosity.AccuracyWarning):
        # So few elements are off by more than 1e-4.
        found = radiosity.solve(CORNERS, ROOM[:2], 0.0, [0.0, 2.0], tolerance=1e-4, elements=500)
    assert found.element_error > 1e-4
    assert np.abs(found.irradiance - [2 * OPPOSITE, 0]).max() < 1e-4
    assert np.array_equal(found.radiosity, [0, 2])


def test_adiabatic_walls_reflect_all():
    # Between a hot floor and a cold ceiling. On one element a face, the network of resistances is exact.
    sigma, hot, cold = 5.670374419e-8, 400.0, 300.0
    rho = np.array([0.2, 0.4, 1, 1, 1, 1])
    e = (1 - rho) * sigma * np.array([hot, cold, 0, 0, 0, 0]) ** 4
    with pytest.warns(radiosity.AccuracyWarning):
        found = radiosity.solve(CORNERS, ROOM, rho, e, tolerance=1e-4, elements=6)
    through = (1 + OPPOSITE) / 2
    expected = sigma * (hot**4 - cold**4) / (0.2 / 0.8 + 1 / through + 0.4 / 0.6)
    net = e - (1 - rho) * found.irradiance
    assert abs(net[0] / expected - 1) < 1e-4 and abs(net[:2].sum()) < 1e-4 * expected
    assert np.array_equal(net[2:], np.zeros(4))


def test_sky_above_a_yard():
    floor, wall = [0, 1, 3, 2], [2, 6, 7, 3]
    vertices = CORNERS * [40, 40, 40]
    sky, ground = radiosity.sky_view_factors(vertices, [floor], rays=1 << 12)
    assert sky == [1] and ground == [0]
    sky, ground = radiosity.sky_view_factors(vertices, [wall], rays=1 << 14)
    assert abs(sky[0] - 0.5) < 1e-3 and abs(ground[0] - 0.5) < 1e-3
    sky, _ = radiosity.sky_view_factors(vertices, [wall], overcast=True, rays=1 << 14)
    assert abs(sky[0] - (3 / 7) * (0.5 + 4 / (3 * np.pi))) < 2e-3
    # Lying down, the wall is a floor.
    sky, _ = radiosity.sky_view_factors(vertices, [wall], zenith=(0, 3, 0))
    assert sky == [1]
    both, _ = radiosity.sky_view_factors(vertices, [floor, [2, 3, 7, 6]], rays=1 << 14)
    assert abs(both[0] - (1 - BESIDE)) < 1e-3


@pytest.mark.parametrize("package, box", [("trimesh", "creation.box"), ("pyvista", "Cube")])
def test_meshes_of_other_packages(package, box):
    maker = pytest.importorskip(package)
    for name in box.split("."):
        maker = getattr(maker, name)
    mesh = maker()
    factors = radiosity.form_factors(mesh)
    sky, ground = radiosity.sky_view_factors(mesh)
    # From outside, no face of a box sees another.
    assert factors.nnz == 0 and len(sky) == factors.shape[0] in (6, 12)
    assert np.abs(sky + ground - 1).max() < 1e-3
    assert {*sky.round(2)} == {0, 0.5, 1}


def test_what_nothing_is_exchanged_by_is_said():
    outwards = [face[::-1] for face in ROOM]
    with pytest.warns(radiosity.AccuracyWarning), pytest.warns(radiosity.MeshWarning, match="a room has to look inwards"):
        found = radiosity.solve(CORNERS, outwards, 0.5, 1.0, elements=600)
    assert np.array_equal(found.irradiance, np.zeros(6))


def test_a_small_bright_lamp_lights_its_room():
    lamp = np.array([[0.5, 0.5, 0.9], [0.501, 0.5, 0.9], [0.501, 0.501, 0.9], [0.5, 0.501, 0.9]])
    vertices = np.vstack([CORNERS, lamp])
    faces = [*ROOM, [8, 9, 10, 11], [11, 10, 9, 8]]
    reflectance, emission = np.array([0.8] * 6 + [0] * 2), np.array([0.0] * 6 + [1e6, 0])
    with pytest.warns(radiosity.AccuracyWarning):
        found = radiosity.solve(vertices, faces, reflectance, emission, elements=1500)
    absorbed = found.areas @ ((1 - reflectance) * found.irradiance)
    assert abs(absorbed - 1) < 0.02 and found.irradiance[:6].min() > 0.5


def test_what_is_no_mesh_is_refused():
    with pytest.raises(ff.InputError, match="a float without faces"):
        radiosity.form_factors(1.0)


def test_what_is_mended_is_said():
    faces = [*ROOM, ROOM[0], [0, 1, 1]]
    with pytest.warns(radiosity.MeshWarning) as said:
        found = radiosity.solve(CORNERS, faces, 0.5, 1.0, elements=600)
    messages = [str(warning.message) for warning in said]
    assert "duplicate faces, dropped: 1" in messages and "faces without area, dropped: 1" in messages
    assert np.array_equal(np.isnan(found.radiosity), [False] * 6 + [True] * 2)
    assert np.allclose(found.areas, [1] * 6 + [0] * 2)


def refused(*arguments, **named):
    with pytest.raises(ff.InputError) as error:
        radiosity.solve(*arguments, **named)
    return str(error.value)


def test_what_is_no_scene_is_refused():
    bad = CORNERS.copy()
    bad[3, 1] = np.nan
    assert refused(bad, ROOM) == "vertices[3] is [1.0, nan, 0.0]: expected finite coordinates"
    assert refused(CORNERS[:, :2], ROOM).startswith("vertices have shape (8, 2)")
    assert refused(CORNERS, [[0, 1, 8]]) == "faces[0] has a corner at vertex 8: expected 0 to 7"
    assert refused(CORNERS, [[0, 1, 2], [0, -1, 2]]).startswith("faces[1] has a corner at vertex -1")
    assert refused(CORNERS, [[0, 1]]).startswith("faces[0] is [0, 1]: expected the numbers")
    assert refused(CORNERS, [[0.0, 1.0, 2.0]]).startswith("faces[0] is [0.0, 1.0, 2.0]")
    assert refused(CORNERS, 3).startswith("faces is int")
    assert "emission is 0 everywhere" in refused(CORNERS, [], 0.5, [])
    rho = np.full((6, 2), 0.5)
    rho[4, 1] = 1.5
    message = "the reflectance of face 4 is 1.5 in band 1: expected 0 to 1"
    assert refused(CORNERS, ROOM, rho, 1.0) == message
    assert refused(CORNERS, ROOM, 0.5, -1.0).startswith("the emission of face 0 is -1.0 in band 0")
    assert refused(CORNERS, ROOM, 0.5, np.inf).startswith("the emission of face 0 is inf")
    assert refused(CORNERS, ROOM) == "emission is 0 everywhere: expected a face that emits"
    assert refused(CORNERS, ROOM, 0.5, np.ones(5)).startswith("emission has shape (5,)")
    assert refused(CORNERS, ROOM, np.full((6, 2), 0.5), np.ones((6, 3))).startswith("reflectance has 2 bands")
    assert "absorbs anything" in refused(CORNERS, ROOM, 1.0, 1.0)
    for tolerance in (0.0, 1.0, np.nan):
        assert "tolerance" in refused(CORNERS, ROOM, 0.5, 1.0, tolerance=tolerance)
    assert refused(CORNERS, ROOM, 0.5, 1.0, elements=0).startswith("elements is 0")
    with pytest.raises(ff.InputError, match="zenith"):
        radiosity.sky_view_factors(CORNERS, ROOM, zenith=(0, 0, 0))
    with pytest.raises(ff.InputError, match="tolerance is 2.0"):
        radiosity.form_factors(CORNERS, ROOM, tolerance=2)
