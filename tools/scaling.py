#!/usr/bin/env python3
"""The scaling study: time and memory of `bake` against the number of triangles, on grown meshes of one shape.

    cargo build --release --example grow_mesh
    python3 tools/scaling.py BASE -k 3 10 22 32 --max-memory 4GiB --cache runs.json --document docs/scaling.md --picture docs/pictures/scaling.svg

For each k: grows BASE into k² parts a triangle (the example grow_mesh, --grow-options), stands it on a ground plane under a white
sky and a small area lamp, bakes at --error and takes the summary's figures. Slopes are least squares of log y over log triangles.
Meshes and jobs lie in --scratch and are deleted after each run, unless --keep.

--threads 2 1   bakes with each number of threads; --pin runs those of one thread on the first processor alone (taskset).
--kill N        bakes once more into a new job, SIGKILLs that N times, each time after an N+1-th of the expected wall time (of the
                undisturbed bake, or --expected SECONDS without one), runs it to its end and compares the files of both bit for bit.
--points N      judges N random vertices: `reference` at --spp paths a point against JOB/mesh.ply (--answers mesh), or `probe`.
                The error is RMS over points and channels over the mean, the reference's noise taken out; beside it, that of all
                but the worst hundredth. `reference` holds the scene in memory.

Runs are cached by program, mesh and options. Exit code 1 when a bake fails or a killed one ends differently. Standard library only.
"""
import argparse
import hashlib
import math
import os
import pathlib
import shlex
import shutil
import subprocess
import sys
import tempfile
import threading
import time

import grown_scene
import judge
import scaling_report
import vertex_sample

KEPT = ("seconds", "cpu_seconds", "peak_anonymous_bytes", "peak_resident_bytes", "sites", "links", "rays", "archive_bytes", "estimated_error", "stages")


