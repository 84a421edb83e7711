"""What can happen to the bytes of a file; every mutation is a function of a random source."""

import random
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

NUMBER: Final = re.compile(rb"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
NUMBERS: Final = (
    *(b"nan", b"inf", b"-inf", b"1e999", b"-1e308", b"0", b"-1", b"", b"1,5", b"0x10", b"1e-320"),
    *(b"9" * 400, b"65536", b"2147483648", b"-32769", b"1_000", "٣".encode(), b"true", b"[]"),
)
WORDS: Final = (
    *(b"\x1b[2J", b"\x1b]0;owned\x07", b"\x9b31m", "\u202egnp.exe".encode(), b"[bold red]"),
    *(b"<script>alert(7)</script>", b"=cmd|' /C calc'!A0", b"../../../etc/passwd", b"%s%n{0}"),
    *(b"A" * 5000, b"\0", "é".encode("latin-1"), b'"', b"'", b"\\", b"{", b"]]>", b"&lol;", b"\t"),
)
BINARY_WORDS: Final = tuple(
    struct.pack(kind, value)
    for kind, value in (
        *(("<H", v) for v in (0, 1, 0x7FFF, 0x8000, 0xFFFF)),
        *(("<I", v) for v in (0, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)),
        *(("<f", v) for v in (0.0, -1.0, 1e-40, 1e30, -3e38, float("nan"), float("inf"))),
    )
)
HEAD: Final = 2048
"""Bytes at the beginning in which counts, names and scales stand."""
MAX_BYTES_OF_NUMBERS: Final = 7
DEPTH: Final = 20_000
COLUMNS: Final = 60_000


@dataclass(frozen=True, slots=True)
class Damage:
    """A damaged file.

    Attributes
    ----------
    content
        Its bytes.
    what
        What was done to it.
    data
        How many measured values it may have replaced by others, which no reader can know.
    cut
        Whether it is the beginning of the undamaged file.
    between_lines
        Whether it was cut between two lines, with or without the end of the first.
    """

    content: bytes
    what: str
    data: int = 0
    cut: bool = False
    between_lines: bool = False


Mutation = Callable[[random.Random, bytes], Damage]


def flip_bit(chance: random.Random, content: bytes, *, whole: bool = False) -> Damage:
    """Flip one bit, every second time near the beginning unless it may be anywhere."""
    end = len(content) if whole or chance.random() < 0.5 else min(HEAD, len(content))
    at, bit = chance.randrange(end), chance.randrange(8)
    damaged = bytearray(content)
    damaged[at] ^= 1 << bit
    return Damage(bytes(damaged), f"bit {bit} of byte {at} flipped", data=1)


def truncate(chance: random.Random, content: bytes) -> Damage:
    """Cut a file: anywhere, near its end, at a block, or in or after a line."""
    end = chance.choice(
        (
            chance.randrange(len(content)),
            len(content) - 1 - chance.randrange(min(64, len(content))),
            chance.randrange(len(content)) // 512 * 512,
            content.rfind(b"\n", 0, chance.randrange(1, len(content))) + chance.randrange(2),
        )
    )
    end = max(end, 0)
    between = b"\n" in content[max(0, end - 1) : end + 2]
    what = f"cut after {end} of {len(content)} bytes"
    return Damage(content[:end], what, cut=True, between_lines=between)


def replace_bytes(chance: random.Random, content: bytes) -> Damage:
    """Replace some bytes by random ones."""
    damaged, count = bytearray(content), chance.choice((1, 1, 2, 4, 8))
    places = [_place(chance, content) for _ in range(count)]
    for place in places:
        damaged[place] = chance.randrange(256)
    what = ", ".join(f"byte {place} as {damaged[place]}" for place in places)
    return Damage(bytes(damaged), what, data=count)


def insert_bytes(chance: random.Random, content: bytes) -> Damage:
    at, count = _place(chance, content), chance.choice((1, 2, 7, 512))
    damaged = content[:at] + chance.randbytes(count) + content[at:]
    return Damage(damaged, f"{count} bytes at {at}", _numbers_within(count))


def delete_span(chance: random.Random, content: bytes) -> Damage:
    at, count = _place(chance, content), chance.choice((1, 2, 7, 512))
    damaged = content[:at] + content[at + count :]
    return Damage(damaged, f"{count} bytes deleted at {at}", _numbers_within(count))


def repeat_span(chance: random.Random, content: bytes) -> Damage:
    at, count = _place(chance, content), chance.choice((1, 64, 512, 4096))
    span = content[at : at + count]
    return Damage(content[:at] + span + content[at:], f"{count} bytes twice at {at}")


def fill_span(chance: random.Random, content: bytes) -> Damage:
    """Fill a block with zeros or ones, as a disk does that lost it."""
    at, count = _place(chance, content), chance.choice((4, 64, 512, 4096))
    byte = chance.choice((b"\0", b"\xff"))
    filled = byte * len(content[at : at + count])
    damaged = content[:at] + filled + content[at + count :]
    return Damage(damaged, f"{count} times {byte!r} at {at}", _numbers_within(count))


def write_word(chance: random.Random, content: bytes) -> Damage:
    """Write a number of the edge of its type where one may stand."""
    at, word = _place(chance, content) // 2 * 2, chance.choice(BINARY_WORDS)
    damaged = content[:at] + word + content[at + len(word) :]
    return Damage(damaged[: len(content)], f"{word.hex()} at {at}", data=2)


def append_bytes(chance: random.Random, content: bytes) -> Damage:
    count = chance.choice((1, 512, 100_000))
    return Damage(content + chance.randbytes(count), f"{count} bytes appended")


def replace_all(chance: random.Random, content: bytes) -> Damage:
    """Give another content under the same name: nothing, noise, or the same byte."""
    others = (b"", b"\n", b"\0" * 1024, chance.randbytes(5000), b"\xff\xfe", b"PK\3\4", b"\1P")
    return Damage(chance.choice(others), "another content")


def replace_number(chance: random.Random, content: bytes) -> Damage:
    """Replace a number of a text by one at the edge of what a number is."""
    return _replace_match(chance, content, NUMBER, chance.choice(NUMBERS), data=1)


def change_digit(chance: random.Random, content: bytes) -> Damage:
    digit = str(chance.randrange(10)).encode()
    return _replace_match(chance, content, re.compile(rb"\d"), digit, data=1)


def replace_name(chance: random.Random, content: bytes) -> Damage:
    """Replace a name of a text by one that a terminal, a page or a parser may act on."""
    return _replace_match(chance, content, re.compile(rb"[A-Za-z_]\w+"), chance.choice(WORDS))


def change_lines(chance: random.Random, content: bytes) -> Damage:
    """Delete, repeat, exchange or empty lines."""
    lines = content.split(b"\n")
    one, other = (min(chance.randrange(len(lines)), chance.randrange(len(lines))) for _ in "ab")
    what = chance.choice(("deleted", "repeated", "exchanged", "emptied", "joined"))
    if what == "deleted":
        del lines[one]
    elif what == "repeated":
        lines.insert(other, lines[one])
    elif what == "exchanged":
        lines[one], lines[other] = lines[other], lines[one]
    elif what == "emptied":
        lines[one] = b""
    else:
        lines[one : one + 2] = [b"".join(lines[one : one + 2])]
    return Damage(b"\n".join(lines), f"line {one + 1} {what}")


def change_encoding(chance: random.Random, content: bytes) -> Damage:
    text = content.decode("utf-8", errors="replace")
    encoding = chance.choice(("utf-16", "utf-16-le", "utf-32", "utf-8-sig", "utf-7"))
    return Damage(text.encode(encoding), f"as {encoding}")


def change_separators(chance: random.Random, content: bytes) -> Damage:
    pairs = ((b"\n", b"\r"), (b"\n", b"\r\n"), (b"\t", b" "), (b"\t", b","), (b".", b","))
    old, new = chance.choice((*pairs, (b"\n", b"\n\n"), (b",", b";"), (b"=", b":"), (b"\n", b"")))
    return Damage(content.replace(old, new), f"{old!r} as {new!r}")


def nest_deeply(chance: random.Random, content: bytes) -> Damage:
    """Put brackets of TOML, JSON or XML into each other, more often than a parser may follow."""
    opened = chance.choice((b"[", b"{", b'{"a":', b"a=[", b"<a>", b"a.", b"[a."))
    at = chance.choice((0, content.find(b"\n") + 1, content.find(b"=") + 1, len(content)))
    return Damage(content[:at] + opened * DEPTH + content[at:], f"{DEPTH} times {opened!r} at {at}")


def widen(chance: random.Random, content: bytes) -> Damage:
    """Give the first lines very many columns."""
    lines = content.split(b"\n")
    row = chance.randrange(min(6, len(lines)))
    separator = b"\t" if b"\t" in content else b","
    names = [b"M%d" % k if chance.random() < 0.9 else b"M1" for k in range(COLUMNS)]
    lines[row] = separator.join([lines[row], *names])
    return Damage(b"\n".join(lines), f"{COLUMNS} columns in line {row + 1}")


def _numbers_within(count: int) -> int:
    """Say how many numbers so few bytes are parts of, without making one of them."""
    return 2 if count <= MAX_BYTES_OF_NUMBERS else 0


def _place(chance: random.Random, content: bytes) -> int:
    """Choose a byte: every second time near the beginning."""
    end = min(HEAD, len(content)) if chance.random() < 0.5 else len(content)
    return chance.randrange(end)


def _replace_match(
    chance: random.Random, content: bytes, pattern: re.Pattern[bytes], new: bytes, data: int = 0
) -> Damage:
    start = _place(chance, content)
    match = pattern.search(content, start) or pattern.search(content)
    if match is None:
        return Damage(content, "unchanged")
    damaged = content[: match.start()] + new + content[match.end() :]
    return Damage(damaged, f"{match[0]!r:.40} as {new!r:.40} at {match.start()}", data)


BINARY: Final[tuple[Mutation, ...]] = (
    *(replace_bytes, insert_bytes, delete_span, repeat_span, fill_span, write_word, write_word),
    *(append_bytes, flip_bit),
)
TEXT: Final[tuple[Mutation, ...]] = (
    *(replace_bytes, insert_bytes, delete_span, repeat_span, fill_span, replace_number),
    *(replace_number, change_digit, replace_name, replace_name, change_lines, change_lines),
    *(change_encoding, change_separators),
)
RARE: Final[tuple[Mutation, ...]] = (replace_all, append_bytes)
RARE_TEXT: Final[tuple[Mutation, ...]] = (*RARE, nest_deeply, nest_deeply, widen)


def mutate(chance: random.Random, content: bytes, *, text: bool) -> Damage:
    """Damage a file in one of many ways, the coarse ones more rarely."""
    common, rare = (TEXT, RARE_TEXT) if text else (BINARY, RARE)
    mutation = chance.choice(rare if chance.random() < 0.1 else common)
    damage = mutation(chance, content)
    return replace(damage, what=f"{mutation.__name__}: {damage.what}")
