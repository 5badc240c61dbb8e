"""Text files of numbers, read line by line or word by word; every error names the line."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence

import numpy as np

from ..errors import InputError
from ..limits import LARGEST, MAX_CONTROL_POINTS, MAX_MODEL_LINES, TOO_LARGE, at_most
from ..numeric.arrays import FloatArray

__all__ = ["TextLines", "Words", "is_number"]

#: Digits and signs of whole numbers: longer ones count nothing and do not fit into 64 bits.
MAX_DIGITS = 18
#: Words of a line: a coordinate of all control points of a model, and a few.
MAX_WORDS = MAX_CONTROL_POINTS + 1000


class TextLines:
    """The lines of a file that say something, one after the other; comments start with ``#``.

    Attributes
    ----------
    number : int
        Of the last line that was read, from 1.
    comments : list of str
        Comments passed so far, without ``#``.
    """

    def __init__(self, data: bytes) -> None:
        data = data.removeprefix(b"\xef\xbb\xbf")
        if b"\n" not in data:
            data = data.replace(b"\r", b"\n")
        at_most(data.count(b"\n"), MAX_MODEL_LINES, "lines", "coarsen the model, delete empty lines and comments")
        self._lines = enumerate(io.BytesIO(data), 1)
        self._ahead: tuple[int, str] | None = None
        self.number = 0
        self.comments: list[str] = []

    def peek(self) -> str | None:
        """The next line, which stays the next; None at the end."""
        while self._ahead is None:
            number, raw = next(self._lines, (0, b""))
            if not number:
                return None
            line = _decoded(raw).strip()
            if line.startswith("#"):
                self.comments.append(line[1:].strip())
            elif line:
                self._ahead = number, line
        return self._ahead[1]

    def next(self, what: str) -> str:
        """The next line, which must be there to say `what`."""
        line = self.peek()
        if line is None or self._ahead is None:
            raise InputError(f"ends after line {self.number}, where {what} should follow; the file is truncated")
        self.number, self._ahead = self._ahead[0], None
        return line

    def numbers(self, what: str, count: int) -> FloatArray:
        """The next line, as so many numbers."""
        words = _words(self.next(what).replace(",", " "), self.number)
        if len(words) != count:
            raise InputError(f"line {self.number}, {what}: {len(words)} entries instead of {count}; correct it")
        return np.array(_floats(words, [(0, self.number)], what))

    def integers(self, what: str, counts: Sequence[int] = ()) -> list[int]:
        """The next line, as whole numbers, as many as one of `counts` (any number by default)."""
        words = _words(self.next(what).replace(",", " "), self.number)
        values = [_integer(word, self.number, what) for word in words]
        if counts and len(values) not in counts:
            expected = " or ".join(map(str, counts))
            raise InputError(f"line {self.number}, {what}: {len(values)} entries instead of {expected}; correct it")
        return values


class Words:
    """The words of a file, one after the other, whatever the line ends."""

    def __init__(self, lines: TextLines) -> None:
        self.lines = lines
        self._words: list[str] = []
        self._at = 0

    @property
    def number(self) -> int:
        """Of the line of the last word."""
        return self.lines.number

    def next(self, what: str) -> str:
        """The next word, which must be there to say `what`."""
        self._fill(what)
        self._at += 1
        return self._words[self._at - 1]

    def _fill(self, what: str) -> None:
        """Go to the next line if this one is used up."""
        if self._at == len(self._words):
            self._words, self._at = _words(self.lines.next(what), self.number), 0

    def at_end(self) -> bool:
        """Whether no word follows."""
        return self._at == len(self._words) and self.lines.peek() is None

    def integer(self, what: str) -> int:
        """The next word as a whole number."""
        return _integer(self.next(what), self.number, what)

    def count(self, what: str, limit: int, remedy: str) -> int:
        """The next word as a number of things, at most `limit`."""
        value = self.integer(f"the number of {what}")
        if value < 0:
            raise InputError(f"line {self.number}: {value} {what}; correct the number")
        at_most(value, limit, f"{what} (line {self.number})", remedy)
        return value

    def numbers(self, what: str, count: int) -> FloatArray:
        """So many words as numbers."""
        words: list[str] = []
        starts: list[tuple[int, int]] = []
        while len(words) < count:
            self._fill(what)
            starts.append((len(words), self.number))
            taken = self._words[self._at : self._at + count - len(words)]
            self._at += len(taken)
            words += taken
        return np.array(_floats(words, starts, what))


def is_number(word: str) -> bool:
    """Whether a word is a number, be it NaN."""
    try:
        float(word)
    except ValueError:
        return False
    return "_" not in word


def _decoded(raw: bytes) -> str:
    try:
        return raw.decode()
    except UnicodeDecodeError:
        # Numbers are ASCII; names that are not UTF-8 come from programs older than it.
        return raw.decode("latin-1")


def _words(line: str, number: int) -> list[str]:
    words = line.split(None, MAX_WORDS)
    at_most(len(words), MAX_WORDS, f"entries in line {number}", "coarsen the model")
    return words


def _integer(word: str, number: int, what: str) -> int:
    try:
        if len(word) <= MAX_DIGITS and "_" not in word:
            return int(word)
    except ValueError:
        pass
    raise InputError(f"line {number}, {what}: {word[:30]!r} is not a whole number; correct it")


def _floats(words: list[str], starts: Sequence[tuple[int, int]], what: str) -> list[float]:
    """Values of words; `starts` says from which word on they stand in which line."""
    # All at once, which is fast; one by one only to find the bad one. The comparison also refuses NaN.
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = [math.nan]
    if all(-LARGEST <= value <= LARGEST for value in values) and "_" not in "".join(words):
        return values
    k, bad = next((k, w) for k, w in enumerate(words) if not is_number(w) or not abs(float(w)) <= LARGEST)
    why = f"is NaN, infinite or {TOO_LARGE}" if is_number(bad) else "is not a number"
    number = next(line for first, line in reversed(starts) if first <= k)
    raise InputError(f"line {number}, {what}: {bad[:30]!r} {why}; correct it")
