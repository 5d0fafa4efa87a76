"""Uploaded assets: there when their bytes have the announced hash, shared, bounded, and gone when nothing uses them."""

from __future__ import annotations

import contextlib
import hashlib
from itertools import count

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.core.targets import assets as store
from hapticd.core.targets.assets import Assets
from hapticd.core.targets.scene import Scene
from hapticd.errors import RequestError
from hapticd_contract.contents import LevelMap
from hapticd_contract.surfaces import Circle, Surface
from hapticd_contract.targets import ClientTargets

T0_NS = 1_234_567_890_123
PART = 16_384


def digest_of(levels: bytes) -> bytes:
    return hashlib.sha256(levels).digest()


def uploaded(assets: Assets, levels: bytes, client: str = "a", t_ns: int = T0_NS) -> bytes:
    """Upload all parts; return the hash."""
    digest = digest_of(levels)
    for offset in range(0, len(levels), PART):
        have = assets.upload(client, digest, len(levels), offset, levels[offset : offset + PART], t_ns)
        assert have == min(offset + PART, len(levels))
    return digest


def picture(digest: bytes, width: int, height: int) -> LevelMap:
    return LevelMap(width, height, b"", 0.0, 2.55, asset=digest)


def lay(scene: Scene, *surfaces: Surface, client: str = "a", t_ns: int = T0_NS) -> tuple[str, ...]:
    named = {f"s{index}": surface for index, surface in enumerate(surfaces)}
    return scene.set_targets(ClientTargets.of(client, 10**12, {}, {}, surfaces=named), t_ns)


def test_a_picture_of_1024_pixels_is_felt_at_its_own_resolution_by_all_users() -> None:
    scene = Scene(w_limit_um=4.0)
    columns = bytes(255 if column % 2 else 0 for column in range(1024))
    digest = uploaded(scene.assets, columns * 1024)
    image = picture(digest, 1024, 1024)
    assert lay(scene, Surface.of(image)) == ()
    pitch_mm = 137.5 / 1023
    felt_um = [scene.surfaces.amplitude_um((column - 511.5) * pitch_mm, 3.0, T0_NS) for column in range(500, 504)]
    assert felt_um == pytest.approx([0.0, 2.55, 0.0, 2.55], abs=1e-9)
    assert scene.set_targets(ClientTargets.of("b", 10**9, {1: image}, {}), T0_NS) == ()
    assert scene.amplitude_um(1, -511.5 * pitch_mm, 0.0) == 0.0
    assert scene.assets.report() == {"count": 1, "uploads": 0, "bytes": 2**20}


def test_a_part_out_of_place_changes_nothing_and_a_request_without_one_only_asks() -> None:
    assets, levels = Assets(), bytes(range(100))
    digest = digest_of(levels)
    assert assets.upload("a", digest, 100, 50, levels[50:], T0_NS) == 0
    assert assets.upload("a", digest, 100, 0, levels[:40], T0_NS) == 40
    assert assets.upload("a", digest, 100, 0, levels[:40], T0_NS) == 40
    assert assets.upload("a", digest, 100, 0, b"", T0_NS) == 40
    assert assets.upload("b", digest, 100, 0, b"", T0_NS) == 0  # no client waits for what another one sends
    assert assets.upload("a", digest, 100, 40, levels[40:], T0_NS) == 100
    assert assets.upload("b", digest, 100, 0, b"", T0_NS) == 100


def test_bytes_with_another_hash_are_dropped() -> None:
    assets = Assets()
    with pytest.raises(RequestError, match="another hash"):
        assets.upload("a", digest_of(b"abc"), 3, 0, b"abd", T0_NS)
    assert assets.report() == {"count": 0, "uploads": 0, "bytes": 0}


def test_a_map_whose_asset_is_not_here_or_has_another_size_is_refused() -> None:
    scene = Scene(w_limit_um=4.0)
    digest = uploaded(scene.assets, b"abcd")
    assert lay(
        scene,
        Surface.of(picture(bytes(32), 2, 2)),
        Surface.of(picture(digest, 2, 3)),
        Surface.of(picture(digest, 2, 2)),
    ) == (
        "surface 's0' needs an asset that is not here: upload it first.",
        "surface 's1' needs 6 bytes of levels, its asset has 4.",
    )
    assert [layer.name for layer in scene.surfaces.layers] == ["s2"]


