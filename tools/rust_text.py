"""Reads just enough Rust for house.py: code without comments and strings, functions, modules, paths, identifiers.

Not a parser. It relies on what rustfmt guarantees and errs on the side of seeing too much.
"""
import re
from dataclasses import dataclass

TOKEN = re.compile(
    r"//[^\n]*"  # line comment
    r"|/\*"  # block comment, nested: ended by hand
    r"|b?r(?P<hashes>#*)\"(?:.|\n)*?\"(?P=hashes)"  # raw string
    r"|b?c?\"(?:\\(?:.|\n)|[^\"\\])*\""  # string
    r"|b?'(?:\\(?:u\{[^}]*\}|x[0-9a-fA-F]{2}|.)|[^'\\])'"  # character, not a lifetime
)
BLOCK_EDGE = re.compile(r"/\*|\*/")


def blank(text):
    """The same text in spaces, so that offsets and line numbers stay."""
    return re.sub(r"[^\n]", " ", text)


def code_only(text):
    """`text` with comments, strings and characters blanked out."""
    out, at = [], 0
    while match := TOKEN.search(text, at):
        start, end = match.span()
        before = text[start - 1] if start else ""
        if match.group().startswith(("b", "c", "r")) and (before.isalnum() or before == "_"):
            out.append(text[at : start + 1])  # the tail of an identifier, not a prefix of a string
            at = start + 1
            continue
        if match.group() == "/*":
            end = block_comment_end(text, end)
        out += [text[at:start], blank(text[start:end])]
        at = end
    return "".join(out) + text[at:]


def block_comment_end(text, at):
    depth = 1
    while depth and (edge := BLOCK_EDGE.search(text, at)):
        depth += 1 if edge.group() == "/*" else -1
        at = edge.end()
    return len(text) if depth else at


def closing(code, at, pairs=("{", "}")):
    """Offset just behind the bracket that closes the one at `at`."""
    depth = 0
    for i in range(at, len(code)):
        if code[i] == pairs[0]:
            depth += 1
        elif code[i] == pairs[1] and not (pairs[1] == ">" and code[i - 1] in "-="):
            depth -= 1
            if depth == 0:
                return i + 1
    return len(code)


def line_of(code, offset):
    return code.count("\n", 0, offset) + 1


@dataclass
class Function:
    name: str
    line: int
    lines: int
    parameters: int  # without self


def functions(code):
    """All functions with a body or a signature, in order."""
    for match in re.finditer(r"\bfn\s+(\w+)\s*", code):
        at = match.end()
        if code[at : at + 1] == "<":
            at = closing(code, at, ("<", ">"))
        at = code.find("(", at)
        if at < 0:
            return
        end = closing(code, at, ("(", ")"))
        parameters = split_top(code[at + 1 : end - 1])
        parameters = [p for p in parameters if not re.fullmatch(r"&?\s*('\w+\s+)?(mut\s+)?self(\s*:.*)?", p, re.S)]
        body = re.compile(r"[{;]").search(code, end)
        stop = closing(code, body.start()) if body and body.group() == "{" else end
        first, last = line_of(code, match.start()), line_of(code, stop - 1)
        yield Function(match.group(1), first, last - first + 1, len(parameters))


def split_top(text):
    """Splits at the commas that no bracket holds."""
    parts, depth, start = [], 0, 0
    for i, c in enumerate(text):
        if c in "([{<":
            depth += 1
        elif c in ")]}" or (c == ">" and text[i - 1 : i] not in ("-", "=")):
            depth -= 1
        elif c == "," and depth == 0:
            parts.append(text[start:i])
            start = i + 1
    return [p.strip() for p in parts + [text[start:]] if p.strip()]


def test_ranges(code):
    """(start, end) offsets of the modules that are compiled for tests alone."""
    for match in re.finditer(r"#\[cfg\((?:all\()?test\b[^\]]*\]\s*(?:pub(?:\([^)]*\))?\s+)?mod\s+\w+\s*\{", code):
        yield match.start(), closing(code, match.end() - 1)


def production_lines(code):
    """Lines that hold code outside test modules; comments and blank lines do not count."""
    for start, end in test_ranges(code):
        code = code[:start] + blank(code[start:end]) + code[end:]
    return sum(1 for line in code.splitlines() if line.strip())


def crate_paths(code, module_depth):
    """(line, first name below the crate's root) of every path that starts at `crate::` or climbs there with `super::`.

    `module_depth` is the number of modules the file lies below the root: 1 for src/rays/mod.rs, 2 for src/rays/bvh.rs.
    """
    for match in re.finditer(r"\bcrate\s*::\s*", code):
        yield from heads(code, match.end())
    tests = list(test_ranges(code))
    for match in re.finditer(r"(?<![\w:])(?:self::)?((?:super\s*::\s*)+)", code):
        depth = module_depth + any(a <= match.start() < b for a, b in tests)
        if match.group(1).count("super") >= depth:
            yield from heads(code, match.end())


def heads(code, at):
    """The first name, or each first name of a brace group, at an offset."""
    line = line_of(code, at)
    if code[at : at + 1] == "{":
        for part in split_top(code[at + 1 : closing(code, at) - 1]):
            yield line, re.match(r"\w+|\*", part).group()
    elif match := re.compile(r"\w+|\*").match(code, at):
        yield line, match.group()


DECLARED = re.compile(
    r"\b(?:fn|struct|enum|union|trait|type|const|static|mod|let|for|macro_rules!)\s+(?:ref\s+)?(?:mut\s+)?(\w+)"
    r"|\b(?:mut\s+|ref\s+)?(?<![:\w.'])([a-z_]\w*)\s*:(?!:)"  # fields and parameters
    r"|^\s*([A-Z]\w*)\s*(?=[,({=])"  # variants
    r"|[|(,]\s*&?(?:mut\s+)?([a-z_]\w*)\s*(?=[,|])",  # closure parameters and tuple patterns
    re.M,
)


def declared(code):
    """(line, name) of the names this file gives; names it merely uses belong to others."""
    code = re.sub(r"\buse\s[^;]*;", lambda m: blank(m.group()), code)
    for match in DECLARED.finditer(code):
        index = next(i for i in range(1, 5) if match.group(i))
        yield line_of(code, match.start(index)), match.group(index)


def words(identifier):
    """The words of a snake_case or CamelCase identifier, lower case."""
    return [w.lower() for w in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[A-Z]", identifier)]
