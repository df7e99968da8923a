#!/usr/bin/env python3
"""Charts cost against size: one scene at a ladder of error targets, with log-log fits over the sites.

    python3 tools/chart_sizes.py data/rooms/scene.toml --cache sizes.json -o docs/pictures/sizes.svg

What is matched, and what is not. `bake` has no option that fixes the number of sites, so the targets do: each is --step
tighter than the last, from --first on, until a bake has --sites or the next, by the slope so far, would not end within
--minutes. A tighter target asks for more sites *and* for longer rows (rays a row grow about as 1/error up to a cap), so
the error falls along the ladder and plain cost against sites is steeper than the method is. Therefore three slopes:

  CPU        bake's CPU seconds over sites: what a user pays, error *not* matched
  links      links over sites: memory, error not matched either
  matched    CPU seconds × (error / error of the first rung)² over sites: the cost at the first rung's error *if* all error
             were noise of rows and fell as 1/√(rays), which is the plain path tracer's law. It removes what longer rows
             cost; it takes too much away where error is interpolation's. Error is the program's own estimate, or the true
             one with --reference FOLDER (points.csv, reference.csv of the same scene).

With --copies K,K,… the size grows otherwise: K × K copies of the scene side by side at one target, --first. Each copy's
light is its own in a closed scene, so that work would be K² at equal error *of each copy* were resolution set by the
target alone; where plans share one budget of receivers over all area, the estimate says how far the error is from matched.

Rungs are cached by program and scene. Exit code 1 when a bake fails. Python standard library only.
"""
import argparse
import math
import pathlib
import re
import shlex
import sys
import tempfile
from dataclasses import dataclass

import judge
from svg_plot import LOOKS, Panel, counted, headline, legend, page, seconds

PANEL, MARGIN, GAP = (360, 320), 84, 96


@dataclass
class Series:
    """One quantity over the sites."""

    title: str
    unit: str
    pairs: list

    @property
    def fit(self):
        return judge.fitted_slope(self.pairs)


def measure(arguments, scene, error):
    judge.note(f"{scene}: {judge.share(error, 3)} …")
    with tempfile.TemporaryDirectory() as scratch:
        job, out = pathlib.Path(scratch) / "job.glow", pathlib.Path(scratch) / "out.csv"
        options = ["--error", f"{100 * error:g}%", *shlex.split(arguments.bake_options)]
        summary, baked = judge.bake(arguments.bin, scene, job, options)
        true = None
        if arguments.reference:
            judge.probe(arguments.bin, job, arguments.reference / "points.csv", out)
            truth = judge.read_rows(arguments.reference / "reference.csv")
            true = judge.judge(judge.read_rows(out), truth).error
    kept = {name: summary[name] for name in ("sites", "links", "rays", "estimated_error", "archive_bytes")}
    return {"target": error, "true": true, "cpu_seconds": baked.cpu_seconds, "megabytes": baked.megabytes, **kept}


def by_error(arguments, cache):
    """Rungs of tighter and tighter targets."""
    error, rungs, spent = arguments.first / 100, [], 0.0
    made = judge.fingerprint(arguments.bin, arguments.scene, *([arguments.reference / "reference.csv"] if arguments.reference else []))
    while error > 1e-5:
        key = f"{arguments.scene.parent.name} {100 * error:.4g}% {arguments.bake_options} {made}"
        rungs.append(cache.take(key, lambda: measure(arguments, arguments.scene, error)))
        spent += rungs[-1]["cpu_seconds"]
        growth = max(rungs[-1]["cpu_seconds"] / rungs[-2]["cpu_seconds"], 1.0) if len(rungs) > 1 else 2.0
        if rungs[-1]["sites"] >= arguments.sites:
            break
        if rungs[-1]["cpu_seconds"] * growth > 60 * arguments.minutes - spent:
            judge.note(f"stopped: the next bake would take about {rungs[-1]['cpu_seconds'] * growth:.0f} CPU s more than --minutes leave")
            break
        error /= arguments.step
    return rungs


def by_copies(arguments, cache):
    """Rungs of more and more copies, in a floor plan of K × K."""
    rungs, made = [], judge.fingerprint(arguments.bin, arguments.scene)
    for across in (int(k) for k in arguments.copies.split(",")):
        key = f"{arguments.scene.parent.name} {across}x{across} {arguments.first}% {arguments.bake_options} {made}"
        with tempfile.TemporaryDirectory() as scratch:
            plan = pathlib.Path(scratch) / f"{arguments.scene.parent.name}_{across}x{across}.toml"
            plan.write_text(copied(arguments.scene, across, arguments.pitch), encoding="utf-8")
            rungs.append(cache.take(key, lambda: measure(arguments, plan, arguments.first / 100)))
    return rungs


def copied(scene, across, pitch):
    """The text of a scene of across × across copies, `pitch` apart along x and z."""
    blocks = re.split(r"(?m)^(?=\[)", scene.read_text(encoding="utf-8"))
    meshes = [block for block in blocks if block.startswith("[[mesh]]")]
    if any("transform" in mesh for mesh in meshes):
        raise SystemExit(f"error: {scene}: --copies moves meshes and finds them moved already")
    folder, out = scene.resolve().parent, []
    for k in range(across * across):
        for number, mesh in enumerate(meshes):
            mesh = re.sub(r'(?m)^name *=.*\n?', "", mesh).rstrip()
            mesh = re.sub(r'(?m)^file *= *"(.*)"', lambda m: f'file = "{(folder / m[1]).as_posix()}"', mesh)
            move = f"[{pitch * (k % across)!r}, 0.0, {pitch * (k // across)!r}]"
            out.append(f'{mesh}\nname = "copy{k}_{number}"\ntransform = {{ translate = {move} }}\n')
    return "\n".join(out)


