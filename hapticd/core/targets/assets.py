"""Uploaded assets: levels of maps that are larger than a message, by the SHA-256 of their bytes.

An asset arrives in parts, in order, and is there when its bytes have the hash that was announced. Of an upload counts
what has arrived, so that nobody takes room by announcing; it lapses UPLOAD_NS after its last part, and SLOWEST_NS after
its first. What no surface and no target uses is dropped KEPT_NS after it was last used or asked for; where there is no
room, the unused one that was used longest ago is dropped earlier.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

from msgspec.structs import replace

from hapticd_contract.contents import Content, LevelMap

from ...errors import RequestError

MAX_ASSET_BYTES: Final = 2**20  # a picture of 1024 x 1024
MAX_BYTES: Final = 2**25
MAX_ASSETS: Final = 256
KEPT_NS: Final = 10_000_000_000
UPLOAD_NS: Final = 5_000_000_000
SLOWEST_NS: Final = 60_000_000_000  # for 1 MiB: 18 kB/s
LOOK_NS: Final = 1_000_000_000


@dataclass(slots=True)
class _Asset:
    """One asset. `t_ns` is when it was last asked for or in use."""

    levels: bytes
    t_ns: int
    is_used: bool = False


@dataclass(slots=True)
class _Upload:
    """An asset that has not arrived in whole. Its hash is taken part by part, so that no message takes long."""

    size: int
    t_first_ns: int
    t_ns: int
    parts: bytearray = field(default_factory=bytearray)
    hash: hashlib._Hash = field(default_factory=hashlib.sha256)


class Assets:
    """All assets of all clients. Instants are arguments in ns on one monotonic axis."""

    def __init__(self) -> None:
        self._assets: dict[bytes, _Asset] = {}
        self._uploads: dict[tuple[str, bytes], _Upload] = {}  # by client: what another one sends is not waited for
        self._t_looked_ns = 0

    # --- requests of clients ---

    def upload(self, client: str, digest: bytes, size: int, offset: int, part: bytes, t_ns: int) -> int:
        """Take a part, empty for none; return how many bytes are here. A part that does not begin where the last one
        ended changes nothing. Raises RequestError where there is no room, or the bytes do not have the hash."""
        asset = self._assets.get(digest)
        if asset is not None:
            asset.t_ns = t_ns
            return len(asset.levels)
        upload = self._uploads.get((client, digest))
        if upload is None:
            if not part or offset > 0:
                return 0
            self._make_room(len(part), 1)
            upload = self._uploads[client, digest] = _Upload(size, t_ns, t_ns)
        if not part or offset != len(upload.parts):
            return len(upload.parts)
        if size != upload.size or offset + len(part) > size:
            raise RequestError(f"asset: has {upload.size} bytes, not {size}, and no part goes beyond.")
        self._make_room(len(part), 0)
        upload.parts += part
        upload.hash.update(part)
        upload.t_ns = t_ns
        if len(upload.parts) == size:
            del self._uploads[client, digest]
            if upload.hash.digest() != digest:
                raise RequestError("asset: its bytes have another hash: upload it again.")
            self._assets[digest] = _Asset(bytes(upload.parts), t_ns)
        return offset + len(part)

    def _make_room(self, size: int, assets: int) -> None:
        """Drop unused assets, oldest first, until there is room. Raises RequestError where there is none."""
        found = self.report()
        size, count = size + found["bytes"], assets + found["count"] + found["uploads"]
        for digest, asset in sorted(self._assets.items(), key=lambda item: item[1].t_ns):
            if size <= MAX_BYTES and count <= MAX_ASSETS:
                return
            if not asset.is_used:
                size, count = size - len(asset.levels), count - 1
                del self._assets[digest]
        if size > MAX_BYTES or count > MAX_ASSETS:
            raise RequestError(
                f"asset: the daemon keeps at most {MAX_BYTES} bytes and {MAX_ASSETS} assets: remove a surface first."
            )

    # --- use ---

    def refusal(self, target: Content) -> str:
        """Return why a target cannot have its asset; empty if it can, or needs none."""
        if not isinstance(target, LevelMap) or not target.asset:
            return ""
        asset, size = self._assets.get(target.asset), target.width * target.height
        if asset is None:
            return "needs an asset that is not here: upload it first."
        if len(asset.levels) != size:
            return f"needs {size} bytes of levels, its asset has {len(asset.levels)}."
        return ""

    def resolved(self, target: Content) -> Content:
        """Return a target with its asset's levels, which is in use from now on."""
        if not isinstance(target, LevelMap) or not target.asset:
            return target
        asset = self._assets[target.asset]
        asset.is_used = True
        return replace(target, levels=asset.levels)

    def is_due(self, t_ns: int) -> bool:
        """Return whether to `look` again."""
        return t_ns - self._t_looked_ns >= LOOK_NS and bool(self._assets or self._uploads)

    def look(self, in_force: Iterable[Content], t_ns: int) -> None:
        """Note which assets the targets in force use, and drop what was not used for long."""
        self._t_looked_ns = t_ns
        used = {target.asset for target in in_force if isinstance(target, LevelMap)}
        for digest, asset in tuple(self._assets.items()):
            asset.is_used = digest in used
            if asset.is_used:
                asset.t_ns = t_ns
            elif t_ns - asset.t_ns >= KEPT_NS:
                del self._assets[digest]
        for key, upload in tuple(self._uploads.items()):
            if t_ns - upload.t_ns >= UPLOAD_NS or t_ns - upload.t_first_ns >= SLOWEST_NS:
                del self._uploads[key]

    # --- status ---

    def report(self) -> dict[str, int]:
        """Return counts and bytes; of an upload, those that have arrived."""
        sizes = [len(asset.levels) for asset in self._assets.values()]
        arrived = [len(upload.parts) for upload in self._uploads.values()]
        return {"count": len(sizes), "uploads": len(arrived), "bytes": sum(sizes) + sum(arrived)}
