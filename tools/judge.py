"""Runs glowtree as users do and holds its answers against others; shared by the chart_ and measure_ scripts.

Every cost is the CPU time of a whole process, user and system, its threads included, from os.wait4. Python standard library only.
"""
import csv
import hashlib
import json
import math
import os
import pathlib
import shlex
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass

PEER_POINTS = 20_000  # at which the peers of peers.json were measured


class Failed(Exception):
    """A run of the program that ended with another code than 0."""


@dataclass
class Run:
    """What a process cost."""

    text: str
    cpu_seconds: float
    wall_seconds: float
    megabytes: float


@dataclass
class Verdict:
    """Errors relative to the mean irradiance of the reference, its noise taken out of `error`."""

    error: float  # root of the mean square over points and channels
    doubt: float  # standard error of `error` from the spread of the points' squares
    worst: float
    noise: float
    mean: float
    points: int


def run(command):
    """Runs a command to its end; raises Failed when it ends with another code than 0."""
    start = time.monotonic()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = subprocess.Popen([str(word) for word in command], stdout=out, stderr=err)
        try:
            _, status, usage = os.wait4(child.pid, 0)
        except BaseException:
            child.kill()
            raise
        child.returncode = os.waitstatus_to_exitcode(status)
        texts = []
        for stream in (out, err):
            stream.seek(0)
            texts.append(stream.read().decode(errors="replace"))
    if child.returncode:
        told = (texts[1].strip() or texts[0].strip())[-400:]
        raise Failed(f"{shlex.join(map(str, command))}: exit code {child.returncode}: {told}")
    return Run(texts[0], usage.ru_utime + usage.ru_stime, time.monotonic() - start, usage.ru_maxrss / 1024)


def bake(program, scene, job, options=()):
    """Bakes without pictures; returns the summary and the cost."""
    done = run([program, "bake", scene, "-o", job, "--json", "--progress", "none", "--no-preview", *options])
    return last_summary(done.text), done


def last_summary(text):
    """The summary among the JSON lines of a run."""
    lines = [json.loads(line) for line in text.splitlines() if line.strip()]
    return next(line for line in reversed(lines) if line.get("type") == "summary")


def probe(program, job, points, out):
    """Answers for the points of a table; returns the cost."""
    return run([program, "probe", job, "--points", points, "-o", out, "--progress", "none", "-q"])


def reference(program, scene, points, out, samples):
    """Path traces the points of a table; returns the cost."""
    return run([program, "reference", scene, "--points", points, "--spp", samples, "-o", out, "--progress", "none", "-q"])