def error_of(rung):
    return rung["true"] if rung["true"] is not None else rung["estimated_error"]


def series(rungs):
    first = error_of(rungs[0])
    matched = [(r["sites"], r["cpu_seconds"] * (error_of(r) / first) ** 2) for r in rungs]
    return [
        Series("CPU", "CPU seconds of the bake", [(r["sites"], r["cpu_seconds"]) for r in rungs]),
        Series("links", "links", [(r["sites"], r["links"]) for r in rungs]),
        Series("matched", f"CPU seconds at {100 * first:.2g} %", matched),
    ]


def table(rungs):
    head = ["target", "true error", "claimed", "sites", "links", "links / site", "rays / site", "CPU s", "CPU µs / site", "peak MB"]
    yield "| " + " | ".join(head) + " |"
    yield "|" + "---|" * len(head)
    for rung in rungs:
        sites = rung["sites"]
        cells = [f"{100 * rung['target']:.3g} %", judge.share(rung["true"]) if rung["true"] is not None else "–", judge.share(rung["estimated_error"])]
        cells += [str(sites), str(rung["links"]), f"{rung['links'] / sites:.1f}", f"{rung['rays'] / sites:.1f}"]
        cells += [f"{rung['cpu_seconds']:.2f}", f"{1e6 * rung['cpu_seconds'] / sites:.1f}", f"{rung['megabytes']:.0f}"]
        yield "| " + " | ".join(cells) + " |"


def panel(one, look, left):
    slope, start = one.fit
    xs = [x for x, _ in one.pairs]
    fit = [(x, math.exp(start) * x**slope) for x in (min(xs), max(xs))]
    chart = Panel(f"{one.title}: slope {slope:.2f}", (left, 62, *PANEL), xs, [y for _, y in one.pairs + fit])
    chart.line(fit, (look[0], "6 4", look[2]), 1.4)
    chart.marks(one.pairs, look, 4.6)
    return chart.svg("sites", one.unit, (counted, counted if one.title == "links" else seconds))


def draw(arguments, rungs):
    shown = [one for one in series(rungs) if math.isfinite(one.fit[0]) and all(y > 0 for _, y in one.pairs)]
    width = MARGIN + len(shown) * PANEL[0] + (len(shown) - 1) * GAP + 24
    way = "copies side by side" if arguments.copies else "tighter and tighter targets"
    parts = [headline((width / 2, 26), f"{arguments.scene.parent.name}: cost against size, {way}", 15)]
    for k, one in enumerate(shown):
        parts += panel(one, LOOKS[k], MARGIN + k * (PANEL[0] + GAP))
    parts += legend([("bakes, and the least-squares line through them", LOOKS[0])], (width / 2 - 160, 62 + PANEL[1] + 60), 0)
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    arguments.output.write_text(page(width, 62 + PANEL[1] + 80, parts), encoding="utf-8")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=pathlib.Path, nargs="?", default=pathlib.Path("data/rooms/scene.toml"))
    parser.add_argument("--bin", default="target/release/glowtree")
    parser.add_argument("--first", type=float, default=5.0, help="first, loosest target in percent (default: 5)")
    parser.add_argument("--step", type=float, default=1.5, help="factor between targets (default: 1.5)")
    parser.add_argument("--sites", type=int, default=1_000_000, help="enough sites (default: 1000000)")
    parser.add_argument("--minutes", type=float, default=10.0, help="CPU minutes for all bakes (default: 10)")
    parser.add_argument("--copies", help="K,K,…: grow by copies at the first target instead")
    parser.add_argument("--pitch", type=float, default=10.0, help="from copy to copy, scene units (default: 10, enough for data/rooms)")
    parser.add_argument("--reference", type=pathlib.Path, metavar="FOLDER", help="points.csv and reference.csv for true errors")
    parser.add_argument("--cache", help="JSON file that keeps the measurements")
    parser.add_argument("--bake-options", default="", metavar="WORDS", help='further flags: --bake-options="--seed 3"')
    parser.add_argument("-o", "--output", type=pathlib.Path, help="SVG to write")
    arguments = parser.parse_args()
    if arguments.reference and (arguments.copies or not (arguments.reference / "reference.csv").exists()):
        parser.error("--reference wants a folder with reference.csv and no --copies")
    cache = judge.Cache(arguments.cache)
    try:
        rungs = by_copies(arguments, cache) if arguments.copies else by_error(arguments, cache)
    except judge.Failed as failure:
        print(f"error: {failure}")
        return 1
    print("\n".join(table(rungs)))
    print()
    for one in series(rungs):
        print(f"slope of {one.title} ({one.unit}) over sites: {one.fit[0]:.3f}")
    if arguments.output:
        draw(arguments, rungs)
    return 0


if __name__ == "__main__":
    sys.exit(main())
