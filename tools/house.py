#!/usr/bin/env python3
"""Checks the house: floors, sizes, words, unsafe. Prints the picture of floors; exit 1 on errors.

    python3 tools/house.py [--root DIR]    check a tree
    python3 tools/house.py --self-test     sabotage a small tree in every way and see that each is noticed

The floors are the table of ARCHITECTURE.md. Python standard library only.
"""
import argparse
import ast
import pathlib
import re
import sys
from dataclasses import dataclass

import rust_text

FILE_LINES, PRODUCTION_LINES, FUNCTION_LINES = 600, 400, 80
FOLDER_FILES, PARAMETERS, PAGE_LINES = 8, 5, 150
FORBIDDEN_MODULES = {"utils", "util", "common", "helpers", "helper", "types", "traits", "misc", "manager", "engine"}
FORBIDDEN_WORDS = {
    "node": "site or cluster",
    "patch": "site",
    "element": "site",
    "surfel": "site",
    "rho": "albedo",
    "kd": "albedo",
    "father": "parent",
    "son": "child",
}
FORBIDDEN_VERBS = ("get_", "compute_", "do_", "process_", "handle_")
UNSAFE_MAP, UNSAFE_FOLDER = "src/archive/map.rs", "src/rays/"

# A foreign vocabulary may be spoken where a foreign format is read: (path prefix, word) -> reason.
ALLOWED_WORDS = {
    ("src/scene/ply", "element"): "PLY calls its tables elements",
    ("src/output/ply", "element"): "PLY calls its tables elements",
    ("src/scene/gltf", "node"): "glTF calls the members of its hierarchy nodes",
    ("src/output/glb", "node"): "glTF calls the members of its hierarchy nodes",
    ("src/rays/", "node"): "obvhs calls the branches it returns nodes",
    ("src/scene/obj", "kd"): "MTL calls the diffuse albedo Kd",
    ("tests/", "element"): "tests write PLY headers",
}


@dataclass(frozen=True)
class Finding:
    kind: str
    place: str
    text: str
    error: bool = True


@dataclass
class Source:
    path: str  # relative to the root, with slashes
    text: str
    code: str

    @property
    def parts(self):
        return self.path.removesuffix(".rs").split("/")

    @property
    def module(self):
        """The top module of a file of src: src/rays/bvh.rs -> rays, src/error.rs -> error."""
        return self.parts[1]

    @property
    def depth(self):
        """Modules below the crate's root."""
        return len(self.parts) - 1 - (self.parts[-1] == "mod")


def read_sources(root):
    files = [f for top in ("src", "tests", "benches", "examples", "tools") for f in sorted((root / top).rglob("*.rs"))]
    for file in files:
        text = file.read_text(encoding="utf-8")
        yield Source(file.relative_to(root).as_posix(), text, rust_text.code_only(text))


def read_floors(root):
    """{module: (floor, modules it must never import)} from the table of ARCHITECTURE.md."""
    floors = {}
    for line in (root / "ARCHITECTURE.md").read_text(encoding="utf-8").splitlines():
        row = re.match(r"\|\s*(\d+)\s*\|\s*`(\w+)`\s*\|.*\|([^|]*)\|\s*$", line)
        if row:
            floors[row[2]] = (int(row[1]), set(re.findall(r"`(\w+)`", row[3])))
    return floors


def check_floors(sources, floors, imports):
    """Checks every path to another module; fills imports: {module: {module}}."""
    ours = [s for s in sources if s.path.startswith("src/")]
    library = next((s for s in ours if s.path == "src/lib.rs"), None)
    exported = dict(re_exports(library.code)) if library else {}
    if not floors:
        yield Finding("table", "ARCHITECTURE.md", "holds no table of floors")
    present = {s.module for s in ours} - {"lib", "main"}
    for module in sorted(present - set(floors)):
        yield Finding("table", f"src/{module}", "has no floor in ARCHITECTURE.md")
    for module in sorted(set(floors) - present):
        yield Finding("table", "ARCHITECTURE.md", f"gives `{module}` a floor, but src has no such module")
    for source in ours:
        if source.path == "src/lib.rs":
            continue
        if source.path == "src/main.rs":
            paths = list(rust_text.crate_paths(source.code.replace("glowtree::", "crate   ::"), 0))
        else:
            paths = list(rust_text.crate_paths(source.code, source.depth))
        for line, name in paths:
            yield from check_import(source, line, exported.get(name, name), floors, imports)


