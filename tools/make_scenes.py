#!/usr/bin/env python3
"""Writes data/: small scenes of our own with answers known in advance, the same bytes on every machine.

    python3 tools/make_scenes.py            write
    python3 tools/make_scenes.py --check    compare with what is there; exit 1 on a difference

Python standard library only.
"""
import argparse
import math
import pathlib
import sys

from scene_mesh import Mesh, box, rectangle

DATA = pathlib.Path(__file__).resolve().parent.parent / "data"
ORIGIN = (0.0, 0.0, 0.0)


class Scene:
    """A folder of data/: its scene.toml, meshes and row of the table."""

    def __init__(self, name, about, source):
        self.name, self.about, self.source = name, about, source
        self.files, self.blocks, self.answer = {}, [], ""

    def mesh(self, name, mesh, albedo, radiance=None, sides=1):
        block = ["[[mesh]]", f'file = "{name}.ply"', f"albedo = {numbers(albedo)}"]
        if radiance:
            block.append(f"radiance = {numbers(radiance)}")
        block += [f"sides = {sides}", f'name = "{name}"']
        self.blocks.append("\n".join(block))
        self.files[f"{name}.ply"] = mesh.ply(f"glowtree data, {self.name}: {name}")

    def camera(self, name, eye, target, fov=39.3, size=(512, 512)):
        lines = ["[[camera]]", f'name = "{name}"', f"eye = {numbers(eye)}", f"target = {numbers(target)}"]
        lines += ["up = [0, 1, 0]", f"fov = {fov}", f"size = {list(size)}"]
        self.blocks.append("\n".join(lines))

    def toml(self):
        return f"# {self.about}\n\n" + "\n\n".join(self.blocks) + "\n"

    def written(self):
        """{path below data/: bytes}"""
        files = {**self.files, "scene.toml": self.toml().encode()}
        return {f"{self.name}/{name}": content for name, content in files.items()}


def numbers(values):
    return "[" + ", ".join(repr(round(v, 9) + 0.0).removesuffix(".0") for v in values) + "]"


def triple(values):
    return ", ".join(f"{v:.6g}" for v in values)


def cornell():
    scene = Scene(
        "cornell",
        "The measured Cornell box, lengths / 100, open front, y up",
        "Cornell University Program of Computer Graphics, Cornell Box Data; RGB reflectances and radiance are the usual ones of the box in RGB renderers",
    )
    white, red, green, light = Mesh(), Mesh(), Mesh(), Mesh()
    short, tall = Mesh(), Mesh()
    middle = (2.78, 2.73, 2.8)

    def measured(*points):
        return [tuple(c / 100 for c in p) for p in points]

    hole = measured((343, 548.8, 227), (343, 548.8, 332), (213, 548.8, 332), (213, 548.8, 227))
    ceiling = measured((556, 548.8, 0), (556, 548.8, 559.2), (0, 548.8, 559.2), (0, 548.8, 0))
    white.polygon(measured((552.8, 0, 0), (0, 0, 0), (0, 0, 559.2), (549.6, 0, 559.2)), towards=middle)
    white.frame(ceiling, hole, towards=middle)
    white.polygon(measured((549.6, 0, 559.2), (0, 0, 559.2), (0, 548.8, 559.2), (556, 548.8, 559.2)), towards=middle)
    green.polygon(measured((0, 0, 559.2), (0, 0, 0), (0, 548.8, 0), (0, 548.8, 559.2)), towards=middle)
    red.polygon(measured((552.8, 0, 0), (549.6, 0, 559.2), (556, 548.8, 559.2), (556, 548.8, 0)), towards=middle)
    light.polygon(hole, towards=middle)
    for block, height, feet in (
        (short, 165, [(130, 65), (82, 225), (240, 272), (290, 114)]),
        (tall, 330, [(423, 247), (265, 296), (314, 456), (472, 406)]),
    ):
        base = measured(*((x, 0, z) for x, z in feet))
        block.prism(base, measured(*((x, height, z) for x, z in feet)), bottom=False)
    paint = (0.725, 0.71, 0.68)
    scene.mesh("white", white, paint)
    scene.mesh("red", red, (0.63, 0.065, 0.05))
    scene.mesh("green", green, (0.14, 0.45, 0.091))
    scene.mesh("short_block", short, paint)
    scene.mesh("tall_block", tall, paint)
    scene.mesh("light", light, (0.78, 0.78, 0.78), (18.387, 13.9873, 6.75357))
    scene.camera("front", (2.78, 2.73, -8.0), (2.78, 2.73, 0.0))
    scene.answer = "none in closed form: judge with `glowtree reference`"
    return scene


