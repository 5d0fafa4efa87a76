"""The boards whose images are under test."""

from __future__ import annotations

import pytest

from . import image
from .stm32f405 import F405
from .stm32g474 import G474
from .stm32h743 import H743

BOARDS = (F405, G474, H743)
every_board = pytest.mark.parametrize("board", BOARDS, ids=str)
needs_compiler = pytest.mark.skipif(image.MISSING is not None, reason=str(image.MISSING))
