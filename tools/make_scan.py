#!/usr/bin/env python3
"""Writes scans to measure with: a bumpy ball on a ground plane under a white sky and a small area lamp; the same bytes everywhere.

    python3 tools/make_scan.py FOLDER                        the gentle one: every bump spans some six edges
    python3 tools/make_scan.py FOLDER --rough                knife edges below the triangles' size
    python3 tools/make_scan.py FOLDER --rough --subdivide    the same shape of 1,310,720 triangles instead of 327,680

FOLDER gets object.ply (float x y z and the smooth normals nx ny nz), ground.ply, light.ply and scene.toml. z is up.

The ball: an icosahedron split seven times, eight with --subdivide, its vertices moved along the radius by octaves of four plane
waves each, frequencies 3, 6, 12 … 96 over the unit sphere, directions and phases by --seed. *Gentle*: sines whose slopes are
alike in every octave and 0.6 together, root mean square. *Rough*: from frequency 12 on, 2.2 (1 − 2|sin|) in place of sin: creases
of no width, twice as many, about four times as steep, 2.3 together. Subdividing refines the sampling of the same function: the
gentle shape stays, creases of the rough one become sharper. --slope gives the frequencies from 12 on what is missing to another
slope of the gentle ball (of the rough one before it is made rough). The reference scene `scan` measures 1.65 in the same way.

Coordinates are rounded to 1e-7 before they become floats, which hides the last bits of the platform's sine. Takes some 5 s,
20 s subdivided. Python standard library only.
"""
import argparse
import math
import pathlib
import random
import struct
import sys
import time
from array import array

from ply_table import smooth_normals
from scene_mesh import scan_scene

OCTAVES, WAVES, RADIUS = (3, 6, 12, 24, 48, 96), 4, 0.87
SLOPE = 0.6  # of the gentle ball, against the sphere
RIDGED_FROM, RIDGED_GAIN = 12, 2.2


def icosphere(levels):
    """Unit vertices and outward triangles of an icosahedron split so often, 20 · 4^levels."""
    golden = (1 + math.sqrt(5)) / 2
    corners = [(0, s, t) for s in (-1, 1) for t in (-golden, golden)]
    corners = [turned for x, y, z in corners for turned in ((x, y, z), (y, z, x), (z, x, y))]
    size = math.sqrt(1 + golden * golden)
    vertices = [(x / size, y / size, z / size) for x, y, z in corners]
    edge = [[math.dist(a, b) < 2.2 / size and a != b for b in vertices] for a in vertices]
    faces = []
    for i in range(12):
        for j in range(i + 1, 12):
            for k in range(j + 1, 12):
                if edge[i][j] and edge[j][k] and edge[k][i]:
                    faces.append((i, j, k) if outward(vertices[i], vertices[j], vertices[k]) else (i, k, j))
    for _ in range(levels):
        faces = split(vertices, faces)
    return vertices, faces


def outward(a, b, c):
    return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0]) > 0


def split(vertices, faces):
    """Every triangle into four; appends the edges' middles, set on the sphere."""
    middles, count = {}, len(vertices)

    def middle(i, j):
        key = i * count + j if i < j else j * count + i
        found = middles.get(key)
        if found is None:
            found = middles[key] = len(vertices)
            (ax, ay, az), (bx, by, bz) = vertices[i], vertices[j]
            x, y, z = ax + bx, ay + by, az + bz
            size = 1 / math.sqrt(x * x + y * y + z * z)
            vertices.append((x * size, y * size, z * size))
        return found

    finer = []
    for i, j, k in faces:
        ij, jk, ki = middle(i, j), middle(j, k), middle(k, i)
        finer += [(i, ij, ki), (ij, j, jk), (ki, jk, k), (ij, jk, ki)]
    return finer


def waves(slope, seed):
    """[(frequency, amplitude, direction, phase)]. A wave a·sin(f d·p) has the mean square slope a² f²/3 on the sphere."""
    chance = random.Random(seed)
    out, low = [], [f for f in OCTAVES if f < RIDGED_FROM]
    even = SLOPE**2 / len(OCTAVES)
    rest = (slope**2 - even * len(low)) / (len(OCTAVES) - len(low))
    for frequency in OCTAVES:
        amplitude = math.sqrt((even if frequency in low else rest) * 3 / WAVES) / frequency
        for _ in range(WAVES):
            z, turn = 2 * chance.random() - 1, 2 * math.pi * chance.random()
            across = math.sqrt(1 - z * z)
            direction = (across * math.cos(turn), across * math.sin(turn), z)
            out.append((frequency, amplitude, direction, 2 * math.pi * chance.random()))
    return out