def read_rows(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def write_points(path, points):
    """A table of (position, normal) pairs that reads back exactly."""
    with open(path, "w", newline="") as file:
        file.write("x,y,z,nx,ny,nz\n")
        for position, normal in points:
            file.write(",".join(repr(float(c)) for c in (*position, *normal)) + "\n")


def irradiance(row):
    for head in ("irradiance", "E"):
        if f"{head}_r" in row:
            return [float(row[f"{head}_{c}"]) for c in "rgb"]
    raise SystemExit(f"error: no irradiance among the columns {list(row)}")


def noise_variance(row):
    """Mean over the channels of the squared standard error; 0 for exact answers."""
    if "stderr_r" in row:
        return sum(float(row[f"stderr_{c}"]) ** 2 for c in "rgb") / 3
    return float(row.get("stderr") or 0) ** 2


def judge(result, truth):
    """The verdict on a table by another whose points are a prefix of the first's."""
    squares, noise, total = [], 0.0, 0.0
    for got, want in zip(result, truth, strict=False):
        a, b = irradiance(got), irradiance(want)
        squares.append(sum((x - y) ** 2 for x, y in zip(a, b)) / 3)
        noise += noise_variance(want)
        total += sum(b) / 3
    n = len(truth)
    if len(squares) < n:
        raise SystemExit(f"error: {len(squares)} answers for {n} known points")
    mean, square, noise = total / n, sum(squares) / n, noise / n
    if not math.isfinite(square):
        return Verdict(math.inf, math.nan, math.inf, math.sqrt(noise) / mean, mean, n)
    spread = math.sqrt(sum((s - square) ** 2 for s in squares) / max(n - 1, 1) / n)
    error = math.sqrt(max(square - noise, 0.0))
    doubt = spread / (2 * error) if error > 0 else math.sqrt(spread)
    return Verdict(error / mean, doubt / mean, math.sqrt(max(squares)) / mean, math.sqrt(noise) / mean, mean, n)


def peer_cost(curve, error):
    """CPU seconds that a peer needs for `error`, from its settings [(CPU seconds, error)].

    Error ~ cost^-slope through the two settings around `error`, through the last two beyond them and through the first two before.
    Infinite where the peer's error does not fall from one to the other, and for a single setting.
    """
    curve = sorted(curve)
    if len(curve) < 2 or error <= 0:
        return math.inf
    steps = list(zip(curve, curve[1:]))
    around = [step for step in steps if step[1][1] <= error <= step[0][1]]
    (c0, e0), (c1, e1) = around[0] if around else steps[0 if error > curve[0][1] else -1]
    slope = math.log(e0 / e1) / math.log(c1 / c0) if e1 < e0 and c1 > c0 else 0
    return c1 * (e1 / error) ** (1 / slope) if slope > 0.05 else math.inf


def peer_costs(folder, error):
    """{peer: CPU seconds for `error`} from a folder's peers.json; empty without one."""
    return {peer: peer_cost(curve, error) for peer, curve in peer_curves(folder).items()}


def peer_curves(folder):
    path = pathlib.Path(folder) / "peers.json"
    return json.loads(path.read_text()) if path.exists() else {}


def plain(costs):
    """The cost of the tracer written for the purpose, the hardest of the plain path tracers to beat."""
    return min((c for peer, c in costs.items() if "bespoke" in peer), default=math.nan)


def cheapest(costs):
    """(name, cost) of the cheapest peer that people can install."""
    return min(((p, c) for p, c in costs.items() if "bespoke" not in p), key=lambda pair: pair[1], default=("–", math.nan))


def fitted_slope(pairs):
    """Slope and intercept of log y over log x by least squares."""
    logs = [(math.log(x), math.log(y)) for x, y in pairs if x > 0 and y > 0]
    if len(logs) < 2:
        return math.nan, math.nan
    mx, my = (sum(column) / len(logs) for column in zip(*logs))
    across = sum((x - mx) ** 2 for x, _ in logs)
    slope = sum((x - mx) * (y - my) for x, y in logs) / across if across else math.nan
    return slope, my - slope * mx


def fingerprint(*paths):
    """Tells contents apart: what was measured with another program or other files is not taken from the cache."""
    digest = hashlib.sha256()
    for path in paths:
        digest.update(hashlib.sha256(pathlib.Path(path).read_bytes()).digest())
    return digest.hexdigest()[:16]


class Cache:
    """Measurements in a JSON file, whole after every one, so that a run that was stopped goes on where it was."""

    def __init__(self, path):
        self.path = pathlib.Path(path) if path else None
        self.held = json.loads(self.path.read_text()) if self.path and self.path.exists() else {}

    def take(self, key, measure):
        """What is held under the key; else measures, keeps and returns it."""
        if key not in self.held:
            self.held[key] = measure()
            if self.path:
                partial = self.path.with_name(self.path.name + ".part")
                partial.write_text(json.dumps(self.held, indent=1) + "\n")
                partial.replace(self.path)
        return self.held[key]


def share(value, digits=2):
    return f"{100 * value:.{digits}f} %" if math.isfinite(value) else "–"


def times(value):
    return f"{value:.3g} ×" if math.isfinite(value) else "–"


def note(text):
    """Progress, beside the results."""
    print(text, file=sys.stderr, flush=True)
