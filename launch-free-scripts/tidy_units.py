"""Puts sources together that clang-tidy can look at in one go, so that it reads their headers once and not once for
every source: units that include sources of the same compile command, none of which sees a name that another one keeps
to itself. Where such a name is overlooked the unit does not compile, and clang-tidy says so.

tidy_units.py FOLDER SOURCE...: the folder of compile_commands.json, of which FOLDER/tidy is made anew; prints the units.
"""

import functools
import json
import re
import shlex
import shutil
import sys
from pathlib import Path

MOST = 24  # sources of a unit: more would take too much memory
OPAQUE = re.compile(r'//[^\n]*|/\*.*?\*/|R"(\w*)\(.*?\)\1"|(?<!include )"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])+\'', re.S)
HIDDEN = re.compile(r"^namespace \{$(.*?)^\}  // namespace$", re.M | re.S)
# Sources are formatted: what stands in a namespace begins in the first column.
DECLARED = re.compile(
    r"^(?:template <[^\n]*> *)?(?:struct|class|enum class|enum|union) (\w+)"
    r"|^(?!return|using|namespace|#|[A-Z_]+\()\w[^\n;={}()]*?\b(\w+) *[({;=\[]",
    re.M,
)


def declared(text):
    return {name for names in DECLARED.findall(text) for name in names if name}


def plain(text):
    """Without comments and strings."""
    return OPAQUE.sub('""', text)


@functools.cache
def plain_text(path):
    return plain(path.read_text())


def names_in(text):
    """Names that this text declares, and for its aliases what they stand for."""
    return {**dict.fromkeys(declared(text)), **dict(re.findall(r"^using (\w+) = ([^;]*);", text, re.M))}


@functools.cache
def names_of_headers(path, folders):
    """The same of the project's headers that this file includes."""
    names = {}
    for header in re.findall(r'^#include "([^"]+)"', plain_text(path), re.M):
        found = next((folder / header for folder in (path.parent, *folders) if (folder / header).is_file()), None)
        if found:
            names |= names_in(plain_text(found)) | names_of_headers(found, folders)
    return names


class Source:
    def __init__(self, entry):
        self.path = Path(entry["file"])
        words = shlex.split(entry["command"])
        output = words.index("-o")
        self.command = tuple(w for w in words[:output] + words[output + 2 :] if w != entry["file"])
        folders = tuple(Path(word[2:]) for word in words if word.startswith("-I"))
        self.macros = "\n#define " in plain_text(self.path)
        self.own = names_in("\n".join(plain(part) for part in HIDDEN.findall(self.path.read_text())))
        self.seen = names_of_headers(self.path, folders) | self.own

    def disturbs(self, other):
        """An alias of the same type is the same alias."""
        return any(name in other.seen and (what is None or what != other.seen[name]) for name, what in self.own.items())

    def goes_with(self, other):
        return not (self.macros or other.macros or self.disturbs(other) or other.disturbs(self))


def together(sources):
    units = []
    for source in sources:
        fitting = (
            unit for unit in units
            if len(unit) < MOST and unit[0].command == source.command and all(source.goes_with(one) for one in unit)
        )  # fmt: skip
        unit = next(fitting, None)
        if unit is None:
            units.append(unit := [])
        unit.append(source)
    return sorted(units, key=len, reverse=True)


def main():
    folder = Path(sys.argv[1]).resolve()
    wanted = {str(Path(source).resolve()) for source in sys.argv[2:]}
    # Once, however many targets compile it.
    entries = {entry["file"]: entry for entry in json.loads((folder / "compile_commands.json").read_text())}
    if missing := wanted - entries.keys():
        sys.exit(f"no compile command for {', '.join(sorted(missing))}")
    made = folder / "tidy"
    shutil.rmtree(made, ignore_errors=True)
    made.mkdir()
    commands = []
    for number, unit in enumerate(together([Source(entries[file]) for file in sorted(wanted)])):
        path = made / f"unit_{number}.cpp"
        path.write_text("".join(f'#include "{source.path}"\n' for source in unit))
        command = [*unit[0].command, str(path)]
        commands.append({"directory": str(folder), "file": str(path), "arguments": command})
        print(path)
    (made / "compile_commands.json").write_text(json.dumps(commands, indent=1))


main()
