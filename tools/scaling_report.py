"""Tables and the picture of scaling.py from its runs. Python standard library only."""
import math

import judge
from svg_plot import LOOKS, Panel, counted, headline, legend, page, seconds

BEGIN, END = "<!-- scaling: begin -->", "<!-- scaling: end -->"
PANEL, MARGIN, GAP, SHOWN_STAGES = (380, 320), 84, 110, 4
HEAD = ["k", "triangles, M", "mesh, GB", "threads", "seconds", "CPU s", "CPU µs / triangle", "peak anonymous, GB", "peak resident, GB"]
HEAD += ["archives, GB", "job, GB", "sites", "links", "rays", "claimed", "true error", "of the best 99 %"]


def first(run):
    """The figures of a run's first number of threads; None when all its bakes were killed on the way."""
    return next(iter(run["bakes"].values()), None)


def stage_sums(bake, what="seconds"):
    """{stage: seconds}, passes of a stage that comes more than once together."""
    out = {}
    for stage in bake["stages"]:
        out[stage["name"]] = out.get(stage["name"], 0.0) + stage[what]
    return out


def table(head, rows):
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def gigabytes(value):
    return f"{value / 1e9:.3g}"


def million(value):
    return f"{value / 1e6:.2f}" if value < 1e8 else f"{value / 1e6:.0f}"


def slope(pairs):
    value, _ = judge.fitted_slope(pairs)
    return f"{value:.2f}" if math.isfinite(value) else "–"


def whole(runs):
    """A row a bake: what it took and what it left."""
    for run in runs:
        for threads, bake in run["bakes"].items():
            verdict = run.get("verdict") if bake is first(run) else None
            error = f"{100 * verdict['error']:.2f} ± {100 * verdict['doubt']:.2f} %" if verdict else "–"
            row = [str(run["k"]), million(run["triangles"]), gigabytes(run["mesh_bytes"]), threads, f"{bake['wall_seconds']:.1f}"]
            row += [f"{bake['process_cpu_seconds']:.1f}", f"{1e6 * bake['process_cpu_seconds'] / run['triangles']:.2f}"]
            row += [gigabytes(bake[name]) for name in ("peak_anonymous_bytes", "peak_resident_bytes", "archive_bytes", "job_bytes")]
            row += [str(bake[name]) for name in ("sites", "links", "rays")]
            best = judge.share(verdict["error_of_99"]) if verdict else "–"
            yield row + [judge.share(bake["estimated_error"] or math.nan), error, best]
    if len(runs) > 1:
        pairs = [(run["triangles"], first(run)) for run in runs]
        names = ("wall_seconds", "process_cpu_seconds", None, "peak_anonymous_bytes", "peak_resident_bytes", "archive_bytes", "job_bytes", "sites", "links", "rays")
        fits = [slope([(x, bake[name]) for x, bake in pairs]) if name else "" for name in names]
        yield ["slope", "", "", next(iter(runs[0]["bakes"])), *fits, "", "", ""]


def stages(runs):
    """A row a stage: seconds of each size, CPU seconds of the last, and the slopes of both."""
    names = list(dict.fromkeys(name for run in reversed(runs) for name in stage_sums(first(run))))
    for name in names:
        wall = [(run["triangles"], stage_sums(first(run)).get(name, 0.0)) for run in runs]
        cpu = [(run["triangles"], stage_sums(first(run), "cpu_seconds").get(name, 0.0)) for run in runs]
        yield [name, *(f"{y:.2f}" for _, y in wall), slope(wall), f"{cpu[-1][1]:.2f}", slope(cpu)]


def threads_rows(runs):
    """A row a stage of the largest mesh: seconds by the number of threads."""
    bakes = runs[-1]["bakes"]
    for name in stage_sums(first(runs[-1])):
        yield [name, *(f"{stage_sums(bake).get(name, 0.0):.2f}" for bake in bakes.values())]
    yield ["all", *(f"{bake['wall_seconds']:.2f}" for bake in bakes.values())]


def killed_rows(runs):
    for run in runs:
        one = run.get("killed")
        if not one:
            continue
        calm = first(run)
        more = f"{100 * (one['process_cpu_seconds'] / calm['process_cpu_seconds'] - 1):.1f} %" if calm else "–"
        same = "not compared" if "different" not in one else ", ".join(one["different"]) or "none"
        row = [million(run["triangles"]), str(one["kills"]), f"{one['wall_seconds']:.1f}", f"{calm['wall_seconds']:.1f}" if calm else "–"]
        yield row + [more, str(one["resumed_blocks"]), str(one["computed_blocks"]), same, gigabytes(one["left_bytes"])]


