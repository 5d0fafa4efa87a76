"""Panel in a terminal: the letters of a screen's keys, without Enter; Enter continues."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from typing import Any, TextIO

from .panel import Screen

READ_SIZE = 256


class Keyboard:
    """Context manager that reads single keys, and restores the terminal at the end.

    Standard input need not be a terminal; its end ends the session.
    """

    def __init__(self, out: TextIO, fd: int | None = None) -> None:
        self._out = out
        self._fd = sys.stdin.fileno() if fd is None else fd
        self._screen: Screen | None = None
        self._is_terminal = os.isatty(self._fd)
        self._before: list[Any] = []
        self._waiting = ""
        self._noted = ""

    def __enter__(self) -> Keyboard:
        if self._is_terminal:
            self._before = termios.tcgetattr(self._fd)
            tty.setcbreak(self._fd)
        return self

    def __exit__(self, *_: object) -> None:
        if self._is_terminal:
            termios.tcsetattr(self._fd, termios.TCSADRAIN, self._before)

    def show(self, screen: Screen) -> None:
        if screen == self._screen:
            return
        self._screen = screen
        if self._is_terminal:  # keys typed before the screen do not count on it
            termios.tcflush(self._fd, termios.TCIFLUSH)
            self._waiting = ""
        if self._noted:
            self._out.write("\n")
            self._noted = ""
        keys = "   ".join(f"[{key.letter.capitalize()}] {key.label}" for key in screen.keys)
        self._out.write("\n".join(["", screen.heading, screen.text, *([keys] if keys else [])]) + "\n")
        self._out.flush()

    def note(self, text: str) -> None:
        if self._is_terminal and text != self._noted:
            self._noted = text
            self._out.write(f"\r\x1b[K{text}")
            self._out.flush()

    def pressed(self) -> str | None:
        if not self._waiting and select.select([self._fd], [], [], 0)[0]:
            data = os.read(self._fd, READ_SIZE)
            if not data:
                raise KeyboardInterrupt  # end of input: no further key
            self._waiting = data.decode("ascii", "replace").lower()
        while self._waiting and self._screen is not None:
            letter, self._waiting = self._waiting[0], self._waiting[1:]
            key = self._screen.typed("enter" if letter in "\r\n" else letter)
            if key is not None:
                return key
        return None
