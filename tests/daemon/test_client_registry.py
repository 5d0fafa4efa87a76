"""A name is one user's while it is used, and what was said earlier never undoes what was said later."""

from __future__ import annotations

import pytest

from hapticd.daemon.client_registry import KEPT_NS, MAX_NAMES, ClientRegistry
from hapticd.errors import RequestError

S = 1_000_000_000


@pytest.fixture
def client_registry() -> ClientRegistry:
    return ClientRegistry()


def say(client_registry: ClientRegistry, stamp: int | None, t_ns: int, user: str = "uid 1", name: str = "a") -> bool:
    return client_registry.is_newest(name, user, stamp, S, t_ns)


def test_an_older_message_is_overtaken_and_a_repeated_one_is_not(client_registry: ClientRegistry) -> None:
    assert [say(client_registry, stamp, 0) for stamp in (5, 7, 6, 7, 8, 0)] == [True, True, False, True, True, False]


def test_another_users_name_is_refused_with_a_sentence_until_it_is_forgotten(client_registry: ClientRegistry) -> None:
    assert say(client_registry, 9, 0, "uid 1")
    with pytest.raises(RequestError, match="name 'a' is in use by uid 1: choose another"):
        say(client_registry, 10, KEPT_NS - 1, "uid 2")
    assert say(client_registry, 1, KEPT_NS, "uid 2")  # and counts from its own first stamp
    with pytest.raises(RequestError, match="in use by uid 2"):
        say(client_registry, 10, KEPT_NS, "uid 1")


def test_a_name_lasts_as_long_as_the_targets_under_it(client_registry: ClientRegistry) -> None:
    client_registry.is_newest("a", "uid 1", 3, 4 * KEPT_NS, 0)
    assert client_registry.is_newest("a", "uid 1", 3, 0, 1)  # a later, shorter message does not shorten it
    assert not client_registry.is_newest("a", "uid 1", 2, 0, 4 * KEPT_NS - 1)
    assert client_registry.is_newest("a", "uid 1", 2, 0, 4 * KEPT_NS)


def test_invented_names_fill_no_more_than_their_room_and_spare_those_in_use(client_registry: ClientRegistry) -> None:
    say(client_registry, 1, 0, name="mine")
    for n in range(MAX_NAMES - 1):
        say(client_registry, 1, 0, "uid 666", f"invented-{n}")
    with pytest.raises(RequestError, match=f"{MAX_NAMES} client names"):
        say(client_registry, 1, 0, "uid 666", "one more")
    assert say(client_registry, 2, KEPT_NS - 1, name="mine")
    assert len(client_registry._clients) == MAX_NAMES
    assert say(client_registry, 1, KEPT_NS, "uid 2", "newcomer")
    assert not say(client_registry, 1, KEPT_NS, name="mine")  # the others were forgotten, this one was not
    assert len(client_registry._clients) == 2
