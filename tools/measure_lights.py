#!/usr/bin/env python3
"""Cost and true error against the number of lights: rooms of the same total flux, and scenes under image skies.

    python3 tools/measure_lights.py --error 2% --counts 1,10,100,1000
    python3 tools/measure_lights.py --counts "" --sky ../shared/data/env/*.exr

Room: 4 × 3 × 4 m, closed, albedo about 0.6, a table top in it. Lights hang 0.3 to 1 m below the ceiling in the cells of a
grid, cells and places by --seed. Kinds: `quads`, squares that look down, 0.36 m² together, a [[mesh]] each; `mesh`, the same in
one [[mesh]]; `points`, point lamps. The flux is 11.3 W together, whatever the number and the kind.

Skies (--sky FILE …): boxes on a ground plane under each lat-long image, +y up, scaled by nothing; first under a white sky.

For each: `bake` and `probe` of --points random surface points, CPU seconds of both processes; the error against `reference`
at the same points, its noise taken out, relative to the mean; ratio of CPU seconds to the first of the kind (one light, the white
sky) at the same target: equal targets, not equal errors, which stand beside. Exit code 1 when the program fails.

Python standard library only.
"""
import argparse
import math
import pathlib
import random
import shlex
import sys
import tempfile

import judge
from scene_mesh import Mesh, area_vector, box, length, rectangle, scale

SIZE, LAMP_AREA, RADIANCE = (4.0, 3.0, 4.0), 0.36, (10.0, 10.0, 10.0)
PAINT, KINDS = (0.65, 0.6, 0.55), "quads,mesh,points"


