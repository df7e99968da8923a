#!/usr/bin/env python3
"""Checks that every crate this one links comes from the registry under a licence that deny.toml allows.

Reads `cargo metadata`; exit 1 and the crates' names otherwise. Python standard library only.
"""
import json
import pathlib
import re
import subprocess
import sys
import tomllib

ROOT = pathlib.Path(__file__).resolve().parent.parent
REGISTRY = "registry+"


def allowed_by(expression, allow):
    """Whether an SPDX expression can be met with the licences in `allow`; `/` is the old way to write OR."""
    tokens = re.findall(r"[()]|[^\s()/]+(?:\s+WITH\s+[^\s()/]+)?|/", expression)
    result, rest = any_of(tokens, allow)
    return result and not rest


def any_of(tokens, allow):
    result, tokens = all_of(tokens, allow)
    while tokens and tokens[0] in ("OR", "/"):
        other, tokens = all_of(tokens[1:], allow)
        result = result or other
    return result, tokens


def all_of(tokens, allow):
    result, tokens = single(tokens, allow)
    while tokens and tokens[0] == "AND":
        other, tokens = single(tokens[1:], allow)
        result = result and other
    return result, tokens


def single(tokens, allow):
    if not tokens:
        return False, []
    if tokens[0] == "(":
        result, rest = any_of(tokens[1:], allow)
        return result, rest[1:]
    return " ".join(tokens[0].split()) in allow, tokens[1:]


def self_check():
    """The reader of expressions must refuse what it ought to."""
    allow = {"MIT", "Apache-2.0", "Apache-2.0 WITH LLVM-exception", "Unicode-3.0"}
    good = ["MIT", "GPL-3.0 OR MIT", "MIT/Apache-2.0", "(MIT OR GPL-3.0) AND Unicode-3.0", "Apache-2.0 WITH LLVM-exception"]
    bad = ["GPL-3.0", "MIT AND GPL-3.0", "(MIT OR GPL-3.0) AND GPL-3.0", "", "Apache-2.0 WITH Classpath-exception-2.0"]
    wrong = [e for e in good if not allowed_by(e, allow)] + [e for e in bad if allowed_by(e, allow)]
    assert not wrong, f"licence expressions judged wrongly: {wrong}"


def linked(metadata):
    """Ids of the packages that reach the program: not through dev-dependencies."""
    graph = {p["id"]: p["deps"] for p in metadata["resolve"]["nodes"]}
    seen, ahead = set(), [metadata["resolve"]["root"]]
    while ahead:
        package = ahead.pop()
        if package not in seen:
            seen.add(package)
            ahead += [d["pkg"] for d in graph[package] if any(k["kind"] != "dev" for k in d["dep_kinds"])]
    return seen - {metadata["resolve"]["root"]}


def main():
    self_check()
    allow = set(tomllib.loads((ROOT / "deny.toml").read_text())["licenses"]["allow"])
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--all-features"]
    metadata = json.loads(subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE).stdout)
    wanted = linked(metadata)
    refused = 0
    for package in metadata["packages"]:
        if package["id"] not in wanted:
            continue
        licence = package["license"] or ""
        if not allowed_by(licence, allow):
            refused += 1
            print(f"error: {package['name']} {package['version']}: licence {licence or 'unnamed'} is not in deny.toml")
        if not (package["source"] or "").startswith(REGISTRY):
            refused += 1
            print(f"error: {package['name']} {package['version']}: comes from {package['source'] or 'a path'}")
    print(f"licences: {len(wanted)} crates, {refused} refused")
    sys.exit(1 if refused else 0)


if __name__ == "__main__":
    main()