def killed(command, seconds):
    """Runs a command for so long, then SIGKILLs it: (whether it ended by itself before, CPU seconds)."""
    child = subprocess.Popen([str(word) for word in command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    timer = threading.Timer(seconds, child.kill)
    timer.start()
    try:
        _, status, usage = os.wait4(child.pid, 0)
    except BaseException:
        child.kill()
        raise
    finally:
        timer.cancel()
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode not in (0, -9):
        raise judge.Failed(f"{shlex.join(map(str, command))}: exit code {child.returncode}, not killed")
    return child.returncode == 0, usage.ru_utime + usage.ru_stime


def bake_command(arguments, scene, job, threads):
    pinned = ["taskset", "-c", "0"] if arguments.pin and threads == 1 else []
    command = [*pinned, arguments.bin, "bake", scene, "-o", job, "--error", arguments.error, "-j", threads, "--json", "--progress", "none"]
    command += ["--max-memory", arguments.max_memory] if arguments.max_memory else []
    command += [] if arguments.answers == "mesh" else ["--no-preview"]
    return command + shlex.split(arguments.bake_options)


def digests(job):
    """{file: SHA-256} of what a job holds, but for the summary, which tells times, and what unfinished writes left."""
    out = {}
    for path in sorted(job.rglob("*")):
        if path.is_file() and path.name != "summary.json" and not path.name.startswith("."):
            with open(path, "rb") as file:
                out[path.relative_to(job).as_posix()] = hashlib.file_digest(file, "sha256").hexdigest()
    return out


def bake(arguments, scene, job, threads):
    """The summary's figures of a bake run to its end, what the process cost, and what it left."""
    done = judge.run(bake_command(arguments, scene, job, threads))
    summary = judge.last_summary(done.text)
    kept = {name: summary.get(name) for name in (*KEPT, "resumed_blocks", "computed_blocks")}
    job_bytes = sum(path.stat().st_size for path in job.rglob("*") if path.is_file())
    return {**kept, "wall_seconds": done.wall_seconds, "process_cpu_seconds": done.cpu_seconds, "megabytes": done.megabytes, "job_bytes": job_bytes}


def bake_killed(arguments, scene, folder, undisturbed):
    """A bake killed on its way: how often, what it cost in all, whether its files are those of the undisturbed one."""
    threads, job = arguments.threads[0], folder / "killed.glow"
    expected = arguments.expected or undisturbed["wall_seconds"]
    cpu, start, kills = 0.0, time.monotonic(), 0
    for _ in range(arguments.kill):
        ended, spent = killed(bake_command(arguments, scene, job, threads), expected / (arguments.kill + 1))
        cpu += spent
        if ended:
            break
        kills += 1
    last = bake(arguments, scene, job, threads)
    out = {"kills": kills, "wall_seconds": time.monotonic() - start, "process_cpu_seconds": cpu + last["process_cpu_seconds"]}
    out["resumed_blocks"], out["computed_blocks"] = last["resumed_blocks"], last["computed_blocks"]
    out["left_bytes"] = sum(path.stat().st_size for path in job.glob(".glowtree-*"))
    reference = folder / f"job-{threads}.glow"
    if reference.exists():
        ours, theirs = digests(job), digests(reference)
        out["different"] = sorted(name for name in ours.keys() | theirs.keys() if ours.get(name) != theirs.get(name))
    remove(arguments, job)
    return out


def accuracy(arguments, scene, job):
    """The error at random vertices of the grown mesh, the first of the scene."""
    folder = scene.parent
    points = vertex_sample.sampled(folder / "grown.ply", arguments.points, arguments.seed)
    table, truth, out = folder / "points.csv", folder / "truth.csv", folder / "out.csv"
    judge.write_points(table, [(position, normal) for _, position, normal in points])
    traced = judge.reference(arguments.bin, scene, table, truth, arguments.spp)
    if arguments.answers == "mesh":
        names = [f"irradiance_{c}" for c in "rgb"]
        rows = vertex_sample.layout(job / "mesh.ply").rows([index for index, _, _ in points], *names)
        got = [dict(zip(names, rows[index])) for index, _, _ in points]
    else:
        judge.probe(arguments.bin, job, table, out)
        got = judge.read_rows(out)
    known = judge.read_rows(truth)
    verdict = judge.judge(got, known)
    most = sorted(zip(got, known), key=lambda pair: math.dist(*map(judge.irradiance, pair)))
    # Vertices in folds, whose own light differs from that of all their neighbours, may hold most of the squares.
    trimmed = judge.judge(*zip(*most[: math.ceil(0.99 * len(most))]))
    return {**vars(verdict), "error_of_99": trimmed.error, "reference_seconds": traced.cpu_seconds}


def remove(arguments, path):
    if arguments.keep:
        return
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def measure(arguments, k):
    """All bakes of one size."""
    arguments.scratch.mkdir(parents=True, exist_ok=True)
    folder = pathlib.Path(tempfile.mkdtemp(prefix=f"k{k}-", dir=arguments.scratch))
    options = ["--seed", arguments.seed, *shlex.split(arguments.grow_options)]
    try:
        triangles, vertices, grown = grown_scene.grow(arguments.grower, arguments.base, k, options, folder / "grown.ply")
        judge.note(f"k = {k}: {triangles} triangles grown in {grown.wall_seconds:.1f} s, {shutil.disk_usage(folder).free / 1e9:.1f} GB free")
        about = f"{arguments.base.name} grown by k = {k}, on a ground plane under a white sky and an area lamp; tools/scaling.py"
        scene = grown_scene.write(folder, grown_scene.bounds(arguments.grower, arguments.base, options), arguments.up, about)
        out = {"k": k, "triangles": triangles, "vertices": vertices, "mesh_bytes": (folder / "grown.ply").stat().st_size, "grow_seconds": grown.wall_seconds}
        out["bakes"] = {}
        for threads in [] if arguments.kill and arguments.expected else arguments.threads:
            job = folder / f"job-{threads}.glow"
            out["bakes"][str(threads)] = bake(arguments, scene, job, threads)
            judge.note(f"k = {k}, -j {threads}: {out['bakes'][str(threads)]['wall_seconds']:.1f} s")
            if arguments.points and threads == arguments.threads[0]:
                out["verdict"] = accuracy(arguments, scene, job)
                judge.note(f"k = {k}: true error {judge.share(out['verdict']['error'])}")
            if not (arguments.kill and threads == arguments.threads[0]):
                remove(arguments, job)
        if arguments.kill:
            out["killed"] = bake_killed(arguments, scene, folder, out["bakes"].get(str(arguments.threads[0])))
        return out
    finally:
        remove(arguments, folder)


def parsed():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("base", type=pathlib.Path, metavar="BASE", help="the small scan")
    parser.add_argument("-k", type=int, nargs="+", required=True, help="parts of each edge, a run each")
    parser.add_argument("--bin", default="target/release/glowtree")
    parser.add_argument("--grower", default="target/release/examples/grow_mesh")
    parser.add_argument("--grow-options", default="", metavar="WORDS", help='further flags of the grower: --grow-options="--shuffle"')
    parser.add_argument("--up", choices="xyz", default="z", help="of the base (default: z)")
    parser.add_argument("--error", default="3%", help="target of the bakes (default: 3%%)")
    parser.add_argument("--max-memory", metavar="SIZE")
    parser.add_argument("--threads", type=int, nargs="+", default=[os.cpu_count()], help="a bake each, the first is judged (default: all)")
    parser.add_argument("--pin", action="store_true", help="bakes of one thread on one processor")
    parser.add_argument("--bake-options", default="", metavar="WORDS", help='further flags of the bake: --bake-options="--seed 3"')
    parser.add_argument("--kill", type=int, default=0, metavar="N", help="kill a second bake so often")
    parser.add_argument("--expected", type=float, metavar="SECONDS", help="with --kill: no undisturbed bake, this is its time")
    parser.add_argument("--points", type=int, default=0, metavar="N", help="vertices judged (default: none)")
    parser.add_argument("--spp", type=int, default=1024, help="paths a point of the reference (default: 1024)")
    parser.add_argument("--answers", choices=("mesh", "probe"), default="mesh", help="what is judged; probe bakes without mesh.ply (default: mesh)")
    parser.add_argument("--seed", type=int, default=1, help="of the mesh and of the choice of vertices")
    parser.add_argument("--scratch", type=pathlib.Path, default=pathlib.Path(tempfile.gettempdir()), metavar="DIR", help="where meshes and jobs lie")
    parser.add_argument("--keep", action="store_true", help="delete nothing")
    parser.add_argument("--cache", help="JSON file that keeps the runs")
    parser.add_argument("--document", type=pathlib.Path, metavar="FILE", help="Markdown whose tables between the markers are replaced")
    parser.add_argument("--picture", type=pathlib.Path, metavar="FILE", help="SVG to write")
    arguments = parser.parse_args()
    if arguments.points and arguments.kill and arguments.expected:
        parser.error("--points judges the undisturbed bake, which --expected leaves out")
    return arguments


def main():
    arguments = parsed()
    cache, runs, failed = judge.Cache(arguments.cache), [], False
    made = judge.fingerprint(arguments.bin, arguments.grower, arguments.base)
    names = ("grow_options", "up", "error", "max_memory", "threads", "pin", "bake_options", "kill", "expected", "points", "spp", "answers", "seed")
    asked = " ".join(str(vars(arguments)[name]) for name in names)
    for k in sorted(set(arguments.k)):
        try:
            runs.append(cache.take(f"{k} {asked} {made}", lambda k=k: measure(arguments, k)))
        except judge.Failed as failure:
            print(f"error: k = {k}: {failure}", file=sys.stderr)
            failed = True
            continue
        failed |= bool(runs[-1].get("killed", {}).get("different"))
    if not runs:
        return 1
    text = scaling_report.tables(runs)
    print(text)
    if arguments.document:
        scaling_report.replace(arguments.document, text)
    if arguments.picture and any(run["bakes"] for run in runs):
        scaling_report.draw(arguments.picture, runs, f"{arguments.base.stem} grown, target {arguments.error}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
