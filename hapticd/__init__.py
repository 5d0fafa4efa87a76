"""hapticd: every finger on one vibrating glass plate gets its own friction.

Read `values.py` (the vocabulary), then `core/pipeline.py` (a touch's way), and you know the whole.
"""

from . import compiled

__version__ = "0.1.0"

compiled.choose()
