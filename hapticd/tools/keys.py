"""`hapticd keys`: key pairs for the daemon and its clients on other machines, and the list of those it lets in."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import zmq.auth

from ..io.clients import keys

RESTART = "restart hapticd for it to count"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The subcommands: make, allow, revoke, list."""
    parser.epilog = (
        f"{parser.epilog}\n"
        "         hapticd keys make . study-7\n"
        "         hapticd keys allow /etc/hapticd/keys study-7.key"
    )
    actions = parser.add_subparsers(title="actions", required=True, metavar="ACTION")

    make = _action(actions, "make", "make a pair: the daemon's, or with a NAME a client's", ". study-7")
    make.add_argument("directory", type=Path, metavar="DIR", help="where its two files go")
    make.add_argument("name", nargs="?", default=keys.DAEMON_NAME, metavar="NAME", help="what the daemon will call it")
    make.set_defaults(command=_make)

    allow = _action(actions, "allow", "let the client with this public key in", "/etc/hapticd/keys study-7.key")
    allow.add_argument("directory", type=Path, metavar="DIR", help="client.keys_dir of the daemon")
    allow.add_argument("certificate", type=Path, metavar="NAME.key", help="its public half; the secret stays with it")
    allow.set_defaults(command=_allow)

    revoke = _action(actions, "revoke", "let a client in no more", "/etc/hapticd/keys study-7")
    revoke.add_argument("directory", type=Path, metavar="DIR", help="client.keys_dir of the daemon")
    revoke.add_argument("name", metavar="NAME", help="as `list` shows it")
    revoke.set_defaults(command=_revoke)

    show = _action(actions, "list", "show the daemon's public key and who is let in", "/etc/hapticd/keys")
    show.add_argument("directory", type=Path, metavar="DIR", help="client.keys_dir of the daemon")
    show.set_defaults(command=_list)


def _action(actions: Any, name: str, summary: str, example: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = actions.add_parser(
        name,
        help=summary,
        description=f"{summary[0].upper()}{summary[1:]}.",
        epilog=f"example: hapticd keys {name} {example}",
    )
    return parser


def _make(options: argparse.Namespace) -> None:
    public, secret = keys.make_pair(options.directory, options.name)
    print(f"{public}: to give away\n{secret}: to keep")


def _allow(options: argparse.Namespace) -> None:
    print(f"{keys.allow(options.directory, options.certificate)}: allowed; {RESTART}")


def _revoke(options: argparse.Namespace) -> None:
    keys.revoke(options.directory, options.name)
    print(f"{options.name}: revoked; {RESTART}")


def _list(options: argparse.Namespace) -> None:
    own = options.directory / f"{keys.DAEMON_NAME}.key"
    print(f"{keys.DAEMON_NAME:<32} {zmq.auth.load_certificate(own)[0].decode() if own.is_file() else 'no key yet'}")
    for public, name in sorted(keys.allowed(options.directory).items(), key=lambda entry: entry[1]):
        print(f"{name:<32} {public}")
