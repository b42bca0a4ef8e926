"""Light in a room with furniture, from meshes of trimesh, shown by matplotlib."""

import farfield as ff
import matplotlib
import numpy as np
import trimesh

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

# A room of 4 x 5 x 2.5 m looks inwards, a table and a cupboard in it outwards.
room = trimesh.creation.box((4, 5, 2.5))
room.invert()
table = trimesh.creation.box((1.6, 0.8, 0.1), transform=trimesh.transformations.translation_matrix((0, 0, -0.5)))
cupboard = trimesh.creation.box((0.6, 2, 2), transform=trimesh.transformations.translation_matrix((-1.6, 0, -0.2)))
mesh = trimesh.util.concatenate([part.subdivide_to_size(0.3) for part in (room, table, cupboard)])

# A part of the ceiling is the lamp.
centres = mesh.triangles_center
is_lamp = (centres[:, 2] > 1.24) & (np.abs(centres[:, :2]).max(axis=1) < 0.8)
emission = np.where(is_lamp, 1000.0, 0.0)
reflectance = np.where(is_lamp, 0.0, 0.7)
light = ff.radiosity.solve(mesh, reflectance=reflectance, emission=emission, tolerance=0.05)

areas = light.areas
emitted = areas @ emission
absorbed = areas @ ((1 - reflectance) * light.irradiance)
print(f"{light.elements} elements: {emitted:.0f} W emitted, {absorbed:.0f} W absorbed")
assert abs(absorbed / emitted - 1) < 1e-2, "light was made or lost"
# It is darker below the table than beside it.
floor = np.isclose(centres[:, 2], -1.25)
below = floor & (np.abs(centres[:, 0]) < 0.6) & (np.abs(centres[:, 1]) < 0.3)
assert light.irradiance[below].mean() < 0.8 * light.irradiance[floor].mean()

# What looks at the viewer: the ceiling and two walls are not in the way.
elevation, azimuth = np.radians([30, -50])
eye = [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
shown = mesh.face_normals @ eye > 0
figure = plt.figure(figsize=(8, 6))
axes = figure.add_axes((0, 0, 0.85, 1), projection="3d")
faces = Poly3DCollection(mesh.triangles[shown], cmap="inferno", linewidths=0)
faces.set_array(light.radiosity[shown])
axes.add_collection3d(faces)
axes.set(xlim=(-2.5, 2.5), ylim=(-2.5, 2.5), zlim=(-1.25, 1.25))
axes.set_box_aspect((5, 5, 2.5))
axes.view_init(np.degrees(elevation), np.degrees(azimuth))
axes.set_axis_off()
figure.colorbar(faces, cax=figure.add_axes((0.85, 0.25, 0.02, 0.5)), label="radiosity, W/m²")
figure.savefig("room.png", dpi=120)
print("wrote room.png")
