#!/usr/bin/env python3
"""Charts true error against CPU seconds, for glowtree at a ladder of targets and for its peers.

    python3 tools/chart_errors.py ../shared/reference --cache errors.json -o docs/pictures/errors.svg

REFERENCE holds a folder a scene: scene.toml, points.csv, reference.csv (a prefix of the points) and peers.json. For each scene
and target: `bake` and `probe` of all points as whole processes; CPU seconds are theirs. Error: RMS of RGB irradiance at the
reference's points over its mean, the reference's noise taken out; ± is its standard error from the spread of the points.
Peers' seconds at the same error: error ~ cost^-slope through their two nearest settings. Measurements are kept in the cache by
program and files: a run that was stopped goes on, another program measures anew.

Prints a table in Markdown. Exit codes: 0; 1 when the program fails; 3 when a tighter target has the larger true error.
Without the folder, or for scenes it does not hold, says so and goes on. Python standard library only.
"""
import argparse
import math
import pathlib
import shlex
import sys
import tempfile

import judge
from svg_plot import LOOKS, Panel, headline, legend, page, percent, seconds

SCENES, TARGETS = "cornell,rooms,scan", "10,5,2,1,0.5"
PANEL, MARGIN, GAP = (330, 300), 78, 84


def measure(arguments, folder, target):
    """One bake and its probes, as plain data."""
    judge.note(f"{folder.name}: {judge.share(target, 1)} …")
    with tempfile.TemporaryDirectory() as scratch:
        job, out = pathlib.Path(scratch) / "job.glow", pathlib.Path(scratch) / "out.csv"
        options = ["--error", f"{100 * target:g}%", *shlex.split(arguments.bake_options)]
        summary, baked = judge.bake(arguments.bin, folder / "scene.toml", job, options)
        probed = judge.probe(arguments.bin, job, folder / "points.csv", out)
        verdict = judge.judge(judge.read_rows(out), judge.read_rows(folder / "reference.csv"))
    return {
        "error": verdict.error,
        "doubt": verdict.doubt,
        "worst": verdict.worst,
        "claimed": summary["estimated_error"],
        "cpu_seconds": baked.cpu_seconds + probed.cpu_seconds,
        "wall_seconds": baked.wall_seconds + probed.wall_seconds,
        "megabytes": max(baked.megabytes, probed.megabytes),
        "sites": summary["sites"],
        "links": summary["links"],
    }


def ladder(arguments, cache, folder):
    """[(target, measurement)], loosest first; targets whose run failed are left out and said."""
    needed = [folder / name for name in ("scene.toml", "points.csv", "reference.csv")]
    absent = [path.name for path in needed if not path.exists()]
    if absent:
        judge.note(f"skipped: {folder.name}: no {', '.join(absent)}")
        return [], False
    made = judge.fingerprint(arguments.bin, *needed)
    rungs, failed = [], False
    for target in sorted((float(t) / 100 for t in arguments.targets.split(",")), reverse=True):
        key = f"{folder.name} {100 * target:g}% {arguments.bake_options} {made}"
        try:
            rungs.append((target, cache.take(key, lambda target=target: measure(arguments, folder, target))))
        except judge.Failed as failure:
            judge.note(f"error: {failure}")
            failed = True
    return rungs, failed


def rises(rungs):
    """The targets whose true error is larger than that of a looser one."""
    least, found = math.inf, set()
    for target, rung in rungs:
        if rung["error"] > least:
            found.add(target)
        least = min(least, rung["error"])
    return found


def table(charts):
    """Lines of Markdown."""
    head = ["scene", "target", "true error", "claimed", "claimed / true", "CPU s", "against bespoke Embree", "against the cheapest of the others", ""]
    yield "| " + " | ".join(head) + " |"
    yield "|" + "---|" * len(head)
    for folder, rungs in charts:
        upward = rises(rungs)
        for target, rung in rungs:
            costs = judge.peer_costs(folder, rung["error"])
            name, cost = judge.cheapest(costs)
            ratios = [judge.plain(costs) / rung["cpu_seconds"], cost / rung["cpu_seconds"]]
            other = f"{judge.times(ratios[1])} ({name})" if math.isfinite(ratios[1]) else "–"
            honest = f"{rung['claimed'] / rung['error']:.2f}" if rung["error"] > 0 else "–"
            marks = ["RISES"] * (target in upward) + ["misses"] * (rung["error"] > target)
            cells = [folder.name, f"{100 * target:g} %", f"{100 * rung['error']:.2f} ± {100 * rung['doubt']:.2f} %", judge.share(rung["claimed"]), honest]
            cells += [f"{rung['cpu_seconds']:.2f}", judge.times(ratios[0]), other, ", ".join(marks)]
            yield "| " + " | ".join(cells) + " |"


