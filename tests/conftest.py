"""Workers share the cores among them: linear algebra takes one thread in each."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
