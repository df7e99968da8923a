#!/usr/bin/env python3
"""Cost and true error of irradiance at all vertices of a mesh: `bake` and `export` against `reference` at random vertices.

    python3 tools/measure_vertices.py ../shared/reference/scan --error 2%
    python3 tools/make_scan.py SCAN --rough && python3 tools/measure_vertices.py SCAN --peers ../shared/reference/scan

SCENE is a folder with scene.toml, or a bare .ply. `export` answers for the front of every vertex with the file's normal,
turned to the faces' front, or else the area-weighted mean of the faces around it; for a scene.toml it writes the vertices of all
meshes in the file's order, with those normals as nx ny nz. The reference gathers at the same positions with the same normals
(for a bare PLY they are made here in the same way). The points are drawn by --seed among the vertices that faces use, apart
from anything the program draws. With --mesh NAME.ply they are that mesh's, by default those of the mesh with the most vertices.

CPU seconds: the whole processes of bake and export. Error: RMS of RGB irradiance over its mean, the reference's noise taken
out. µs a vertex: over all vertices exported. Peers: what they need for that error at 20,000 scattered points with face normals
(peers.json beside the scene, or of --peers, which is then another scene's curve and says so), times vertices over 20,000.

Exit code 1 when the program fails. Python standard library only.
"""
import argparse
import math
import pathlib
import random
import re
import shlex
import sys
import tempfile

import judge
import ply_table


def meshes_of(scene):
    """[(name, first vertex, behind the last)] in the order of export; one for a bare PLY."""
    if scene.suffix == ".ply":
        return [(scene.name, 0, ply_table.vertex_count(scene))]
    spans, at = [], 0
    for name in re.findall(r'(?m)^file *= *"(.*\.ply)"', scene.read_text(encoding="utf-8")):
        count = ply_table.vertex_count(scene.parent / name)
        spans.append((name, at, at + count))
        at += count
    return spans


def drawn(table, span, count, seed):
    """Seeded random vertices of a mesh that faces use: (index, position, normal as export takes it)."""
    positions = table.columns("x", "y", "z")
    normals = ply_table.smooth_normals(positions, table.faces)
    given = table.columns("nx", "ny", "nz") if "nx" in table.names else normals
    used = [k for k in range(*span) if any(normals[k]) and any(given[k])]
    chosen = sorted(random.Random(seed).sample(used, min(count, len(used))))
    out = []
    for k in chosen:
        turn = -1.0 if sum(a * b for a, b in zip(given[k], normals[k])) < 0 else 1.0
        out.append((k, positions[k], tuple(turn * c for c in given[k])))
    return out


def span_of(arguments, scene):
    spans = meshes_of(scene)
    if arguments.mesh:
        spans = [span for span in spans if span[0] == arguments.mesh]
    if not spans:
        raise SystemExit(f"error: {scene}: no mesh {arguments.mesh or ''}; .ply meshes alone are understood")
    return max(spans, key=lambda span: span[2] - span[1])


def truth(arguments, cache, scene, points):
    """Rows of the reference at the points; kept by program, scene and points, for the bake's options do not change them."""
    with tempfile.TemporaryDirectory() as scratch:
        table, out = pathlib.Path(scratch) / "points.csv", pathlib.Path(scratch) / "truth.csv"
        judge.write_points(table, [(position, normal) for _, position, normal in points])
        key = f"reference {arguments.spp} spp {judge.fingerprint(arguments.bin, scene, table)}"

        def trace():
            judge.note(f"reference: {len(points)} points × {arguments.spp} paths …")
            cost = judge.reference(arguments.bin, scene, table, out, arguments.spp)
            return {"rows": judge.read_rows(out), "cpu_seconds": cost.cpu_seconds}

        return cache.take(key, trace)


def measure(arguments, cache, scene):
    span = span_of(arguments, scene)
    with tempfile.TemporaryDirectory() as scratch:
        job, out = pathlib.Path(scratch) / "job.glow", pathlib.Path(scratch) / "out.ply"
        summary, baked = judge.bake(arguments.bin, scene, job, ["--error", arguments.error, *shlex.split(arguments.bake_options)])
        exported = judge.run([arguments.bin, "export", job, "-o", out, "--progress", "none", "-q"])
        table = ply_table.read(out)
    points = drawn(table, span[1:], arguments.points, arguments.seed)
    known = truth(arguments, cache, scene, points)
    light = table.columns("irradiance_r", "irradiance_g", "irradiance_b")
    got = [{f"irradiance_{c}": light[k][i] for i, c in enumerate("rgb")} for k, _, _ in points]
    return summary, (baked, exported), judge.judge(got, known["rows"]), (span, len(light), known["cpu_seconds"])


def told(arguments, scene, measured):
    """Lines of the report."""
    summary, (baked, exported), verdict, (span, vertices, traced) = measured
    cpu = baked.cpu_seconds + exported.cpu_seconds
    yield f"{scene.parent.name}/{span[0]}, target {arguments.error}: {verdict.points} of {vertices} vertices judged"
    yield f"  true error   {100 * verdict.error:.2f} ± {100 * verdict.doubt:.2f} %, worst {judge.share(verdict.worst, 1)}, claimed {judge.share(summary['estimated_error'])}"
    yield f"  reference    {arguments.spp} paths a point, noise {judge.share(verdict.noise)}, {traced:.1f} CPU s"
    yield f"  CPU          {cpu:.2f} s = bake {baked.cpu_seconds:.2f} + export {exported.cpu_seconds:.2f}; {1e6 * cpu / vertices:.2f} µs a vertex"
    yield f"  memory       {max(baked.megabytes, exported.megabytes):.0f} MB; {summary['sites']} sites, {summary['rays'] / vertices:.2f} rays a vertex in the bake"
    folder = arguments.peers or scene.parent
    costs = {peer: cost * vertices / judge.PEER_POINTS for peer, cost in judge.peer_costs(folder, verdict.error).items()}
    if not costs:
        yield "  peers        no peers.json"
    elif folder.resolve() != scene.parent.resolve():
        yield f"  peers        of another scene, {folder.name}"
    for peer, cost in sorted(costs.items(), key=lambda pair: pair[1]):
        if math.isfinite(cost):
            yield f"  {peer:22} {cost:9.1f} CPU s at that error = {judge.times(cost / cpu)}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=pathlib.Path, metavar="SCENE")
    parser.add_argument("--bin", default="target/release/glowtree")
    parser.add_argument("--error", default="2%", help="target of the bake (default: 2%%)")
    parser.add_argument("--mesh", help="file of the mesh, as scene.toml names it")
    parser.add_argument("--points", type=int, default=1600, help="vertices judged (default: 1600)")
    parser.add_argument("--spp", type=int, default=1024, help="paths a point of the reference (default: 1024)")
    parser.add_argument("--seed", type=int, default=1, help="of the choice of vertices")
    parser.add_argument("--peers", type=pathlib.Path, metavar="FOLDER", help="whose peers.json to compare with")
    parser.add_argument("--cache", help="JSON file that keeps the reference")
    parser.add_argument("--bake-options", default="", metavar="WORDS", help='further flags: --bake-options="--seed 3"')
    arguments = parser.parse_args()
    scene = arguments.scene / "scene.toml" if arguments.scene.is_dir() else arguments.scene
    if not scene.exists():
        print(f"skipped: no {scene}")
        return 0
    try:
        print("\n".join(told(arguments, scene, measure(arguments, judge.Cache(arguments.cache), scene))))
    except judge.Failed as failure:
        print(f"error: {failure}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