def sphere():
    scene = Scene(
        "sphere", "The unit sphere from inside: three bands of equal area, each with its own light and albedo", "Archimedes; `docs/theory.md`, exact answers"
    )
    edge, steps, segments = math.acos(1 / 3), (18, 10, 18), 96
    bounds = [0.0, edge, math.pi - edge, math.pi]
    light = [(1.0, 0.5, 0.25), (0.0, 0.0, 0.0), (0.2, 0.4, 0.8)]
    paint = [(0.3, 0.4, 0.5), (0.5, 0.5, 0.5), (0.7, 0.6, 0.2)]
    for name, low, high, count, radiance, albedo in zip(("top", "middle", "bottom"), bounds, bounds[1:], steps, light, paint):
        angles = [low + (high - low) * i / count for i in range(count + 1)]
        mesh = Mesh()
        mesh.lathe([(abs(round(math.sin(a), 12)), math.cos(a)) for a in angles], segments)
        scene.mesh(name, mesh, albedo, radiance)
    scene.camera("inside", (0.0, 0.0, 0.9), ORIGIN, fov=75)
    mean = [[sum(c) / 3 for c in zip(*rows)] for rows in (light, paint)]
    answer = [math.pi * e / (1 - r) for e, r in zip(*mean)]
    sag = (2 * math.pi / segments) ** 2 / 8
    scene.answer = f"irradiance everywhere H = ⟨E₀⟩/(1 − ⟨ρ⟩) = ({triple(answer)}); facets lie within {sag:.1e} radii of the sphere"
    return scene


def furnace():
    scene = Scene("furnace", "A closed cube with a turned block inside, the same light and albedo everywhere", "`docs/theory.md`, exact answers")
    room, block = Mesh(), Mesh()
    room.prism(*box((-1, -1, -1), (1, 1, 1)))
    room.faces = [(a, c, b) for a, b, c in room.faces]
    c, s = 0.4 * math.cos(0.5), 0.4 * math.sin(0.5)
    feet = [(c, s), (-s, c), (-c, -s), (s, -c)]
    block.prism([(x, -0.7, z) for x, z in feet], [(x, 0.2, z) for x, z in feet])
    albedo = (0.5, 0.7, 0.9)
    for name, mesh in (("room", room), ("block", block)):
        assert mesh.closure() < 1e-9, name
        scene.mesh(name, mesh, albedo, (1.0, 1.0, 1.0))
    scene.camera("inside", (0.9, 0.8, 0.9), ORIGIN, fov=75)
    scene.answer = f"B = H = E₀/(1 − ρ) = ({triple([math.pi / (1 - a) for a in albedo])}) everywhere"
    return scene


