"""Benchmarks: side by side with the peers and with hand-written C, and the full Monte-Carlo counts.

This package is imported before numpy: OpenBLAS and OpenMP threads that spin between calls would
double the time of whatever runs next on a small machine.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
