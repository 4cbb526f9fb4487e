"""Which defects to plant: drawn from the sources with a seed, or read from a list."""

import hashlib
import random
from dataclasses import asdict, dataclass, field

from cpp_tokens import Source
from operators import mutations


@dataclass
class Defect:
    path: str  # of the source, from the top of the tree
    line: int  # from 1
    old: str  # whole lines of a drawn defect; any text that occurs once of a listed one
    new: str
    kind: str
    suites: list = field(default_factory=list)  # those that should notice, tried first
    id: str = ""

    def __post_init__(self):
        text = "\0".join((self.path.rsplit("/", 1)[-1], self.old.strip(), self.new.strip()))
        self.id = self.id or hashlib.sha1(text.encode()).hexdigest()[:8]

    def as_dict(self):
        return asdict(self)

    def applied_to(self, text):
        """The source with the defect in it. The lines may have moved since it was drawn: the nearest place counts."""
        places = []
        start = text.find(self.old)
        while start >= 0:
            places.append(start)
            start = text.find(self.old, start + 1)
        if not places or (self.line == 0 and len(places) > 1):
            return None
        place = min(places, key=lambda at: abs(text.count("\n", 0, at) + 1 - self.line))
        return text[:place] + self.new + text[place + len(self.old) :]

    def diff(self):
        old = [f"    - {line}" for line in self.old.rstrip("\n").split("\n")]
        new = [f"    + {line}" for line in self.new.rstrip("\n").split("\n")]
        while len(old) > 1 and len(new) > 1 and old[-1][6:] == new[-1][6:]:
            del old[-1], new[-1]
        while len(old) > 1 and len(new) > 1 and old[0][6:] == new[0][6:]:
            del old[0], new[0]
        return "\n".join(old + new)


class Drawing:
    """Cuts the lines of code of all sources into `count` equal shares and draws from each of them: in proportion to
    lines, and with every large file in it. Where a defect does not count (it does not compile, or compiles to the same)
    the next one comes from the same share."""

    def __init__(self, root, seed, count):
        self._sources = {}
        lines = []
        for path in sorted(list((root / "src").rglob("*.cpp")) + list((root / "src").rglob("*.hpp"))):
            name = path.relative_to(root).as_posix()
            source = Source(path.read_text())
            by_line = {}
            for mutation in mutations(source):
                by_line.setdefault(source.line(mutation.start), []).append(mutation)
            self._sources[name] = (source, by_line)
            lines += [(name, line) for line in source.lines_of_code]
        bounds = [round(i * len(lines) / count) for i in range(count + 1)]
        self._shares = [lines[a:b] for a, b in zip(bounds, bounds[1:])]
        self._randoms = [random.Random(f"{seed}/{share}") for share in range(count)]
        self._drawn = set()
        self.order = list(range(count))  # so that part of a run is a fair sample too
        random.Random(seed).shuffle(self.order)

    def draw(self, share):
        """None where the share has nothing left."""
        generator = self._randoms[share]
        for _ in range(2000):
            name, line = generator.choice(self._shares[share])
            source, by_line = self._sources[name]
            if line not in by_line:
                continue
            kind = generator.choice(sorted({mutation.kind for mutation in by_line[line]}))
            mutation = generator.choice([mutation for mutation in by_line[line] if mutation.kind == kind])
            if (name, mutation) not in self._drawn:
                self._drawn.add((name, mutation))
                return _whole_lines(name, source, mutation)
        return None


def _whole_lines(name, source, mutation):
    first, last = source.line(mutation.start), source.line(max(mutation.start, mutation.end - 1))
    start = source.line_starts[first]
    end = source.line_starts[last + 1] if last + 1 < len(source.line_starts) else len(source.text)
    new = source.text[start : mutation.start] + mutation.text + source.text[mutation.end : end]
    return Defect(name, first + 1, source.text[start:end], new, mutation.kind)


def listed(root, path):
    """The list by hand: file, suites, text, what takes its place. A file that moved to another folder is found."""
    result = []
    for line in path.read_text().splitlines():
        if not line or line.startswith("#"):
            continue
        file, suites, old, new = line.split("\t")
        if not (root / file).exists():
            name = file.rsplit("/", 1)[-1]
            found = [p for p in (root / "src").rglob(name) if old in p.read_text()]
            found = found or [p for p in (root / "src").rglob("*.[ch]pp") if old in p.read_text()]
            file = found[0].relative_to(root).as_posix() if len(found) == 1 else file
        result.append(Defect(file, 0, old, new, "listed", suites.split()))
    return result


def judged(path):
    """Drawn defects that change nothing that anyone could notice: id and why."""
    result = {}
    for line in path.read_text().splitlines():
        if line and not line.startswith("#"):
            name, reason = line.split("\t")[:2]
            result[name] = reason
    return result