def test_an_asset_outlasts_its_use_for_a_while_and_an_ended_upload_is_free() -> None:
    scene = Scene(w_limit_um=4.0)
    digest = uploaded(scene.assets, b"abcd")
    uploaded(scene.assets, b"idle")
    scene.assets.upload("a", bytes(32), 10**6, 0, b"x" * PART, T0_NS)
    lay(scene, Surface.of(picture(digest, 2, 2), Circle(5.0)))
    reports = []
    for second in range(30):
        scene.expire(T0_NS + second * 10**9)
        reports.append((scene.assets.report()["count"], scene.assets.report()["uploads"]))
        if second == 15:
            lay(scene, t_ns=T0_NS + second * 10**9)
    assert reports.index((2, 0)) == store.UPLOAD_NS // 10**9
    assert reports.index((1, 0)) == store.KEPT_NS // 10**9
    assert reports.index((0, 0)) == 15 + store.KEPT_NS // 10**9


def test_what_is_unused_longest_makes_room_for_new_assets() -> None:
    scene, numbers = Scene(w_limit_um=4.0), count()

    def fill() -> bytes:
        one = next(numbers)
        return uploaded(scene.assets, one.to_bytes(2, "little") * 2**19, "a", T0_NS + one)

    first = fill()
    lay(scene, Surface.of(picture(first, 1024, 1024)))
    unused = [fill() for _ in range(40)]
    assert scene.assets.report()["bytes"] == store.MAX_BYTES
    here = [scene.assets.upload("a", digest, 2**20, 0, b"", T0_NS) for digest in (first, unused[0], unused[-1])]
    assert here == [2**20, 0, 2**20]  # the first is used


def test_uploads_that_never_end_are_refused_beyond_the_bound() -> None:
    assets = Assets()
    for one in range(store.MAX_ASSETS):
        assert assets.upload("hog", one.to_bytes(2, "little") * 16, 2**20, 0, b"x", T0_NS) == 1
    with pytest.raises(RequestError, match=f"{store.MAX_ASSETS} assets"):
        assets.upload("hog", b"\xff" * 32, 2**20 - 1, 0, b"x", T0_NS)
    assets.look((), T0_NS + store.UPLOAD_NS)
    assert assets.report() == {"count": 0, "uploads": 0, "bytes": 0}


@given(
    st.lists(
        st.tuples(st.sampled_from("abc"), st.integers(0, 4), st.integers(0, 6), st.integers(0, 40), st.booleans()),
        max_size=40,
    )
)
@settings(max_examples=60)
def test_whatever_is_sent_the_bounds_hold_and_an_asset_has_its_hash(
    steps: list[tuple[str, int, int, int, bool]],
) -> None:
    """Small bounds, and parts of a few contents in any order, some of them damaged."""
    with pytest.MonkeyPatch.context() as patch:
        for name, bound in (("MAX_BYTES", 1500), ("MAX_ASSETS", 4)):
            patch.setattr(store, name, bound)
        scene, t_ns = Scene(w_limit_um=4.0), T0_NS
        for client, content, offset, seconds, is_damaged in steps:
            levels, t_ns = bytes([content]) * 400, t_ns + seconds * 10**8
            digest, at = digest_of(levels), 100 * offset
            part = (b"damaged" if is_damaged else levels[at : at + 100]) if at < 400 else b""
            with contextlib.suppress(RequestError):
                scene.upload(client, digest, 400, at, part, t_ns)
            lay(scene, Surface.of(picture(digest, 20, 20)), client=client, t_ns=t_ns)
            scene.expire(t_ns)
            assert scene.assets.report()["bytes"] <= 1500
            for layer in scene.surfaces.layers:
                image = layer.surface.content
                assert digest_of(scene.assets.resolved(image).levels) == image.asset
