"""Scenes around a mesh that the example grow_mesh grows: ground, sky, a small area lamp. Python standard library only."""
import pathlib
import re
import tempfile

import judge
import ply_table
from scene_mesh import Mesh, length, scan_scene, sub


def grow(grower, base, k, options, path):
    """Grows a mesh; returns its triangles, its vertices and what it cost."""
    done = judge.run([grower, base, "-k", k, "-o", path, *options])
    triangles, vertices = map(int, re.findall(r"\d+", done.text)[:2])
    return triangles, vertices, done


def bounds(grower, base, options):
    """The lowest and the highest coordinates of the mesh at k = 1, whose noise is that of every k."""
    with tempfile.TemporaryDirectory() as scratch:
        path = pathlib.Path(scratch) / "bounds.ply"
        grow(grower, base, 1, options, path)
        columns = list(zip(*ply_table.read(path).columns("x", "y", "z")))
    return tuple(map(min, columns)), tuple(map(max, columns))


def write(folder, box, up, about):
    """Writes ground.ply, light.ply and scene.toml around grown.ply, which stands on the ground; returns the scene's path."""
    low, high = box
    axis = "xyz".index(up)
    tall, size = high[axis] - low[axis], length(sub(high, low))
    middle = [(a + b) / 2 for a, b in zip(low, high)]

    def place(right, behind, above):
        """So far from the middle of the mesh along the two axes of the ground, so far above its foot."""
        point = list(middle)
        point[(axis + 1) % 3] += right
        point[(axis + 2) % 3] += behind
        point[axis] = low[axis] + above
        return tuple(point)

    def square(right, behind, above, half):
        mesh = Mesh()
        corners = [place(right + a * half, behind + b * half, above) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        mesh.polygon(corners, towards=place(right, behind, above + (size if above < 0 else -size)))
        return mesh

    # A hair below the foot, which between the base's vertices may be lower than them; the lamp is a third as wide as
    # the mesh is tall and casts soft shadows from half above it.
    (folder / "ground.ply").write_bytes(square(0, 0, -0.01 * tall, 10 * size).ply("ground"))
    (folder / "light.ply").write_bytes(square(0.6 * tall, -tall, 1.5 * tall, 0.15 * tall).ply("light, looks down"))
    eye, target = place(0.4 * tall, -2 * tall, 0.9 * tall), place(0, 0, 0.5 * tall)
    text = scan_scene(about, ("grown.ply", (0.7, 0.7, 0.7)), up, eye, target)
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    return folder / "scene.toml"