def tables(runs):
    """Markdown of all that was measured."""
    baked, out = [run for run in runs if run["bakes"]], []
    if baked:
        out.append(table(HEAD, whole(baked)))
        threads = next(iter(baked[0]["bakes"]))
        out.append(f"Seconds of each stage, {threads} threads, by triangles:")
        sizes = [f"{million(run['triangles'])} M" for run in baked]
        out.append(table(["stage", *sizes, "slope", f"CPU s at {sizes[-1]}", "slope of CPU"], stages(baked)))
        if len(baked[-1]["bakes"]) > 1:
            out.append(f"Seconds by threads, {sizes[-1]} triangles:")
            out.append(table(["stage", *(f"-j {count}" for count in baked[-1]["bakes"])], threads_rows(baked)))
    killed = list(killed_rows(runs))
    if killed:
        out.append("Killed on the way and run again:")
        head = ["triangles, M", "kills", "seconds in all", "undisturbed", "more CPU", "blocks resumed", "computed by the last run", "files that differ", "left over, GB"]
        out.append(table(head, killed))
    return "\n\n".join(out)


def replace(path, text):
    """Puts the tables between the markers of a document."""
    whole_text = path.read_text(encoding="utf-8")
    before, found, rest = whole_text.partition(BEGIN)
    _, ended, after = rest.partition(END)
    if not found or not ended:
        raise SystemExit(f"error: {path}: holds no {BEGIN} … {END}")
    path.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{after}", encoding="utf-8")


def fit_line(panel, pairs, look):
    steep, height = judge.fitted_slope(pairs)
    if math.isfinite(steep):
        ends = [min(x for x, _ in pairs), max(x for x, _ in pairs)]
        panel.line([(x, math.exp(height) * x**steep) for x in ends], look)


def panel_of(title, y_label, left, series, formats):
    """[(name, pairs)] against triangles, with fits and a legend below, one line each."""
    series = [(name, [(x, y) for x, y in pairs if y > 0]) for name, pairs in series]
    series = [(name, pairs) for name, pairs in series if pairs]
    xs, ys = ([p[axis] for _, pairs in series for p in pairs] for axis in (0, 1))
    panel, parts = Panel(title, (left, 62, *PANEL), xs, ys), []
    for k, (name, pairs) in enumerate(series):
        fit_line(panel, pairs, LOOKS[k])
        panel.marks(pairs, LOOKS[k])
        steep = slope(pairs)
        parts += legend([(name if steep == "–" else f"{name}: slope {steep}", LOOKS[k])], (left + 60, 62 + PANEL[1] + 60 + 20 * k), 0)
    return panel.svg("triangles", y_label, formats) + parts


def draw(path, runs, title):
    """Seconds per stage and bytes, against triangles."""
    baked = [run for run in runs if run["bakes"]]
    last = stage_sums(first(baked[-1]))
    names = sorted(last, key=last.get, reverse=True)[:SHOWN_STAGES]
    over = lambda value: [(run["triangles"], value(run)) for run in baked]
    times = [("all", over(lambda run: first(run)["wall_seconds"]))]
    times += [(name, over(lambda run, name=name: stage_sums(first(run)).get(name, 0.0))) for name in names]
    sizes = [(f"{what}, GB", over(lambda run, name=name: first(run)[name] / 1e9)) for what, name in (("peak anonymous memory", "peak_anonymous_bytes"), ("archives", "archive_bytes"))]
    sizes.append(("mesh file, GB", over(lambda run: run["mesh_bytes"] / 1e9)))
    width = MARGIN + 2 * PANEL[0] + GAP + 24
    parts = [headline((width / 2, 26), title, 15)]
    parts += panel_of("time", "seconds", MARGIN, times, (counted, seconds))
    parts += panel_of("memory and disk", "GB", MARGIN + PANEL[0] + GAP, sizes, (counted, seconds))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(page(width, 62 + PANEL[1] + 70 + 20 * (SHOWN_STAGES + 1), parts), encoding="utf-8")