def re_exports(code):
    for module, names in re.findall(r"\bpub\s+use\s+(?:crate::)?(\w+)::(\{[^}]*\}|\w+)", code):
        for name in re.findall(r"\w+", names):
            yield name, module


def check_import(source, line, target, floors, imports):
    place = f"{source.path}:{line}"
    if target not in floors:
        yield Finding("unknown", place, f"reaches `crate::{target}`, which is no module of the table")
        return
    if source.module == "main":
        if target != "cli":
            yield Finding("main", place, f"main.rs knows `cli` alone, not `{target}`")
        return
    if source.module == target or source.module not in floors:
        return
    imports.setdefault(source.module, set()).add(target)
    floor, never = floors[source.module]
    if floors[target][0] > floor:
        yield Finding("upward", place, f"`{source.module}` (floor {floor}) imports `{target}` from floor {floors[target][0]} above")
    elif floors[target][0] == floor:
        yield Finding("sideways", place, f"`{source.module}` imports `{target}` on its own floor {floor}")
    elif target in never:
        yield Finding("never", place, f"`{source.module}` must never import `{target}`")


def check_sizes(root, sources):
    for source in sources:
        lines = source.text.count("\n")
        production = rust_text.production_lines(source.code)
        if lines > FILE_LINES:
            yield Finding("file", source.path, f"{lines} lines, over {FILE_LINES}: split it by what it does")
        elif production > PRODUCTION_LINES and source.path.startswith("src/"):
            yield Finding("production", source.path, f"{production} production lines, over {PRODUCTION_LINES}", False)
        for function in rust_text.functions(source.code):
            yield from check_function(source.path, function)
    for file in sorted((root / "tools").rglob("*.py")):
        yield from check_python(root, file)
    for folder in sorted({root / "src"} | {d for d in (root / "src").rglob("*") if d.is_dir()}):
        count = len(list(folder.glob("*.rs")))
        if count > FOLDER_FILES:
            yield Finding("folder", folder.relative_to(root).as_posix(), f"{count} files, over {FOLDER_FILES}", False)
    page = (root / "ARCHITECTURE.md").read_text(encoding="utf-8").count("\n")
    if page > PAGE_LINES:
        yield Finding("page", "ARCHITECTURE.md", f"{page} lines, over {PAGE_LINES}")


def check_function(path, function):
    place = f"{path}:{function.line}"
    if function.lines > FUNCTION_LINES:
        yield Finding("function", place, f"`{function.name}` has {function.lines} lines, over {FUNCTION_LINES}")
    if function.parameters > PARAMETERS:
        yield Finding("parameters", place, f"`{function.name}` takes {function.parameters} parameters, over {PARAMETERS}", False)


def check_python(root, file):
    path, text = file.relative_to(root).as_posix(), file.read_text(encoding="utf-8")
    if text.count("\n") > FILE_LINES:
        yield Finding("file", path, f"{text.count(chr(10))} lines, over {FILE_LINES}")
    for item in ast.walk(ast.parse(text)):
        if isinstance(item, ast.FunctionDef):
            count = sum(a.arg != "self" for a in item.args.args + item.args.kwonlyargs)
            lines = item.end_lineno - item.lineno + 1
            yield from check_function(path, rust_text.Function(item.name, item.lineno, lines, count))


