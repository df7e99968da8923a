"""The self-test of house.py: a small sound tree, then one act of sabotage at a time; each must be noticed by its kind."""
import pathlib
import tempfile

TABLE = """# Architecture
| floor | module | holds | never |
|---|---|---|---|
| 4 | `cli` | verbs | |
| 3 | `links` | rows | |
| 3 | `reference` | judge | `sites` |
| 2 | `sites` | points | |
| 1 | `rays` | hits | |
| 1 | `archive` | files | |
| 0 | `error` | errors | |
"""

# A sound tree that holds everything a hasty checker would trip over.
SOUND = {
    "ARCHITECTURE.md": TABLE,
    "src/lib.rs": "//! The story.\npub mod cli;\npub use error::{Error, Result};\npub use links::Links;\n",
    "src/main.rs": "fn main() {\n    glowtree::cli::main()\n}\n",
    "src/cli/mod.rs": "use crate::{links::Links, sites, Error};\n",
    "src/links/mod.rs": (
        "//! Not [`crate::cli`], which only a comment names.\n"
        'const TEXT: &str = "use crate::cli; unsafe fn get_node";\n'
        'const RAW: &str = r#"crate::cli "quoted" unsafe"#;\n'
        "/* use crate::cli; /* nested */ unsafe */\n"
        "use crate::rays::{Hit, Ray};\n"
        "fn first<'a>(c: char, f: impl Fn(u32, u32) -> Vec<u32>, g: &'a str) -> bool { c == '\"' || c == '{' }\n"
        "fn person(json: u32, season: u32, kd_tree: u32) { other.nodes.get_mut(foreign::Node::new()); }\n"
        "#[cfg(test)]\nmod tests {\n    use super::*;\n    use crate::sites::Sites;\n}\n"
    ),
    "src/reference/mod.rs": "use crate::rays::Ray;\n",
    "src/sites/mod.rs": "use crate::Result;\nmod area;\n",
    "src/sites/area.rs": "use super::Sites;\nuse super::super::rays::Hit;\n",
    "src/rays/mod.rs": "fn trace() {}\n",
    "src/rays/simd.rs": "// SAFETY: detected before.\nunsafe fn kernel() {}\n",
    "src/archive/mod.rs": "mod map;\n",
    "src/archive/map.rs": "// SAFETY: finished files are never truncated.\nunsafe fn open() {}\n",
    "src/error.rs": "pub enum Error {}\n",
    "tests/links.rs": "const A: u32 = 1;\n" * 401,
    "tools/sound.py": "def add(a, b):\n    return a + b\n",
}

