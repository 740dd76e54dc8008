"""The text of a good STEP file in, the same with a seeded damage out: what disks, mail and editors do to files."""

from __future__ import annotations

import random
import re

SORTS = ("cut statement", "moved statement", "swapped numbers", "other reference", "lost argument", "truncated",
         "flipped bytes", "lost bracket", "huge number", "other keyword")
NUMBER = r"-?\d+\.\d*(?:E[-+]\d+)?"


def mutated(text: str, seed: int) -> tuple[str, bytes]:
    """The sort of damage and the file's bytes."""
    chance = random.Random(seed)
    sort = SORTS[seed % len(SORTS)]
    start = text.index("DATA;") + 5
    spans = [(start + m.start(), start + m.end()) for m in re.finditer(r"#\d+ ?=[^;]*;", text[start:])]
    low, high = chance.choice(spans)
    statement = text[low:high]
    if sort == "cut statement":
        text = text[:low] + text[high:]
    elif sort == "moved statement":
        place = chance.choice(spans)[0] + chance.randrange(12)
        cut = text[:low] + text[high:]
        text = cut[:place] + statement + cut[place:]
    elif sort == "swapped numbers":
        text = text[:low] + _one(chance, NUMBER, statement, str(chance.uniform(-1e4, 1e4))) + text[high:]
    elif sort == "other reference":
        other = f"#{chance.randrange(1, len(spans) + 1)}"
        text = text[:low] + _one(chance, r"(?<=[(,])#\d+", statement, other) + text[high:]
    elif sort == "lost argument":
        text = text[:low] + _one(chance, r",[^,()]*", statement, "") + text[high:]
    elif sort == "truncated":
        text = text[:chance.randrange(start, len(text))]
    elif sort == "lost bracket":
        text = text[:low] + _one(chance, r"[()]", statement, "") + text[high:]
    elif sort == "huge number":
        number = chance.choice(("1.E+300", "-1.E+30", "0.", "1.E-300", "99999999999"))
        text = text[:low] + _one(chance, NUMBER, statement, number) + text[high:]
    elif sort == "other keyword":
        other = text[slice(*chance.choice(spans))]
        text = text[:low] + re.sub(r"=\s*[A-Z_0-9]+", "=" + other.split("=")[1].split("(")[0], statement, count=1) + text[high:]
    data = bytearray(text.encode("latin-1"))
    if sort == "flipped bytes":
        for _ in range(chance.randrange(1, 8)):
            data[chance.randrange(start, len(data))] ^= 1 << chance.randrange(8)
    return sort, bytes(data)


def _one(chance: random.Random, pattern: str, statement: str, instead: str) -> str:
    """The statement with one of the pattern's finds, behind its number, replaced."""
    found = list(re.finditer(pattern, statement[statement.index("="):]))
    if not found:
        return statement
    at = chance.choice(found)
    head = statement.index("=")
    return statement[:head + at.start()] + instead + statement[head + at.end():]
