"""Defects that a tired engineer would make, one place in a source each."""

import re
from dataclasses import dataclass

AXES = [
    ("x", "y", "z"),
    ("UnitX", "UnitY", "UnitZ"),
    ("RotX", "RotY", "RotZ"),
    ("'x'", "'y'", "'z'"),
    ("roll", "pitch", "yaw"),
]
UNITS = {"1e3", "1e-3", "1000.0", "0.001", "1e6", "1e-6", "180.0", "kDegree"}
CONTROL = {"if", "for", "while", "switch", "catch", "return", "sizeof", "decltype", "alignof", "noexcept", "operator"}
NOT_AN_EXPRESSION = CONTROL | {
    "else", "do", "case", "default", "using", "namespace", "struct", "class", "enum", "template", "typedef", "friend",
    "public", "private", "protected", "const", "constexpr", "static", "inline", "auto", "extern", "explicit",
    "virtual", "static_assert", "thread_local", "goto", "try", "unsigned", "union", "alignas",
}  # fmt: skip
INDEXED = re.compile(r"^(row|col|rows|cols|segment|head|tail|block|coeff|coeffRef|middleCols|middleRows|at|[A-Za-z])$")
OPTIONS = re.compile(r"^(options|arguments|\w*_options|\w*_arguments|options_|arguments_)$")
ROTATION = re.compile(r"^R(_[A-Z]+|[A-Z]{2})?$")
BEFORE_A_TERM = {"(", "[", "{", ",", "=", "return", "?", ":", ";", "+=", "-=", "*=", "/=", "case", "<<"}


@dataclass(frozen=True)
class Mutation:
    kind: str
    start: int
    end: int
    text: str


def mutations(source):
    """All of them, in the order of operators and places."""
    asserted = [
        (token.start, source.tokens[source.tokens[i + 1].partner].end)
        for i, token in enumerate(source.tokens)
        if token.text == "static_assert"
    ]
    result = []
    for operator in OPERATORS:
        for mutation in operator(source):
            changes = source.text[mutation.start : mutation.end] != mutation.text
            if changes and not any(start <= mutation.start < end for start, end in asserted):
                result.append(mutation)
    return result


def _replace(kind, token, text):
    return Mutation(kind, token.start, token.end, text)


# Without the statement but with its line ends: what follows keeps its place.
def _removed(source, kind, first, last):
    start, end = source.tokens[first].start, source.tokens[last].end
    return Mutation(kind, start, end, "\n" * source.text.count("\n", start, end))


def _neighbours(source):
    tokens = source.tokens
    for i in range(1, len(tokens) - 1):
        if not tokens[i].in_template:
            yield i, tokens[i - 1], tokens[i], tokens[i + 1]


def sign(source):
    flipped = {"+": "-", "-": "+", "+=": "-=", "-=": "+="}
    for _, before, token, after in _neighbours(source):
        if token.text not in flipped or "string" in (before.kind, after.kind):
            continue
        if token.spaced:
            yield _replace("sign", token, flipped[token.text])
        elif token.text == "-" and before.text in BEFORE_A_TERM | {"*", "+", "-", "/", "<", ">", "<=", ">=", "=="}:
            yield _replace("sign", token, "")


def comparison(source):
    others = {
        "<": ["<=", ">="], ">": [">=", "<="], "<=": ["<", ">"], ">=": [">", "<"],
        "==": ["!="], "!=": ["=="], "&&": ["||"], "||": ["&&"],
    }  # fmt: skip
    names = {"min": "max", "max": "min", "minCoeff": "maxCoeff", "maxCoeff": "minCoeff", "any_of": "all_of",
             "all_of": "any_of", "none_of": "any_of", "floor": "ceil", "ceil": "floor"}  # fmt: skip
    for _, before, token, after in _neighbours(source):
        if token.text in others and token.spaced:
            for other in others[token.text]:
                yield _replace("comparison", token, other)
        elif token.text == "!" and not token.spaced_after:
            yield _replace("comparison", token, "")
        elif token.text in names and (after.text == "(" or after.in_template) and before.text in ("::", "."):
            yield _replace("comparison", token, names[token.text])