def check_words(root, sources):
    for source in sources:
        for part in source.parts:
            if part in FORBIDDEN_MODULES:
                yield Finding("module", source.path, f"`{part}` says nothing: name the module by what it does")
        for line, name in rust_text.declared(source.code):
            yield from check_name(source.path, line, name)
        for name in re.findall(r"\bmod\s+(\w+)\s*\{", source.code):
            if name in FORBIDDEN_MODULES:
                yield Finding("module", source.path, f"`mod {name}` says nothing: name it by what it does")
        for function in rust_text.functions(source.code):
            if function.name.startswith(FORBIDDEN_VERBS):
                verb = function.name.split("_")[0]
                yield Finding("verb", f"{source.path}:{function.line}", f"`{function.name}`: leave out `{verb}_` or say what is done")
    for file in sorted((root / "tools").rglob("*.py")):
        if file.stem in FORBIDDEN_MODULES:
            yield Finding("module", file.relative_to(root).as_posix(), f"`{file.stem}` says nothing")


def check_name(path, line, name):
    words = rust_text.words(name)
    for i, word in enumerate(words):
        singular = {"patches": "patch"}.get(word, word.removesuffix("s"))
        word = singular if singular in FORBIDDEN_WORDS else word
        if word not in FORBIDDEN_WORDS or any(path.startswith(p) and w == word for p, w in ALLOWED_WORDS):
            continue
        if word == "kd" and words[i + 1 : i + 2] == ["tree"]:
            continue
        yield Finding("word", f"{path}:{line}", f"`{name}`: the house says {FORBIDDEN_WORDS[word]}, not {word}")


def check_unsafe(sources):
    rays_file = None
    for source in sources:
        lines = source.text.splitlines()
        for match in re.finditer(r"\bunsafe\b", source.code):
            line = rust_text.line_of(source.code, match.start())
            place = f"{source.path}:{line}"
            if source.path.startswith(UNSAFE_FOLDER):
                rays_file = rays_file or source.path
            if source.path not in (UNSAFE_MAP, rays_file):
                yield Finding("unsafe", place, f"`unsafe` belongs into {UNSAFE_MAP} and one file of {UNSAFE_FOLDER} only")
            if not any("safety" in text.lower() for text in lines[max(line - 9, 0) : line]):
                yield Finding("reason", place, "`unsafe` without its reason: `// SAFETY: …` above it", False)


def inspect(root):
    """All findings of a tree, and who imports whom."""
    sources, floors, imports = list(read_sources(root)), read_floors(root), {}
    findings = list(check_floors(sources, floors, imports))
    findings += check_sizes(root, sources)
    findings += check_words(root, sources)
    findings += check_unsafe(sources)
    return list(dict.fromkeys(findings)), floors, imports, sources


def picture(floors, imports, sources):
    print("floor  module       files  lines  imports")
    for module in sorted(floors, key=lambda m: (-floors[m][0], m)):
        own = [s for s in sources if s.path.startswith("src/") and s.module == module]
        lines = sum(rust_text.production_lines(s.code) for s in own)
        below = sorted(imports.get(module, ()), key=lambda m: (-floors[m][0], m))
        print(f"{floors[module][0]:5}  {module:11}  {len(own):5}  {lines:5}  {' '.join(below)}")


def main():
    here = pathlib.Path(__file__).resolve().parent
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--root", type=pathlib.Path, default=here.parent)
    parser.add_argument("--self-test", action="store_true")
    arguments = parser.parse_args()
    if arguments.self_test:
        import house_sabotage

        sys.exit(house_sabotage.run(inspect))
    findings, floors, imports, sources = inspect(arguments.root)
    picture(floors, imports, sources)
    for finding in sorted(findings, key=lambda f: (f.error, f.place)):
        print(f"{'error' if finding.error else 'warning'}: {finding.place}: {finding.text}")
    errors = sum(f.error for f in findings)
    print(f"house: {errors} errors, {len(findings) - errors} warnings, {len(sources)} files")
    sys.exit(1 if errors else 0)


if __name__ == "__main__":
    main()
