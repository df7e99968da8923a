"""Reads binary PLY tables as glowtree and its tools write them, and smooth normals from faces. Python standard library only."""
import math
import struct
from array import array
from dataclasses import dataclass

CODES = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d"}
CODES |= {"int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f", "float64": "d"}


@dataclass
class Table:
    """Vertices of a PLY: property names, one tuple a vertex, and the triangles' corners."""

    names: list
    rows: list
    faces: list

    def columns(self, *names):
        """The named properties, one tuple a vertex."""
        places = [self.names.index(name) for name in names]
        return [tuple(row[k] for k in places) for row in self.rows]


def header(data, path):
    """({table: (count, [words of its properties])}, offset of the body)."""
    end = data.find(b"end_header\n") + 11
    lines = [line.split() for line in data[:end].decode("ascii", "replace").splitlines()]
    if ["format", "binary_little_endian", "1.0"] not in lines:
        raise SystemExit(f"error: {path}: no binary little-endian PLY")
    tables = {}
    for line in lines:
        if line[:1] == ["element"]:
            tables[line[1]] = (int(line[2]), [])
        elif line[:1] == ["property"]:
            list(tables.values())[-1][1].append(line[1:])
    return tables, end


def read(path):
    """The vertices and triangles of a file that starts with them and holds no list but the corners."""
    with open(path, "rb") as file:
        data = file.read()
    tables, at = header(data, path)
    if list(tables)[:2] != ["vertex", "face"] or len(tables["face"][1]) != 1:
        raise SystemExit(f"error: {path}: vertices, then faces of corners alone, are wanted")
    count, properties = tables["vertex"]
    layout = struct.Struct("<" + "".join(CODES[words[0]] for words in properties))
    rows = list(layout.iter_unpack(data[at : at + count * layout.size]))
    at += count * layout.size
    _, _, index, _ = tables["face"][1][0]
    triangle = struct.Struct("<B3" + CODES[index])
    faces = [row[1:] for row in triangle.iter_unpack(data[at : at + tables["face"][0] * triangle.size])]
    if at + len(faces) * triangle.size != len(data):
        raise SystemExit(f"error: {path}: holds faces that are no triangles")
    return Table([words[1] for words in properties], rows, faces)


def vertex_count(path):
    with open(path, "rb") as file:
        tables, _ = header(file.read(1 << 16), path)
    return tables["vertex"][0]


def smooth_normals(vertices, faces):
    """Unit normals by the area of the faces around each vertex; zero for vertices in no face. As `export` does."""
    nx, ny, nz = (array("d", bytes(8 * len(vertices))) for _ in range(3))
    for i, j, k in faces:
        ax, ay, az = vertices[i]
        bx, by, bz = vertices[j]
        cx, cy, cz = vertices[k]
        bx, by, bz, cx, cy, cz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
        x, y, z = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        for corner in (i, j, k):
            nx[corner] += x
            ny[corner] += y
            nz[corner] += z
    normals = []
    for x, y, z in zip(nx, ny, nz):
        length = math.sqrt(x * x + y * y + z * z)
        normals.append((x / length, y / length, z / length) if length > 0 else (0.0, 0.0, 0.0))
    return normals