def _is_index(source, i):
    tokens = source.tokens
    if tokens[i - 1].text == "[" and tokens[i + 1].text == "]":
        return i >= 2 and (tokens[i - 2].kind == "name" or tokens[i - 2].text in ("]", ")"))
    opening = i - 1
    while opening > 0 and tokens[opening].text in (",",) or tokens[opening].kind in ("name", "number"):
        opening -= 1
    alone = tokens[i - 1].text in ("(", ",") and tokens[i + 1].text in (")", ",")
    called = tokens[opening].text == "(" and opening > 0
    return alone and called and bool(INDEXED.match(tokens[opening - 1].text) or tokens[opening - 1].text == ">")


def constant(source):
    for i, before, token, after in _neighbours(source):
        if token.text in ("true", "false"):
            yield _replace("constant", token, "false" if token.text == "true" else "true")
        if token.kind != "number" or _is_index(source, i) or token.text.startswith("0x"):
            continue
        plain = token.text.replace("'", "")
        if re.fullmatch(r"\d+[uUlLzZ]*", plain):
            value = int(re.match(r"\d+", plain).group())
            for other in {0, 1, value + 1, value * 10} | ({value // 10} if value >= 10 else set()):
                if other != value:
                    yield _replace("constant", token, str(other))
        elif re.fullmatch(r"[\d.]+([eE][+-]?\d+)?", plain):
            value = float(plain)
            for other in ("0.0", "1.0", f"({plain} * 10.0)", f"({plain} * 0.1)"):
                if not (value == 0.0 and "*" in other) and not (value in (0.0, 1.0) and float_of(other) == value):
                    yield _replace("constant", token, other)


def float_of(text):
    return float(text) if "*" not in text else None


def index(source):
    for i, before, token, after in _neighbours(source):
        if token.kind == "number" and token.text.isdigit() and _is_index(source, i):
            value = int(token.text)
            for other in (value - 1, value + 1):
                if other >= 0:
                    yield _replace("index", token, str(other))
        elif token.kind == "name" and before.text == "[" and after.text == "]" and _is_index(source, i):
            yield _replace("index", token, token.text + " + 1")
            yield _replace("index", token, token.text + " - 1")


# Names of parameters stand behind their types.
def _declares(source, parts):
    for first, last in parts:
        tokens = source.tokens[first : last + 1]
        if tokens[0].text in ("const", "auto", "unsigned", "int", "double", "long", "bool") and len(tokens) > 1:
            return True
        for a, b in zip(tokens, tokens[1:]):
            if (a.kind == "name" or a.text in ("&", "*", ">")) and b.kind == "name" and a.text not in CONTROL:
                if not (a.text in ("&", "*", ">") and (a.spaced or not a.spaced_after)):
                    return True
    return False


# {"key", value}
def _is_keyed(source, first, last):
    tokens = source.tokens
    return tokens[first].text == "{" and tokens[first + 1].kind == "string" and tokens[first + 2].text == "," and (
        tokens[first].partner == last
    )


def swapped_arguments(source):
    tokens = source.tokens
    for i, before, token, _ in _neighbours(source):
        if token.text not in ("(", "{") or token.partner < 0:
            continue
        if token.text == "(" and (before.kind != "name" and before.text != ">" or before.text in CONTROL):
            continue
        if token.text == "{" and before.text in (")", "else", "do", "try", "const"):
            continue
        parts = source.arguments(i)
        if not parts or len(parts) < 2 or _declares(source, parts):
            continue
        for (a, b), (c, d) in zip(parts, parts[1:]):
            while tokens[a].text == "." and tokens[c].text == "." and tokens[a + 2].text == tokens[c + 2].text == "=":
                a, c = a + 3, c + 3  # designated initialisers: the values change places
            if _is_keyed(source, a, b) and _is_keyed(source, c, d):
                a, b, c, d = a + 3, b - 1, c + 3, d - 1
            first, second = source.between(a, b), source.between(c, d)
            if first == second or (tokens[a].kind == "string") != (tokens[c].kind == "string"):
                continue
            if (tokens[a].text == "[") != (tokens[c].text == "["):  # a lambda and something else
                continue
            between = source.text[tokens[b].end : tokens[c].start]
            yield Mutation("swapped arguments", tokens[a].start, tokens[d].end, second + between + first)


def _is_declaration(tokens):
    i = 0
    while i < len(tokens) and (tokens[i].kind == "name" or tokens[i].text == "::" or tokens[i].in_template):
        if i > 0 and tokens[i].kind == "name" and not tokens[i].in_template:
            if tokens[i - 1].kind == "name" or tokens[i - 1].in_template:
                return True
        i += 1
    reference = i < len(tokens) and tokens[i].text in ("&", "*", "&&") and not tokens[i].spaced_before
    return reference and i > 0


def _statements(source):
    """(first, last) token of each, the semicolon not included."""
    tokens = source.tokens
    first = 0
    i = 0
    while i < len(tokens):
        text = tokens[i].text
        if text in ("(", "[") and tokens[i].partner > i:
            opened_by_control = text == "(" and i > 0 and tokens[i - 1].text in ("if", "for", "while", "switch", "constexpr")
            inner = tokens[i].partner
            if opened_by_control:
                first = inner + 1
            else:
                yield from _statements_inside(source, i + 1, inner)
            i = inner
        elif text == "{" and _is_initialiser(tokens, i):
            i = max(i, tokens[i].partner)
        elif text in ("{", "}", "else", "do"):
            first = i + 1
        elif text == ":" and i > 0 and first < i and tokens[first].text in ("case", "default", "public", "private"):
            first = i + 1
        elif text == ";":
            if i > first:
                yield first, i - 1
            first = i + 1
        i += 1


# Statements of lambdas among the arguments of a call.
def _statements_inside(source, first, last):
    tokens = source.tokens
    begin = None
    i = first
    while i < last:
        if tokens[i].text in ("{", "}"):
            begin = i + 1
        elif tokens[i].text == "(" and tokens[i].partner > i:
            if tokens[i - 1].text in ("if", "for", "while", "switch"):
                begin = tokens[i].partner + 1
            i = tokens[i].partner
        elif tokens[i].text == ";" and begin is not None:
            if i > begin:
                yield begin, i - 1
            begin = i + 1
        i += 1


# Braces that hold values, not statements.
def _is_initialiser(tokens, i):
    before = tokens[i - 1]
    if i == 0 or before.text in ("else", "do", "try", "const", "override", "mutable", "noexcept", "namespace"):
        return False
    if before.text in ("=", ",", "(", "return", ">", "{", "]"):
        return before.text != "]" or tokens[before.partner - 1].kind == "name"
    while i > 0 and (tokens[i - 1].kind == "name" or tokens[i - 1].text == "::"):
        i -= 1
        if tokens[i].text in ("namespace", "struct", "class", "enum", "public"):
            return False
    return before.kind == "name"


def dropped_statement(source):
    for first, last in _statements(source):
        tokens = source.tokens[first : last + 1]
        start = tokens[0].text
        if start in ("break", "continue", "throw") or (start == "return" and last == first):
            yield _removed(source, "dropped statement", first, last)
            continue
        if start in NOT_AN_EXPRESSION or tokens[0].kind not in ("name",) and start not in ("++", "--", "*", "("):
            continue
        does_something = any(t.text in ("=", "(", "++", "--", "+=", "-=", "*=", "/=", "|=", "&=", "<<") for t in tokens)
        if does_something and not _is_declaration(tokens):
            yield _removed(source, "dropped statement", first, last)
    yield from _dropped_checks(source)


# .add_option(...)->check(...)
def _dropped_checks(source):
    tokens = source.tokens
    for i, before, token, after in _neighbours(source):
        if token.text in ("check", "delimiter", "required", "expected", "excludes", "needs") and before.text == "->":
            if after.text == "(" and after.partner > 0:
                yield _removed(source, "ignored option", i - 1, after.partner)


# The first token of the operand that ends before `i`.
def _operand_start(source, i, boundaries):
    tokens = source.tokens
    j = i - 1
    while j >= 0:
        token = tokens[j]
        if token.text in (")", "]", "}") and 0 <= token.partner < j:
            j = token.partner - 1
            continue
        if token.text in boundaries and not token.in_template:
            break
        j -= 1
    return j + 1


def _operand_end(source, i, boundaries):
    tokens = source.tokens
    j = i + 1
    while j < len(tokens):
        token = tokens[j]
        if token.text in ("(", "[", "{") and token.partner > j:
            j = token.partner + 1
            continue
        if token.text in boundaries and not token.in_template:
            break
        j += 1
    return j - 1


def dropped_condition(source):
    tokens = source.tokens
    start_of = {"(", "[", "{", "}", ",", "=", "return", "?", ":", ";", "<<", "+="}
    end_of = {")", "]", "}", ",", "?", ":", ";"}
    for i, before, token, after in _neighbours(source):
        if token.text in ("if", "while") and after.text == "(" and after.partner > 0:
            first, last = i + 2, after.partner - 1
            for j in range(first, last):
                if tokens[j].text == ";":
                    first = j + 1
            if last < first or _is_declaration(tokens[first : last + 1]) or tokens[first].text in ("const", "auto"):
                continue
            for value in ("true", "false") if token.text == "if" else ("false",):
                yield Mutation("dropped condition", tokens[first].start, tokens[last].end, value)
        elif token.text in ("&&", "||") and token.spaced:
            first = _operand_start(source, i, start_of | {"&&", "||"})
            last = _operand_end(source, i, end_of | {"&&", "||"})
            if first < i < last:
                yield Mutation("dropped condition", tokens[first].start, tokens[i + 1].start, "")
                yield Mutation("dropped condition", tokens[i - 1].end, tokens[last].end, "")
        elif token.text == "?" and token.spaced:
            first = _operand_start(source, i, start_of)
            if first < i:
                for value in ("true", "false"):
                    yield Mutation("dropped condition", tokens[first].start, tokens[i - 1].end, value)


def swapped_axis(source):
    for _, before, token, after in _neighbours(source):
        for axes in AXES:
            if token.text not in axes or (token.kind == "name" and before.text not in (".", "->", "::")):
                continue
            if before.text == "." and not before.spaced_before and after.text == "=" and before.spaced_before:
                continue
            for other in axes:
                if other != token.text:
                    yield _replace("swapped axis", token, other)


def swapped_unit(source):
    for _, before, token, after in _neighbours(source):
        if token.text in UNITS and before.text != "double":
            yield _replace("swapped unit", token, "1.0")


def ignored_option(source):
    tokens = source.tokens
    for i, before, token, after in _neighbours(source):
        if token.kind != "name" or not OPTIONS.match(token.text) or after.text not in (".", "->"):
            continue
        last = i + 2
        while last + 2 < len(tokens) and tokens[last + 1].text in (".", "->") and tokens[last + 2].kind == "name":
            if tokens[last + 3].text == "(":
                break
            last += 2
        if before.text in (".", "->", "::") or tokens[last + 1].text in ("=", "+=", "("):
            continue
        whole = source.between(i, last)
        bound = before.text == "," and i >= 2 and tokens[i - 2].text.startswith('"--')
        if bound:
            unused = f"[]() -> auto& {{ static std::remove_cvref_t<decltype({whole})> unused; return unused; }}()"
            yield Mutation("ignored option", token.start, tokens[last].end, unused)
        else:
            value = token.text if after.text == "." else "*" + token.text
            default = f"std::remove_cvref_t<decltype({value})>{{}}"
            yield Mutation("ignored option", token.start, tokens[i + 1].end, default + ".")


def transposed_matrix(source):
    tokens = source.tokens
    for i, before, token, after in _neighbours(source):
        called = after.text == "(" and after.partner > 0
        if token.text in ("transpose", "inverse", "Inverse", "adjoint") and before.text == "." and called:
            if after.partner == i + 2:
                yield _removed(source, "transposed matrix", i - 1, after.partner)
        elif token.text in ("linear", "rotation", "toRotationMatrix") and before.text == "." and called:
            if tokens[after.partner + 1].text not in ("=", "."):
                yield Mutation("transposed matrix", tokens[after.partner].end, tokens[after.partner].end, ".transpose()")
        elif token.kind == "name" and ROTATION.match(token.text) and after.text not in ("=", ".", "(", "{"):
            if before.kind != "name" and before.text not in ("&", ">"):
                yield Mutation("transposed matrix", token.end, token.end, ".transpose()")
        elif token.text == "M" and before.text == "." and after.text not in ("=", ".", "("):
            yield Mutation("transposed matrix", token.end, token.end, ".Inverse()")


OPERATORS = [
    sign, comparison, constant, index, swapped_arguments, dropped_statement, dropped_condition, swapped_axis,
    swapped_unit, ignored_option, transposed_matrix,
]  # fmt: skip
