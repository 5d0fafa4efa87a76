"""`hapticd service keys`: key pairs for the daemon and its remote clients, and the daemon's allow-list."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..io.clients import keys
from .arguments import add_command

RESTART = "restart hapticd to apply"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = (
        f"{parser.epilog}\n"
        "         hapticd service keys make . study-7\n"
        "         hapticd service keys allow /etc/hapticd/keys study-7.key"
    )
    actions = parser.add_subparsers(title="actions", required=True, metavar="ACTION")

    make = add_command(actions, "make", "make a pair: the daemon's, or with a NAME a client's", ". study-7")
    make.add_argument("directory", type=Path, metavar="DIR", help="folder for its two files")
    make.add_argument("name", nargs="?", default=keys.DAEMON_NAME, metavar="NAME", help="the client's name")
    make.set_defaults(command=_make)

    allow = add_command(actions, "allow", "admit the client with this public key", "/etc/hapticd/keys study-7.key")
    allow.add_argument("directory", type=Path, metavar="DIR", help="client.keys_dir of the daemon")
    allow.add_argument(
        "certificate", type=Path, metavar="NAME.key", help="its public key; the secret one stays with the client"
    )
    allow.set_defaults(command=_allow)

    revoke = add_command(actions, "revoke", "remove a client from the allow-list", "/etc/hapticd/keys study-7")
    revoke.add_argument("directory", type=Path, metavar="DIR", help="client.keys_dir of the daemon")
    revoke.add_argument("name", metavar="NAME", help="as `list` shows it")
    revoke.set_defaults(command=_revoke)

    show = add_command(actions, "list", "show the daemon's public key and the admitted clients", "/etc/hapticd/keys")
    show.add_argument("directory", type=Path, metavar="DIR", help="client.keys_dir of the daemon")
    show.set_defaults(command=_list)


def _make(options: argparse.Namespace) -> None:
    public, secret = keys.make_pair(options.directory, options.name)
    print(f"{public}: public, to distribute\n{secret}: secret, to keep")


def _allow(options: argparse.Namespace) -> None:
    print(f"{keys.allow(options.directory, options.certificate)}: allowed; {RESTART}")


def _revoke(options: argparse.Namespace) -> None:
    keys.revoke(options.directory, options.name)
    print(f"{options.name}: revoked; {RESTART}")


def _list(options: argparse.Namespace) -> None:
    own = options.directory / f"{keys.DAEMON_NAME}.key"
    print(f"{keys.DAEMON_NAME:<32} {keys.read_pair(own)[0].decode() if own.is_file() else 'no key yet'}")
    for public, name in sorted(keys.allowed(options.directory).items(), key=lambda entry: entry[1]):
        print(f"{name:<32} {public}")