def displaced(vertices, rough, waves):
    """The ball, its lowest vertex on z = 0."""
    sin, radii = math.sin, array("d", [1.0]) * len(vertices)
    for frequency, amplitude, direction, phase in waves:
        dx, dy, dz = (frequency * d for d in direction)
        if rough and frequency >= RIDGED_FROM:
            gain = RIDGED_GAIN * amplitude
            radii = array("d", [r + gain * (1 - 2 * abs(sin(dx * x + dy * y + dz * z + phase))) for r, (x, y, z) in zip(radii, vertices)])
        else:
            radii = array("d", [r + amplitude * sin(dx * x + dy * y + dz * z + phase) for r, (x, y, z) in zip(radii, vertices)])
    assert min(radii) > 0.1, f"a radius of {min(radii)}: the ball meets itself"
    low = min(r * z for r, (_, _, z) in zip(radii, vertices))

    def scaled(value):
        return round(RADIUS * value, 7) + 0.0

    return [(scaled(r * x), scaled(r * y), scaled(r * z - low)) for r, (x, y, z) in zip(radii, vertices)]


def ply(comment, vertices, faces, normals=None):
    names = ["x", "y", "z"] + (["nx", "ny", "nz"] if normals else [])
    lines = ["ply", "format binary_little_endian 1.0", f"comment {comment}", f"element vertex {len(vertices)}"]
    lines += [f"property float {name}" for name in names]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    if normals:
        vertices = [(*v, *(round(c, 6) + 0.0 for c in n)) for v, n in zip(vertices, normals)]
    rows = array("f", [value for row in vertices for value in row])
    if sys.byteorder == "big":
        rows.byteswap()
    body = b"".join(struct.pack("<B3i", 3, *face) for face in faces)
    return ("\n".join(lines) + "\n").encode("ascii") + rows.tobytes() + body


def rms_slope(vertices, faces, sphere):
    """Root mean square tangent of the angle between faces and the radius, over the sphere's area: what was made, not asked."""
    square = total = 0.0
    for i, j, k in faces[:: max(1, len(faces) // 20_000)]:
        a, b, c = vertices[i], vertices[j], vertices[k]
        u, v = [q - p for p, q in zip(a, b)], [q - p for p, q in zip(a, c)]
        normal = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
        size = math.sqrt(sum(n * n for n in normal))
        cosine = sum(n * s for n, s in zip(normal, sphere[i])) / size
        square += 1 / (cosine * cosine) - 1
        total += 1
    return math.sqrt(square / total)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path, metavar="FOLDER")
    parser.add_argument("--rough", action="store_true", help="knife edges below the triangles' size")
    parser.add_argument("--subdivide", action="store_true", help="four times the triangles")
    parser.add_argument("--slope", type=float, default=SLOPE, help=f"of the gentle ball, at least 0.35 (default: {SLOPE})")
    parser.add_argument("--levels", type=int, default=7, help="splits of the icosahedron, for small tries (default: 7)")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    repository = pathlib.Path(__file__).resolve().parent.parent
    if arguments.folder.resolve().is_relative_to(repository):
        parser.error("FOLDER lies in the repository, which holds no scans")
    if arguments.slope < 0.35:
        parser.error("the two lowest octaves alone have a slope of 0.35")
    start = time.process_time()
    sphere, faces = icosphere(arguments.levels + arguments.subdivide)
    vertices = displaced(sphere, arguments.rough, waves(arguments.slope, arguments.seed))
    kind = "rough" if arguments.rough else "gentle"
    about = f"A {kind} scan of {len(faces)} triangles on a ground plane, white sky and area lamp; tools/make_scan.py, seed {arguments.seed}, slope {arguments.slope}"
    square = [(0, 1, 2), (0, 2, 3)]
    ground = [(-20, -20, 0), (20, -20, 0), (20, 20, 0), (-20, 20, 0)]
    light = [(1.5, -2.5, 4), (1.5, -1.5, 4), (2.5, -1.5, 4), (2.5, -2.5, 4)]
    files = {
        "object.ply": ply(about, vertices, faces, smooth_normals(vertices, faces)),
        "ground.ply": ply("ground", ground, square),
        "light.ply": ply("light, looks down", light, square),
        "scene.toml": scan_scene(about, ("object.ply", (0.75, 0.6, 0.45)), "z", (2.6, -2.6, 1.9), (0.0, 0.0, 0.85)).encode(),
    }
    arguments.folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (arguments.folder / name).write_bytes(content)
    slope = rms_slope(vertices, faces, sphere)
    print(f"{about}: {len(vertices)} vertices, rms slope {slope:.2f}, {time.process_time() - start:.1f} CPU s")


if __name__ == "__main__":
    main()