def panel(folder, rungs, left):
    """One scene's curves. Peers are drawn as far as they were measured."""
    curves = judge.peer_curves(folder)
    ours = [(rung["cpu_seconds"], rung["error"]) for _, rung in rungs if 0 < rung["error"] < math.inf]
    everything = ours + [tuple(point) for curve in curves.values() for point in curve]
    chart = Panel(folder.name, (left, 62, *PANEL), *zip(*everything))
    for (_, curve), look in zip(curves.items(), LOOKS[1:]):
        chart.line(sorted(curve), look, 1.3)
        chart.marks(curve, look, 3.6)
    chart.line(ours, LOOKS[0], 2.6)
    chart.marks(ours, LOOKS[0], 4.6)
    for target, rung in rungs:
        if 0 < rung["error"] < math.inf:
            chart.label((rung["cpu_seconds"], rung["error"]), f"{100 * target:g} %", LOOKS[0][0])
    y_label = "true RMS error of irradiance over its mean"
    return chart.svg("CPU seconds, bake and 20,000 points", y_label, (seconds, percent))


def draw(charts, path):
    charts = [(folder, rungs) for folder, rungs in charts if any(0 < r["error"] < math.inf for _, r in rungs)]
    if not charts:
        return
    width = MARGIN + len(charts) * PANEL[0] + (len(charts) - 1) * GAP + 24
    parts = [headline((width / 2, 26), "Error against cost: glowtree, targets beside its marks, and its peers at the same points", 15)]
    for k, (folder, rungs) in enumerate(charts):
        parts += panel(folder, rungs, MARGIN + k * (PANEL[0] + GAP))
    peers = list(dict.fromkeys(peer for folder, _ in charts for peer in judge.peer_curves(folder)))
    entries = list(zip(["glowtree", *peers], LOOKS))
    step = min(215, (width - 60) / len(entries))
    parts += legend(entries, ((width - step * len(entries)) / 2 + 10, 62 + PANEL[1] + 64), step)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(page(width, 62 + PANEL[1] + 88, parts), encoding="utf-8")
    judge.note(f"{path}: {len(charts)} panels")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("reference", type=pathlib.Path, metavar="REFERENCE")
    parser.add_argument("--bin", default="target/release/glowtree")
    parser.add_argument("--scenes", default=SCENES, help=f"default: {SCENES}")
    parser.add_argument("--targets", default=TARGETS, help=f"in percent, default: {TARGETS}")
    parser.add_argument("--cache", help="JSON file that keeps the measurements")
    parser.add_argument("--bake-options", default="", metavar="WORDS", help='further flags: --bake-options="--seed 3"')
    parser.add_argument("-o", "--output", type=pathlib.Path, help="SVG to write")
    arguments = parser.parse_args()
    if not arguments.reference.is_dir():
        print(f"skipped: no folder {arguments.reference} of reference scenes")
        return 0
    cache, charts, failed = judge.Cache(arguments.cache), [], False
    for name in arguments.scenes.split(","):
        rungs, broken = ladder(arguments, cache, arguments.reference / name)
        charts.append((arguments.reference / name, rungs))
        failed |= broken
    print("\n".join(table(charts)))
    if arguments.output:
        draw(charts, arguments.output)
    upward = [f"{folder.name} at {100 * target:g} %" for folder, rungs in charts for target in sorted(rises(rungs), reverse=True)]
    if upward:
        print(f"\nThe true error rises although the target is tighter: {', '.join(upward)}.")
    return 1 if failed else 3 if upward else 0


if __name__ == "__main__":
    sys.exit(main())
