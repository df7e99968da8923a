#!/usr/bin/env python3
"""Errors of a job's lights, each by itself and in random combinations, after a bake in which some were off.

    python3 tools/measure_switched.py SCENE --points in.csv --error 2% --spp 2000 [--bake=--relightable=false] [--add lamps.toml]

SCENE is a scene.toml; --add appends a piece of TOML to it, as lamps that are off (light of zero). The job is baked and answers by
`relight --set` for each light alone: as bright as the scene has it, 1 where it is off. The judge is `reference` of the scene with
that light alone, at the same points; light adds up, so combinations are judged by sums of these. Errors are relative to the mean of
the light at hand, over the points that it reaches, noise of the judge taken out. References are kept in --keep DIR.

Python standard library only.
"""
import argparse
import csv
import hashlib
import pathlib
import random
import re
import sys
import tempfile
import tomllib

import judge

LIGHT_OF = {"sun": "irradiance", "point": "intensity", "spot": "intensity"}


def toml_value(value):
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {toml_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(toml_value(v) for v in value) + "]"
    return f'"{value}"' if isinstance(value, str) else repr(value)


def toml_text(scene):
    blocks = []
    for key, entries in scene.items():
        several = isinstance(entries, list)
        for entry in entries if several else [entries]:
            lines = [f"[[{key}]]" if several else f"[{key}]"]
            blocks.append("\n".join(lines + [f"{k} = {toml_value(v)}" for k, v in entry.items()]))
    return "\n\n".join(blocks) + "\n"


def lights(scene):
    """[(name for --set, key, colour as baked)]"""
    out = []
    for mesh in scene.get("mesh", []):
        if max(mesh.get("radiance", [0])) > 0:
            out.append((mesh.get("name", pathlib.Path(mesh["file"]).stem), "radiance", mesh["radiance"]))
    for lamp in scene.get("lamp", []):
        key = LIGHT_OF[lamp["kind"]]
        out.append((lamp["name"], key, lamp[key]))
    if "radiance" in scene.get("sky", {}):
        out.append(("sky", "radiance", scene["sky"]["radiance"]))
    return out


def colour_of(light):
    return light[2] if max(light[2]) > 0 else [1.0, 1.0, 1.0]


def alone(scene, name, colour):
    """The scene with one light."""
    out = {**scene, "mesh": [], "lamp": []}
    for mesh in scene.get("mesh", []):
        own = mesh.get("name", pathlib.Path(mesh["file"]).stem) == name
        out["mesh"].append({**mesh, "radiance": colour if own else [0.0, 0.0, 0.0]})
    for lamp in scene.get("lamp", []):
        if lamp["name"] == name:
            out["lamp"].append({**lamp, LIGHT_OF[lamp["kind"]]: colour})
    if name == "sky":
        out["sky"] = {**scene["sky"], "radiance": colour}
    else:
        out.pop("sky", None)
    return out


def references(args, scene, folder):
    """Per light the rows of its reference."""
    keep = pathlib.Path(args.keep) if args.keep else folder
    keep.mkdir(parents=True, exist_ok=True)
    found = {}
    for light in lights(scene):
        text = toml_text(alone(scene, light[0], colour_of(light)))
        key = hashlib.sha256((text + pathlib.Path(args.points).read_text() + args.spp).encode()).hexdigest()[:16]
        out = keep / f"{light[0]}-{key}.csv"
        if not out.exists():
            file = folder / f"{light[0]}.toml"
            file.write_text(text)
            judge.reference(args.bin, file, args.points, out, args.spp)
        found[light[0]] = judge.read_rows(out)
    return found


def combined(parts):
    """The sum of some references: [(rows, weight)]"""
    rows = []
    for own in zip(*(rows for rows, _ in parts)):
        row = {}
        for c in "rgb":
            row[f"irradiance_{c}"] = sum(w * float(r[f"irradiance_{c}"]) for r, (_, w) in zip(own, parts))
            row[f"stderr_{c}"] = sum((w * float(r[f"stderr_{c}"])) ** 2 for r, (_, w) in zip(own, parts)) ** 0.5
        rows.append(row)
    return rows


def reached(result, truth):
    """Only the points that the light reaches."""
    pairs = [(r, t) for r, t in zip(result, truth) if max(judge.irradiance(t)) > 0]
    return [p[0] for p in pairs], [p[1] for p in pairs]


def relit(args, job, folder, all_lights, weights):
    """Answers with lights of some weights."""
    sets = []
    for light in all_lights:
        colour = [weights.get(light[0], 0.0) * c for c in colour_of(light)]
        sets += ["--set", f"{light[0]}.{light[1]}={','.join(map(repr, colour))}"]
    out = folder / "relit.csv"
    judge.run([args.bin, "relight", job, *sets, "--points", args.points, "-o", out, "--progress", "none", "-q"])
    return judge.read_rows(out)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene")
    parser.add_argument("--bin", default="target/release/glowtree")
    parser.add_argument("--points", required=True)
    parser.add_argument("--error", default="2%")
    parser.add_argument("--spp", default="2000")
    parser.add_argument("--bake", default="", help="more options of bake")
    parser.add_argument("--add", help="TOML to append to the scene")
    parser.add_argument("--keep", help="folder for references")
    parser.add_argument("--combinations", type=int, default=4)
    args = parser.parse_args()
    path = pathlib.Path(args.scene).resolve()
    text = path.read_text() + ("\n" + pathlib.Path(args.add).read_text() if args.add else "")
    text = re.sub(r'file = "(?!/)', f'file = "{path.parent}/', text)
    scene = tomllib.loads(text)
    with tempfile.TemporaryDirectory() as temporary:
        folder = pathlib.Path(temporary)
        (folder / "scene.toml").write_text(toml_text(scene))
        truths = references(args, scene, folder)
        summary, cost = judge.bake(args.bin, folder / "scene.toml", folder / "job", ["--error", args.error, *args.bake.split()])
        stages = ", ".join(f"{s['name']} {s['cpu_seconds']:.2f}" for s in summary["stages"])
        print(f"{path.parent.name}: {cost.cpu_seconds:.2f} CPU s ({stages}), {summary['sites']} sites, {summary['rays']} rays")
        print(f"claimed {100 * summary['estimated_error']:.2f} %", *(f"{x['name']} {100 * x['error']:.2f} %" for x in summary.get("lights", [])))
        chance = random.Random(7)
        every = lights(scene)
        cases = [{light[0]: 1.0} for light in every]
        cases += [{light[0]: chance.choice([0.0, 0.03, 0.3, 1.0, 3.0]) for light in every} for _ in range(args.combinations)]
        worst = 0.0
        for weights in cases:
            if not any(weights.values()):
                continue
            truth = combined([(truths[name], weight) for name, weight in weights.items()])
            verdict = judge.judge(*reached(relit(args, folder / "job", folder, every, weights), truth))
            worst = max(worst, verdict.error)
            told = " + ".join(f"{w:g} {n}" for n, w in weights.items() if w)
            print(f"  {100 * verdict.error:6.2f} +- {100 * verdict.doubt:.2f} %  (noise {100 * verdict.noise:.2f} %)  {told}")
        print(f"  worst {100 * worst:.2f} %")


if __name__ == "__main__":
    try:
        main()
    except judge.Failed as problem:
        sys.exit(f"error: {problem}")
