"""Decoder of one part of an asset: content larger than a message. The contract is clients/PROTOCOL.md."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import RequestError
from .fields import MAX_BINARY_BYTES, Fields

MAX_ASSET_BYTES = 2**20
DIGEST_BYTES = 32


@dataclass(frozen=True, slots=True)
class AssetPart:
    """A part of an asset, from `offset` on; empty in a request that only asks how much of it is here.

    `digest` is the SHA-256 of the whole asset of `size` bytes.
    """

    client: str
    digest: bytes
    size: int
    offset: int
    part: bytes


def read_asset_part(fields: Fields) -> AssetPart:
    """Read the body of an `asset` request. Raises RequestError."""
    client = fields.label("client")
    digest = fields.binary("asset", DIGEST_BYTES)
    size = fields.whole("size", 1, MAX_ASSET_BYTES)
    offset, part = 0, b""
    if "part" in fields:
        offset = fields.whole("offset", 0, size - 1)
        part = fields.some_binary("part", MAX_BINARY_BYTES)
        if offset + len(part) > size:
            raise RequestError(f"{fields.place('part')}: ends at byte {offset + len(part)}, the asset has {size}.")
    return AssetPart(client, digest, size, offset, part)
