"""hapticd: every finger on one vibrating glass plate gets its own friction.

Read `values.py` (the vocabulary), then `core/pipeline.py` (a touch's way), and you know the whole.
"""

import os

from . import compiled

__version__ = "0.2.0"  # pyproject.toml reads it here

# Before numpy is loaded: no array here is large enough for threads of its own, and on a busy host they only spin. Here
# and not in a command, because the rig and other child processes have entry points of their own.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

compiled.choose()
