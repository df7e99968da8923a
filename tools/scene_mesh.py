"""Meshes for generated scenes: polygons, frames, boxes, lathes; binary PLY with the same bytes everywhere. The scene of a scan."""
import math
import struct

SCAN_SCENE = """# {about}

[[mesh]]
file = "{file}"
albedo = {albedo}
sides = 2

[[mesh]]
file = "ground.ply"
albedo = [0.5, 0.5, 0.5]
sides = 2

[[mesh]]
file = "light.ply"
albedo = [0.0, 0.0, 0.0]
radiance = [40.0, 36.0, 30.0]
sides = 1

[sky]
radiance = [1.0, 1.0, 1.0]
up = "{up}"

[[camera]]
name = "front"
eye = {eye}
target = {target}
up = {upward}
fov = 40
size = [512, 512]
"""


def scan_scene(about, scan, up, eye, target):
    """A scene file: a scan, its file and its albedo, on ground.ply under a white sky and the small lamp light.ply; `up` is the letter of an axis."""
    upward = [int(axis == up) for axis in "xyz"]
    file, albedo = scan
    views = {"eye": list(eye), "target": list(target), "upward": upward}
    return SCAN_SCENE.format(about=about, file=file, albedo=list(albedo), up=up, **views)


class Mesh:
    """Triangles over shared vertices; the front is the side from which the corners run counter-clockwise."""

    def __init__(self):
        self.vertices = []
        self.faces = []
        self.index = {}

    def vertex(self, point):
        """The index of a vertex, shared with any equal one. Rounding hides the last bits of the platform's libm."""
        point = tuple(round(c, 9) + 0.0 for c in point)
        if point not in self.index:
            self.index[point] = len(self.vertices)
            self.vertices.append(point)
        return self.index[point]

    def polygon(self, corners, towards=None, away=None):
        """A convex polygon as a fan from its first corner, turned so that its front looks towards or away from a point."""
        if towards is not None or away is not None:
            goal = towards if towards is not None else away
            looks = dot(area_vector(corners), sub(goal, corners[0])) > 0
            if looks != (towards is not None):
                corners = [corners[0], *reversed(corners[1:])]
        ids = [self.vertex(c) for c in corners]
        self.faces += [(ids[0], ids[i], ids[i + 1]) for i in range(1, len(ids) - 1)]

    def frame(self, outer, hole, towards):
        """The ring between two polygons with as many corners, as trapezoids: no T-junctions."""
        for i in range(len(outer)):
            j = (i + 1) % len(outer)
            self.polygon([outer[i], outer[j], hole[j], hole[i]], towards=towards)

    def prism(self, base, top, closed=True, bottom=True):
        """A solid between two polygons with matching corners, its front outwards."""
        middle = scale(add(centre(base), centre(top)), 0.5)
        for i in range(len(base)):
            j = (i + 1) % len(base)
            self.polygon([base[i], base[j], top[j], top[i]], away=middle)
        if closed:
            self.polygon(top, away=middle)
        if closed and bottom:
            self.polygon(base, away=middle)

    def lathe(self, profile, segments):
        """Turns (radius, height) pairs about the y axis; fronts look to the origin. A radius of zero is a pole."""
        turn = [2 * math.pi * k / segments for k in range(segments)]
        rings = [[(r * math.cos(a), y, r * math.sin(a)) for a in turn] for r, y in profile]
        for low, high in zip(rings, rings[1:]):
            for k in range(segments):
                m = (k + 1) % segments
                corners = dict.fromkeys([low[k], low[m], high[m], high[k]])
                self.polygon(list(corners), towards=(0.0, 0.0, 0.0))

    def triangle(self, a, b, c):
        """A triangle exactly as given, degenerate or not."""
        self.faces.append((self.vertex(a), self.vertex(b), self.vertex(c)))

    def corners(self):
        return ([self.vertices[i] for i in face] for face in self.faces)

    def area(self):
        return sum(0.5 * length(area_vector(c)) for c in self.corners())

    def closure(self):
        """The sum of all area vectors: zero for closed surfaces."""
        total = (0.0, 0.0, 0.0)
        for corners in self.corners():
            total = add(total, area_vector(corners))
        return length(total)

    def ply(self, comment):
        header = [
            "ply",
            "format binary_little_endian 1.0",
            f"comment {comment}",
            f"element vertex {len(self.vertices)}",
            *(f"property float {c}" for c in "xyz"),
            f"element face {len(self.faces)}",
            "property list uchar int vertex_indices",
            "end_header",
        ]
        vertices = b"".join(struct.pack("<3f", *v) for v in self.vertices)
        faces = b"".join(struct.pack("<B3i", 3, *f) for f in self.faces)
        return ("\n".join(header) + "\n").encode("ascii") + vertices + faces


def add(a, b):
    return tuple(x + y for x, y in zip(a, b))


def sub(a, b):
    return tuple(x - y for x, y in zip(a, b))


def scale(a, s):
    return tuple(x * s for x in a)


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def length(a):
    return math.sqrt(dot(a, a))


def centre(points):
    return scale([sum(c) for c in zip(*points)], 1 / len(points))


def area_vector(corners):
    """Twice the area times the front's normal."""
    total = (0.0, 0.0, 0.0)
    for i in range(1, len(corners) - 1):
        total = add(total, cross(sub(corners[i], corners[0]), sub(corners[i + 1], corners[0])))
    return total


def rectangle(fixed, value, first, second):
    """Corners of an axis-aligned rectangle: axis `fixed` has `value`; `first`, `second` are ranges along the other axes."""
    points = [(first[0], second[0]), (first[1], second[0]), (first[1], second[1]), (first[0], second[1])]
    return [(*p[:fixed], value, *p[fixed:]) for p in points]


def box(low, high):
    """Base and top of an axis-aligned box, for `prism`."""
    spans = list(zip(low, high))
    return rectangle(1, low[1], spans[0], spans[2]), rectangle(1, high[1], spans[0], spans[2])