def rooms():
    scene = Scene("rooms", "Two rooms, a door ajar between them, a table, light in one; metres, y up", "own dimensions; the mean: conservation of energy")
    near, far, height, depth = 4.0, 4.1, 2.5, 3.0  # the faces of the dividing wall; the rooms' height and depth
    left, right, lintel = 1.0, 1.9, 2.0  # the doorway
    walls, light, table, door = Mesh(), Mesh(), Mesh(), Mesh()
    middle = (2.0, 1.2, 1.5), (5.6, 1.2, 1.5)
    hole = rectangle(1, height, (1.4, 2.6), (1.35, 1.65))
    walls.frame(rectangle(1, height, (0, near), (0, depth)), hole, towards=middle[0])
    walls.polygon(rectangle(1, height, (far, 7.1), (0, depth)), towards=middle[1])
    light.polygon(hole, towards=middle[0])
    for face, end, inside in ((near, 0.0, middle[0]), (far, 7.1, middle[1])):
        walls.polygon([(end, 0, 0)] + [(face, 0, z) for z in (0, left, right, depth)] + [(end, 0, depth)], towards=inside)
        walls.polygon(rectangle(0, end, (0, height), (0, depth)), towards=inside)
        for z in (0.0, depth):
            walls.polygon(rectangle(2, z, tuple(sorted((face, end))), (0, height)), towards=inside)
        outer = [(face, 0, 0), (face, height, 0), (face, height, depth), (face, 0, depth)]
        opening = [(face, 0, left), (face, lintel, left), (face, lintel, right), (face, 0, right)]
        for i in range(3):
            walls.polygon([outer[i], outer[i + 1], opening[i + 1], opening[i]], towards=inside)
    doorway = ((near + far) / 2, 1.0, (left + right) / 2)
    for z in (left, right):
        walls.polygon(rectangle(2, z, (near, far), (0, lintel)), towards=doorway)
    for y in (0.0, lintel):
        walls.polygon(rectangle(1, y, (near, far), (left, right)), towards=doorway)
    leg = furnish(table, door)
    paint, radiance = (0.75, 0.72, 0.66), (20.0, 18.0, 15.0)
    for name, mesh in (("walls", walls), ("table", table), ("door", door)):
        scene.mesh(name, mesh, paint)
    scene.mesh("light", light, paint, radiance)
    scene.camera("lit", (0.2, 1.6, 2.8), (4.0, 1.0, 1.3), fov=60)
    scene.camera("dark", (7.0, 1.6, 2.8), (4.1, 1.0, 1.2), fov=60)
    room = Mesh()
    room.vertices, room.faces = walls.vertices + light.vertices, list(walls.faces)
    room.faces += [tuple(i + len(walls.vertices) for i in face) for face in light.faces]
    assert room.closure() < 1e-9 and door.closure() < 1e-9 and table.closure() < 1e-9
    surface = room.area() + door.area() + table.area() - 8 * leg * leg
    mean = [math.pi * e * light.area() / (surface * (1 - a)) for e, a in zip(radiance, paint)]
    scene.answer = f"mean irradiance over the {surface:.6g} m² that light can reach (not where the legs stand or are fixed) Φ/(S(1 − ρ)) = ({triple(mean)})"
    return scene


def furnish(table, door):
    """A table on four legs under the light and a door 50° open; returns the width of a leg."""
    leg, inset, low = 0.06, 0.05, 0.72
    x, z = (2.2, 3.6), (0.8, 1.6)
    table.prism(*box((x[0], low, z[0]), (x[1], low + 0.04, z[1])))
    for a in (x[0] + inset, x[1] - inset - leg):
        for b in (z[0] + inset, z[1] - inset - leg):
            table.prism(*box((a, 0, b), (a + leg, low, b + leg)), closed=False)
    swing, width, thickness, hinge = math.radians(50), 0.88, 0.04, (4.12, 1.01)
    along, through = (math.sin(swing), math.cos(swing)), (math.cos(swing), -math.sin(swing))
    feet = [
        (hinge[0] + a * width * along[0] + b * thickness * through[0], hinge[1] + a * width * along[1] + b * thickness * through[1])
        for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))
    ]
    door.prism([(x, 0.005, z) for x, z in feet], [(x, 1.98, z) for x, z in feet])
    return leg


