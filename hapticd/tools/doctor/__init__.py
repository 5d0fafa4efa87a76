"""`hapticd doctor`: what the service needs, one by one; each line passes, warns or fails, and says what mends it.

Nothing is changed, and nothing is kept open. Where no daemon runs, the trackpad is read for two seconds, and the board
is asked who it is.
"""

from .finding import FAIL, PASS, WARN, Finding
from .report import examine

__all__ = ["FAIL", "PASS", "WARN", "Finding", "examine"]
