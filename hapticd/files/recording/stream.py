"""A recording in the making, as bytes: the header, then each thing that the machine's tap is told, numbered."""

from __future__ import annotations

from typing import Any

from ...errors import RecordingError
from .framing import HEADER_KIND, MAGIC, frame
from .header import Header, encode_header
from .records import KINDS, body_of


class Stream:
    """Numbers and frames the records of one recording. `too_long` counts those that no reader would take."""

    def __init__(self, header: Header) -> None:
        self.too_long = 0
        self._header = encode_header(header)
        self._seq = 0

    @property
    def seq(self) -> int:
        """The number of the record that comes next."""
        return self._seq

    def opening(self, seq: int = 0) -> bytes:
        """What the file that goes on with record `seq` begins with: magic and header."""
        return MAGIC + self.header(seq)

    def header(self, seq: int) -> bytes:
        """The header alone, with the number of the record that follows it."""
        return frame(HEADER_KIND, seq, self._header)

    def record(self, kind: str, t_ns: int, values: tuple[Any, ...]) -> bytes:
        """One record, framed. A record that is too long leaves a gap in the numbers, which a reader reports."""
        seq = self._seq
        self._seq += 1
        try:
            return frame(KINDS[kind].number, seq, body_of(kind, t_ns, values))
        except RecordingError:
            self.too_long += 1
            return b""
