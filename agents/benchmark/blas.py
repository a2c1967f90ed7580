"""One thread for BLAS, set when this is imported, which must be before numpy.

A comparison keeps every core busy with flights. BLAS would start as many threads for each network's matrix product,
which then wait for each other: a flight of `generalist` took ten times the processor time. The numbers are the same.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
