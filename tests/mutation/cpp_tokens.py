"""The tokens of a C++ source, as far as drawing defects needs them: what is comment, preprocessor, text or template
argument, and which bracket closes which."""

import re
from dataclasses import dataclass

PATTERN = re.compile(
    r"""(?P<comment>//[^\n]*|/\*.*?\*/)
      |(?P<preprocessor>^[ \t]*\#(?:\\\n|[^\n])*)
      |(?P<string>(?:u8|[uUL])?R"(?P<mark>[^()\s]*)\(.*?\)(?P=mark)"|(?:u8|[uUL])?"(?:\\.|[^"\\\n])*")
      |(?P<char>'(?:\\.|[^'\\\n])+')
      |(?P<number>(?:0[xX][0-9a-fA-F']+|(?:\d[\d']*\.?[\d']*|\.\d[\d']*)(?:[eE][+-]?\d+)?)[uUlLfFzZ]*)
      |(?P<name>[A-Za-z_]\w*)
      |(?P<mark_of_language><<=|>>=|<=>|->\*|\.\.\.|::|->|\+\+|--|<<|>>|<=|>=|==|!=|&&|\|\||[-+*/%&|^]=|\S)""",
    re.VERBOSE | re.DOTALL | re.MULTILINE,
)
CLOSING = {"(": ")", "[": "]", "{": "}"}


@dataclass
class Token:
    kind: str  # string, char, number, name, or mark_of_language
    text: str
    start: int
    end: int
    spaced_before: bool
    spaced_after: bool
    partner: int = -1  # index of the other bracket
    in_template: bool = False  # within the angle brackets of a template's arguments

    @property
    def spaced(self):
        return self.spaced_before and self.spaced_after


class Source:
    """Tokens without comments and preprocessor lines; `lines_of_code` are the numbers (from 0) of lines with a token."""

    def __init__(self, text):
        self.text = text
        self.tokens = []
        for match in PATTERN.finditer(text):
            kind = match.lastgroup if match.lastgroup != "mark" else "string"
            if kind in ("comment", "preprocessor"):
                continue
            start, end = match.span()
            self.tokens.append(
                Token(kind, match.group(), start, end, text[start - 1 : start].isspace(), text[end : end + 1].isspace())
            )
        self.line_starts = [0] + [match.end() for match in re.finditer("\n", text)]
        self.lines_of_code = sorted({self.line(token.start) for token in self.tokens})
        self._match_brackets()
        self._mark_templates()

    def line(self, offset):
        """Number of the line, from 0, that holds this offset."""
        low, high = 0, len(self.line_starts)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self.line_starts[middle] <= offset else (low, middle)
        return low

    def _match_brackets(self):
        open_brackets = []
        for i, token in enumerate(self.tokens):
            if token.kind != "mark_of_language":
                continue
            if token.text in CLOSING:
                open_brackets.append(i)
            elif token.text in CLOSING.values() and open_brackets:
                token.partner = open_brackets.pop()
                self.tokens[token.partner].partner = i

    # clang-format writes no space before the angle bracket of arguments and one on both sides of a comparison.
    def _mark_templates(self):
        for i, token in enumerate(self.tokens):
            follows_name = i > 0 and self.tokens[i - 1].kind == "name"
            if token.text != "<" or not follows_name:
                continue
            if token.spaced_before and self.tokens[i - 1].text != "template":
                continue
            depth = 0
            for j in range(i, len(self.tokens)):
                text = self.tokens[j].text
                if text in (";", "{"):
                    break
                depth += {"<": 1, ">": -1, ">>": -2}.get(text, 0)
                self.tokens[j].in_template = True
                if depth <= 0:
                    break

    def between(self, first, last):
        """The text of tokens first..last."""
        return self.text[self.tokens[first].start : self.tokens[last].end]

    def arguments(self, opening):
        """(first, last) token of each part between this bracket and its partner, split at commas. None where it holds
        statements."""
        closing = self.tokens[opening].partner
        if closing < 0:
            return None
        parts, first, i = [], opening + 1, opening + 1
        while i < closing:
            token = self.tokens[i]
            if token.text == ";":
                return None
            if token.partner > i:
                i = token.partner
            elif token.text == "," and not token.in_template:
                parts.append((first, i - 1))
                first = i + 1
            i += 1
        if closing > first:
            parts.append((first, closing - 1))
        return parts