def hung(count, seed):
    """Places of lights, one in a cell each, no nearer to a cell's edge than a quarter of it."""
    chance = random.Random(seed)
    across = math.ceil(math.sqrt(count))
    cells = sorted(chance.sample(range(across * across), count))
    out = []
    for cell in cells:
        x, z = ((k + 0.25 + 0.5 * chance.random()) / across for k in (cell % across, cell // across))
        out.append((SIZE[0] * x, SIZE[1] - 0.3 - 0.7 * chance.random(), SIZE[2] * z))
    return out


def block(name, albedo, radiance=None, sides=1):
    lines = ["[[mesh]]", f'file = "{name}.ply"', f"albedo = {list(albedo)}", f"sides = {sides}"]
    return "\n".join(lines + ([f"radiance = {list(radiance)}"] if radiance else []))


def square(place, edge):
    """Looks down."""
    x, y, z = place
    mesh, half = Mesh(), edge / 2
    mesh.polygon(rectangle(1, y, (x - half, x + half), (z - half, z + half)), towards=(x, y - 1, z))
    return mesh


def room(kind, count, seed):
    """({file: bytes}, meshes that receive)"""
    shell, table = Mesh(), Mesh()
    shell.prism(*box((0, 0, 0), SIZE))
    shell.faces = [(a, c, b) for a, b, c in shell.faces]
    table.prism(*box((1.0, 0.7, 1.2), (2.6, 0.78, 2.4)))
    places, edge = hung(count, seed), math.sqrt(LAMP_AREA / count)
    files = {"shell.ply": shell.ply("room"), "table.ply": table.ply("table top")}
    blocks = [block("shell", PAINT), block("table", PAINT[::-1])]
    if kind == "points":
        intensity = [e * LAMP_AREA / (4 * count) for e in RADIANCE]  # the flux π L A over 4π
        blocks += [f'[[lamp]]\nkind = "point"\nposition = {list(p)}\nintensity = {intensity}\nname = "lamp{k}"' for k, p in enumerate(places)]
    elif kind == "mesh":
        lights = Mesh()
        for place in places:
            one = square(place, edge)
            lights.faces += [tuple(i + len(lights.vertices) for i in face) for face in one.faces]
            lights.vertices += one.vertices
        files["lights.ply"] = lights.ply("lights")
        blocks.append(block("lights", (0.0, 0.0, 0.0), RADIANCE))
    else:
        for k, place in enumerate(places):
            files[f"light{k}.ply"] = square(place, edge).ply("light")
            blocks.append(block(f"light{k}", (0.0, 0.0, 0.0), RADIANCE))
    files["scene.toml"] = ("\n\n".join(blocks) + "\n").encode()
    return files, [shell, table]


def outdoors(image):
    """Boxes on a ground plane; None is the white sky."""
    ground, boxes = Mesh(), Mesh()
    ground.polygon(rectangle(1, 0.0, (-6, 6), (-6, 6)), towards=(0, 1, 0))
    for x, z, height in ((-2.5, -1.0, 1.0), (0.5, -2.5, 2.0), (1.5, 1.5, 0.6), (-1.5, 2.0, 3.0)):
        boxes.prism(*box((x, 0.0, z), (x + 1.2, height, z + 1.0)), bottom=False)
    sky = f"file = {str(image.resolve())!r}" if image else "radiance = [1, 1, 1]"
    text = "\n\n".join([block("ground", (0.4, 0.4, 0.4)), block("boxes", PAINT), f'[sky]\n{sky}\nup = "y"'])
    return {"ground.ply": ground.ply("ground"), "boxes.ply": boxes.ply("boxes"), "scene.toml": (text + "\n").encode()}, [ground, boxes]


def inside(point):
    """Whether a point of the ground lies under a box: no light there, and none asked."""
    x, y, z = point
    feet = ((-2.5, -1.0), (0.5, -2.5), (1.5, 1.5), (-1.5, 2.0))
    return y == 0.0 and any(a < x < a + 1.2 and b < z < b + 1.0 for a, b in feet)


def spread(meshes, count, seed, avoid):
    """Seeded points on the fronts, even over the area: (position, normal)."""
    chance = random.Random(seed)
    corners = [triangle for mesh in meshes for triangle in mesh.corners()]
    vectors = [area_vector(triangle) for triangle in corners]
    out = []
    while len(out) < count:
        (k,) = chance.choices(range(len(corners)), [length(v) for v in vectors])
        u, v = chance.random(), chance.random()
        if u + v > 1:
            u, v = 1 - u, 1 - v
        a, b, c = corners[k]
        point = tuple(round(p + u * (q - p) + v * (r - p), 9) for p, q, r in zip(a, b, c))
        if not avoid(point):
            out.append((point, scale(vectors[k], 1 / length(vectors[k]))))
    return out


def measure(arguments, files, meshes, avoid):
    with tempfile.TemporaryDirectory() as scratch:
        folder = pathlib.Path(scratch)
        for name, content in files.items():
            (folder / name).write_bytes(content)
        judge.write_points(folder / "points.csv", spread(meshes, arguments.points, arguments.seed + 1, avoid))
        options = ["--error", arguments.error, *shlex.split(arguments.bake_options)]
        summary, baked = judge.bake(arguments.bin, folder / "scene.toml", folder / "job.glow", options)
        probed = judge.probe(arguments.bin, folder / "job.glow", folder / "points.csv", folder / "out.csv")
        verdict, traced = judged(arguments, folder)
    kept = {name: summary[name] for name in ("sites", "links", "rays", "estimated_error")}
    cost = {"cpu_seconds": baked.cpu_seconds + probed.cpu_seconds, "probe_seconds": probed.cpu_seconds, "reference_seconds": traced}
    return {"error": verdict.error, "doubt": verdict.doubt, "worst": verdict.worst, "noise": verdict.noise, "mean": verdict.mean, **cost, **kept}


def judged(arguments, folder):
    """The verdict on out.csv, and what the reference cost whose noise was worth it."""
    samples, seconds = 64, 0.0
    for _ in range(2):
        traced = judge.reference(arguments.bin, folder / "scene.toml", folder / "points.csv", folder / "truth.csv", samples)
        verdict = judge.judge(judge.read_rows(folder / "out.csv"), judge.read_rows(folder / "truth.csv"))
        seconds += traced.cpu_seconds
        wanted = samples * (100 * verdict.noise / arguments.noise) ** 2
        samples = min(2 ** math.ceil(math.log2(max(wanted, 256))), arguments.spp)
    return verdict, seconds


def trials(arguments):
    """(kind, what, how to make it, where no points are wanted), the ones to compare with first."""
    for kind in arguments.kinds.split(",") if arguments.counts else []:
        for count in (int(c) for c in arguments.counts.split(",")):
            yield kind, str(count), lambda kind=kind, count=count: room(kind, count, arguments.seed), lambda point: False
    for image in [None, *arguments.sky] if arguments.sky else []:
        yield "sky", image.name if image else "white", lambda image=image: outdoors(image), inside


def row(kind, what, one, first):
    cells = [kind, what, f"{100 * one['error']:.2f} ± {100 * one['doubt']:.2f} %", judge.share(one["estimated_error"]), judge.share(one["worst"], 1)]
    cells += [judge.share(one["noise"]), f"{one['mean']:.4g}", f"{one['cpu_seconds']:.2f}", f"{one['probe_seconds']:.2f}", judge.times(one["cpu_seconds"] / first["cpu_seconds"])]
    cells += [str(one["sites"]), str(one["rays"]), f"{one['reference_seconds']:.1f}"]
    return "| " + " | ".join(cells) + " |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", default="target/release/glowtree")
    parser.add_argument("--error", default="2%", help="target of the bakes (default: 2%%)")
    parser.add_argument("--counts", default="1,10,100,1000", help="numbers of lights (default: 1,10,100,1000)")
    parser.add_argument("--kinds", default=KINDS, help=f"default: {KINDS}")
    parser.add_argument("--sky", type=pathlib.Path, nargs="+", default=[], metavar="FILE", help="lat-long .exr or .hdr")
    parser.add_argument("--points", type=int, default=2000, help="points judged (default: 2000)")
    parser.add_argument("--noise", type=float, default=1.0, help="of the reference, wanted, in percent (default: 1)")
    parser.add_argument("--spp", type=int, default=16384, help="most paths a point of the reference (default: 16384)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cache", help="JSON file that keeps the measurements")
    parser.add_argument("--bake-options", default="", metavar="WORDS", help='further flags: --bake-options="--seed 3"')
    arguments = parser.parse_args()
    cache, first, failed = judge.Cache(arguments.cache), {}, False
    made = judge.fingerprint(arguments.bin)
    head = ["lights", "number", "true error", "claimed", "worst", "noise of reference", "mean E", "CPU s", "of it probe", "over the first", "sites", "rays", "reference CPU s"]
    print("| " + " | ".join(head) + " |\n|" + "---|" * len(head), flush=True)
    for kind, what, make, avoid in trials(arguments):
        asked = [kind, what, arguments.error, arguments.points, arguments.noise, arguments.spp, arguments.seed, arguments.bake_options, made]
        try:
            one = cache.take(" ".join(map(str, asked)), lambda: measure(arguments, *make(), avoid))
        except judge.Failed as failure:
            print(f"error: {kind} {what}: {failure}", file=sys.stderr)
            failed = True
            continue
        print(row(kind, what, one, first.setdefault(kind, one)), flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