def wall():
    scene = Scene("wall", "A wall without thickness between a lit and a dark room; floor and long walls are one polygon under both", "symmetry; conservation of energy")
    shell, screen, light = Mesh(), Mesh(), Mesh()
    middle = (1.0, 0.5, 0.5)
    hole = rectangle(1, 1.0, (0.3, 0.7), (0.3, 0.7))
    shell.polygon(rectangle(1, 0.0, (0, 2), (0, 1)), towards=middle)
    for z in (0.0, 1.0):
        shell.polygon(rectangle(2, z, (0, 2), (0, 1)), towards=middle)
    for x in (0.0, 2.0):
        shell.polygon(rectangle(0, x, (0, 1), (0, 1)), towards=middle)
    shell.frame(rectangle(1, 1.0, (0, 1), (0, 1)), hole, towards=middle)
    shell.polygon(rectangle(1, 1.0, (1, 2), (0, 1)), towards=middle)
    screen.polygon(rectangle(0, 1.0, (0, 1), (0, 1)), towards=ORIGIN)
    light.polygon(hole, towards=middle)
    paint, radiance = (0.5, 0.5, 0.5), (4.0, 4.0, 4.0)
    scene.mesh("shell", shell, paint)
    scene.mesh("screen", screen, paint, sides=2)
    scene.mesh("light", light, paint, radiance)
    scene.camera("cut", (1.9, 0.9, 0.95), (0.9, 0.1, 0.2), fov=70)
    mean = math.pi * radiance[0] * 0.16 / (6 * 0.5)
    scene.answer = f"dark room (x > 1): exactly 0; lit room: mean irradiance Φ/(S(1 − ρ)) = {mean:.6g} in each channel"
    return scene


def crater():
    scene = Scene("crater", "A spherical cap of half-angle 60° under a sun 30° high, its own shadow included", "`docs/theory.md`, exact answers")
    beta, elevation, albedo, rings, segments = math.radians(60), math.radians(30), 0.5, 32, 96
    mesh = Mesh()
    angles = [beta * i / rings for i in range(rings + 1)]
    mesh.lathe([(math.sin(a), -math.cos(a)) for a in angles], segments)
    scene.mesh("cap", mesh, (albedo,) * 3)
    travel = (-math.cos(elevation), -math.sin(elevation), 0.0)
    scene.blocks.append(f'[[lamp]]\nkind = "sun"\ndirection = {numbers(travel)}\nirradiance = [1, 1, 1]\nname = "sun"')
    scene.camera("above", (0.0, 1.6, 2.2), (0.0, -0.75, 0.0), fov=45)
    f = (1 - math.cos(beta)) / 2
    answer = albedo * math.sin(elevation) * f * (1 - f) / (1 - albedo * f)
    sag = (2 * math.pi / segments) ** 2 / 8
    scene.answer = f"indirect irradiance {answer:.10g} in each channel at every point; facets lie within {sag:.1e} radii of the sphere"
    return scene