# (what is done, file, text added to it or None to remove it, kind that must be found)
SABOTAGE = [
    ("import from above", "src/rays/mod.rs", "use crate::sites::Sites;\n", "upward"),
    ("import from above in a group", "src/sites/mod.rs", "use crate::{error, links::Links};\n", "upward"),
    ("import from above in a nested group's second line", "src/sites/mod.rs", "use crate::{\n    rays::{Hit, Ray},\n    cli,\n};\n", "upward"),
    ("path from above in an expression", "src/rays/mod.rs", "fn f() -> bool { crate::cli::main(); true }\n", "upward"),
    ("climb past the root", "src/sites/area.rs", "use super::super::links::Links;\n", "upward"),
    ("import from above in a test", "src/rays/mod.rs", "#[cfg(test)]\nmod tests { use crate::links::Links; }\n", "upward"),
    ("climb out of a test", "src/rays/mod.rs", "#[cfg(test)]\nmod tests { use super::super::links::Links; }\n", "upward"),
    ("import behind a string", "src/rays/mod.rs", "const S: &str = \"a\\\"b\"; use crate::links::L;\n", "upward"),
    ("import behind a lifetime", "src/rays/mod.rs", "fn f<'a>(x: &'a u32) { crate::links::go(x, 'b') }\n", "upward"),
    ("import beside", "src/links/mod.rs", "use crate::reference::Tracer;\n", "sideways"),
    ("import what is never to be", "src/reference/mod.rs", "use crate::sites::Sites;\n", "never"),
    ("a re-export of the root from above", "src/rays/mod.rs", "use crate::Links;\n", "upward"),
    ("a module without floor", "src/extra/mod.rs", "fn f() {}\n", "table"),
    ("a floor without module", "src/rays", None, "table"),
    ("no table", "ARCHITECTURE.md", None, "table"),
    ("an unknown path", "src/cli/mod.rs", "use crate::nowhere::X;\n", "unknown"),
    ("a glob of the root", "src/cli/mod.rs", "use crate::*;\n", "unknown"),
    ("main knows more than cli", "src/main.rs", "use glowtree::links::Links;\n", "main"),
    ("a long file", "src/rays/mod.rs", "// line\n" * 600, "file"),
    ("much production code", "src/rays/mod.rs", "const A: u32 = 1;\n" * 401, "production"),
    ("a long function", "src/rays/mod.rs", "fn long() {\n" + "    step();\n" * 79 + "}\n", "function"),
    ("a long method among braces in strings", "src/rays/mod.rs", "impl X {\n fn long() {\n" + "    step('}', \"}\");\n" * 79 + "}\n}\n", "function"),
    ("many parameters", "src/rays/mod.rs", "fn many(a: A<B, C>, b: (D, E), c: F, d: fn(G) -> H, e: I, f: J) {}\n", "parameters"),
    ("a full folder", "src/rays/f{}.rs", "fn f() {}\n", "folder"),
    ("a long page", "ARCHITECTURE.md", "\n" * 150, "page"),
    ("a long tool", "tools/sound.py", "# line\n" * 600, "file"),
    ("a long tool function", "tools/sound.py", "def long():\n" + "    pass\n" * 80, "function"),
    ("a drawer", "src/rays/utils.rs", "fn f() {}\n", "module"),
    ("a drawer as a folder", "src/rays/common/mod.rs", "fn f() {}\n", "module"),
    ("a drawer within a file", "src/rays/mod.rs", "mod helpers { }\n", "module"),
    ("a drawer of tools", "tools/misc.py", "X = 1\n", "module"),
    ("node as a struct", "src/links/mod.rs", "struct TreeNode;\n", "word"),
    ("nodes as a field", "src/links/mod.rs", "struct Tree {\n    nodes: Vec<u32>,\n}\n", "word"),
    ("patches as a parameter", "src/links/mod.rs", "fn link(patches: &[u32]) {}\n", "word"),
    ("rho as a variable", "src/links/mod.rs", "fn f() { let rho = 1.0; }\n", "word"),
    ("Kd as a constant", "src/links/mod.rs", "const KD: f32 = 1.0;\n", "word"),
    ("element in a closure", "src/links/mod.rs", "fn f() { x.map(|element| 1); y.fold(0, |sum, element| 1); }\n", "word"),
    ("son as a variant", "src/links/mod.rs", "enum Kin {\n    Son,\n}\n", "word"),
    ("surfel as a loop variable", "src/links/mod.rs", "fn f() { for surfel in x {} }\n", "word"),
    ("father as a type", "src/links/mod.rs", "type Father = u32;\n", "word"),
] + [
    (f"{verb}_ as a verb", "src/links/mod.rs", f"fn {verb}_rows() {{}}\n", "verb")
    for verb in ("get", "compute", "do", "process", "handle")
] + [
    ("unsafe elsewhere", "src/links/mod.rs", "// SAFETY: none.\nunsafe fn f() {}\n", "unsafe"),
    ("unsafe in a test", "tests/links.rs", "// SAFETY: none.\nfn f() { unsafe { g() } }\n", "unsafe"),
    ("unsafe in a bench among the tools", "tools/peer/ours.rs", "// SAFETY: none.\nunsafe fn f() {}\n", "unsafe"),
    ("unsafe in a second file of rays", "src/rays/zebra.rs", "// SAFETY: none.\nunsafe fn f() {}\n", "unsafe"),
    ("unsafe without a reason", "src/archive/map.rs", "\n" * 9 + "unsafe fn g() {}\n", "reason"),
]


def build(root, change=None):
    for name, text in SOUND.items():
        write(root / name, text)
    if change is None:
        return
    name, text = change
    if text is None:
        remove(root / name)
    elif "{}" in name:
        for i in range(8):
            write(root / name.format(i), text)
    else:
        file = root / name
        write(file, (file.read_text() if file.exists() else "") + text)


def write(file, text):
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")


def remove(path):
    if path.is_dir():
        for file in path.iterdir():
            file.unlink()
        path.rmdir()
    else:
        path.write_text("# Architecture\n", encoding="utf-8")


def kinds(inspect, change=None):
    with tempfile.TemporaryDirectory() as folder:
        build(pathlib.Path(folder), change)
        findings = inspect(pathlib.Path(folder))[0]
    return {f.kind for f in findings}, findings


def run(inspect):
    """Exit code: 0 when the sound tree is clean and every sabotage is noticed."""
    _, findings = kinds(inspect)
    failed = [f"sound tree: {f.place}: {f.text}" for f in findings]
    for what, name, text, kind in SABOTAGE:
        found, _ = kinds(inspect, (name, text))
        if kind not in found:
            failed.append(f"{what}: wanted {kind}, found {sorted(found) or 'nothing'}")
    for line in failed:
        print(f"error: self-test: {line}")
    print(f"house self-test: {len(SABOTAGE)} acts of sabotage, {len(failed)} failures")
    return 1 if failed else 0
