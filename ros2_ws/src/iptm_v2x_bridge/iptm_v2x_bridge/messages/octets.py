"""Reads the canonical octet encoding rules (ITU-T X.696) of security envelopes and certificates by hand."""

from __future__ import annotations

LONGEST_LENGTH = 2
"""Octets of a length; all of it fits into a datagram."""
MAX_ENTRIES = 64
"""Entries of a list; longer ones stand in no certificate."""
VERSION = 3


class UnreadableError(Exception):
    """The octets are not signed data or a certificate of a supported kind."""


class Octets:
    """Reads octets from the front; every method raises `UnreadableError` where they end."""

    def __init__(self, octets: bytes, at: int = 0) -> None:
        self.octets, self.at = octets, at

    def take(self, count: int) -> bytes:
        """Return the next `count` octets."""
        end = self.at + count
        if end > len(self.octets):
            raise UnreadableError
        taken, self.at = self.octets[self.at : end], end
        return taken

    def number(self, count: int = 1) -> int:
        """Return an unsigned number of a fixed size."""
        return int.from_bytes(self.take(count), "big")

    def length(self) -> int:
        """Return a length."""
        first = self.number()
        if first > 0x80 + LONGEST_LENGTH:
            raise UnreadableError
        return first if first < 0x80 else self.number(first - 0x80)

    def string(self) -> bytes:
        """Return octets behind their length."""
        return self.take(self.length())

    def integer(self) -> int:
        """Return an unsigned number behind its length."""
        return int.from_bytes(self.string(), "big")

    def entries(self) -> range:
        """Return a range over the entries of a list that follow."""
        count = self.integer()
        if count > MAX_ENTRIES:
            raise UnreadableError
        return range(count)

    def expect(self, *octets: int) -> None:
        """Take octets that have to be these."""
        if self.take(len(octets)) != bytes(octets):
            raise UnreadableError

    def skip_additions(self) -> None:
        """Skip what a later edition has added to the end of a sequence."""
        bits = self.string()[1:]
        for _ in range(sum(octet.bit_count() for octet in bits)):
            self.string()