def specks():
    scene = Scene("specks", "A furnace of bad geometry: slivers, T-junctions, triangles without area, duplicates, inversions, fins, debris", "`docs/theory.md`, exact answers")
    shell, junk, broken = Mesh(), Mesh(), Mesh()
    middle = (0.5, 0.5, 0.5)
    # The floor is a fan of slivers, some 1e-5 wide; the walls beside it have only their corners: T-junctions.
    stops = sorted({i / 64 for i in range(65)} | {(i + 1e-3) / 64 for i in range(0, 64, 4)} | {0.5 + 1e-5})
    shell.polygon([(0.0, 0.0, 1.0)] + [(x, 0.0, 0.0) for x in stops] + [(1.0, 0.0, 1.0)], towards=middle)
    shell.polygon(rectangle(1, 1.0, (0, 1), (0, 1)), towards=middle)
    for value in (0.0, 1.0):
        shell.polygon(rectangle(0, value, (0, 1), (0, 1)), towards=middle)
        shell.polygon(rectangle(2, value, (0, 1), (0, 1)), towards=middle)
    shell.faces += shell.faces[-4:]  # two walls twice
    a, b, c = shell.faces[-1]
    shell.faces.append((a, c, b))  # and half of one a third time, inverted
    shell.faces += [(a, a, b), (c, c, c)]  # corners repeated
    shell.triangle((0.1, 0.0, 0.0), (0.2, 0.0, 0.0), (0.3, 0.0, 0.0))  # corners on one line
    shell.vertex((0.5, 0.9, 0.5))  # in no triangle
    # Three fins on one edge, two squares through each other.
    for x in (0.2, 0.3, 0.4):
        junk.triangle((0.3, 0.2, 0.4), (0.3, 0.6, 0.4), (x, 0.4, 0.6))
    junk.polygon(rectangle(1, 0.3, (0.6, 0.9), (0.6, 0.9)))
    junk.polygon(rectangle(0, 0.75, (0.15, 0.45), (0.6, 0.9)))
    for i in range(200):  # debris from 1e-2 down to 1e-5
        at = [0.1 + 0.8 * ((i * g + 0.5) % 1.0) for g in (0.8191725134, 0.6710436067, 0.5497004779)]
        size = 10 ** (-2 - 3 * i / 199)
        junk.triangle(tuple(at), (at[0] + size, at[1], at[2]), (at[0], at[1] + size, at[2] + size))
    for mesh, name in ((shell, "shell"), (junk, "junk")):
        scene.mesh(name, mesh, (0.5, 0.5, 0.5), (1.0, 1.0, 1.0), sides=2)
    scene.camera("inside", (0.9, 0.9, 0.9), (0.3, 0.3, 0.3), fov=75)
    scene.answer = f"H = E₀/(1 − ρ) = {2 * math.pi:.6g} on every surface in the room, specks included: light of coincident triangles counts once; warnings count what was mended"
    nan = float("nan")
    broken.vertices = [(0.2, 0.2, 0.2), (0.3, 0.2, 0.2), (0.2, 0.3, 0.2), (nan, 0.2, 0.2), (0.2, float("inf"), 0.2)]
    broken.faces = [(0, 1, 2), (0, 1, 3), (0, 2, 4)]
    whole = scene.toml()
    scene.mesh("broken", broken, (0.5, 0.5, 0.5), (1.0, 1.0, 1.0), sides=2)
    scene.files["nan.toml"] = scene.toml().replace("# A furnace", "# With triangles at NaN and infinity: a furnace").encode()
    scene.blocks.pop()
    assert scene.toml() == whole
    return scene


def readme(scenes):
    rows = "\n".join(f"| [`{s.name}`]({s.name}/scene.toml) | {s.about} | {s.answer} | {s.source} |" for s in scenes)
    return f"""# Scenes

Small scenes of our own, written by `python3 tools/make_scenes.py`, this table included; `--check` compares.
Meshes are binary little-endian PLY. H is irradiance, B radiosity, both in W·m⁻²; three numbers are red, green, blue.

| scene | what | exact answer | source |
|---|---|---|---|
{rows}

`specks/nan.toml` is `specks/scene.toml` with a mesh whose triangles reach to NaN and to infinity: it is mended with a
counted warning, and then the answer is the same, or refused by its place; never may a NaN come out.
"""


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true")
    check = parser.parse_args().check
    scenes = [cornell(), sphere(), furnace(), rooms(), wall(), crater(), specks()]
    files = {"README.md": readme(scenes).encode()}
    for scene in scenes:
        files.update(scene.written())
    differing = []
    for name, content in files.items():
        path = DATA / name
        if check:
            if not path.exists() or path.read_bytes() != content:
                differing.append(name)
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
    for name in differing:
        print(f"error: data/{name} is not what tools/make_scenes.py writes")
    print(f"data: {len(files)} files, {sum(map(len, files.values()))} bytes, {len(differing)} differ")
    sys.exit(1 if differing else 0)


if __name__ == "__main__":
    main()
