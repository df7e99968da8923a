"""Random vertices of a binary PLY of any size: places by seeking, normals from one pass over the faces. Python standard library only."""
import random
import struct
import sys
from array import array
from dataclasses import dataclass

import ply_table

READ_FACES, SEARCHED_FACES = 1 << 18, 1 << 11
ROW = 13  # bytes of a triangle: uchar 3, three indices


@dataclass
class Layout:
    """Where the vertices and the triangles of a file lie."""

    path: object
    names: list
    row: struct.Struct
    vertices: int
    faces: int
    start: int

    @property
    def faces_start(self):
        return self.start + self.vertices * self.row.size

    def rows(self, indices, *names):
        """The named properties of the vertices asked for, in order of their indices: {index: values}."""
        places, out = [self.names.index(name) for name in names], {}
        with open(self.path, "rb") as file:
            for index in sorted(indices):
                file.seek(self.start + index * self.row.size)
                values = self.row.unpack(file.read(self.row.size))
                out[index] = tuple(values[k] for k in places)
        return out


def layout(path):
    """The layout of a file of vertices, then triangles and nothing else."""
    with open(path, "rb") as file:
        tables, start = ply_table.header(file.read(1 << 16), path)
    if list(tables)[:2] != ["vertex", "face"] or len(tables["face"][1]) != 1 or tables["face"][1][0][1:3] not in (["uchar", "int"], ["uchar", "uint"]):
        raise SystemExit(f"error: {path}: vertices, then faces of corners alone, are wanted")
    count, properties = tables["vertex"]
    row = struct.Struct("<" + "".join(ply_table.CODES[words[0]] for words in properties))
    return Layout(path, [words[1] for words in properties], row, count, tables["face"][0], start)


def corners_of(data, path):
    """The indices of rows of triangles. Slices of every 13th byte: a hundred times faster than rows one by one."""
    count = len(data) // ROW
    if data[::ROW] != b"\3" * count:
        raise SystemExit(f"error: {path}: holds faces that are no triangles")
    packed = bytearray(12 * count)
    for k in range(12):
        packed[k::12] = data[1 + k :: ROW]
    corners = array("I")
    corners.frombytes(packed)
    if sys.byteorder == "big":
        corners.byteswap()
    return corners


def fans(found, chosen):
    """{vertex: [corners of each triangle around it]} of a set of vertices, in one pass over the faces."""
    out = {vertex: [] for vertex in chosen}
    with open(found.path, "rb") as file:
        file.seek(found.faces_start)
        left = found.faces
        while left:
            count = min(left, READ_FACES)
            data = file.read(count * ROW)
            if len(data) != count * ROW:
                raise SystemExit(f"error: {found.path}: ends within its faces")
            left -= count
            corners = corners_of(data, found.path)
            for at in range(0, len(corners), 3 * SEARCHED_FACES):
                part = corners[at : at + 3 * SEARCHED_FACES]
                if not chosen.isdisjoint(part):
                    collect(part, chosen, out)
    return out


def collect(part, chosen, out):
    for face in zip(part[0::3], part[1::3], part[2::3]):
        for corner in face:
            if corner in chosen:
                out[corner].append(face)


def sampled(path, count, seed):
    """Seeded random vertices that faces use, ascending: [(index, position, unit normal by the area of the faces around)]."""
    found = layout(path)
    chosen = set(random.Random(seed).sample(range(found.vertices), min(count, found.vertices)))
    around = fans(found, chosen)
    places = found.rows({v for fan in around.values() for face in fan for v in face} | chosen, "x", "y", "z")
    out = []
    for index in sorted(chosen):
        local = {v: k for k, v in enumerate(dict.fromkeys([index, *(v for face in around[index] for v in face)]))}
        faces = [tuple(local[v] for v in face) for face in around[index]]
        normal = ply_table.smooth_normals([places[v] for v in local], faces)[0]
        if any(normal):
            out.append((index, places[index], normal))
    return out
