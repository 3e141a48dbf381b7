"""What every process of the mesh finds in its environment, whoever starts it."""

from __future__ import annotations

# One thread per library, since few cores are shared by all; and what was needed for a moment goes back to the system:
# the C library's own threshold would grow with the largest of it, and its arenas with the number of threads
PROCESS_ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MALLOC_ARENA_MAX": "2",
    "MALLOC_MMAP_THRESHOLD_": "131072",
    "MALLOC_TRIM_THRESHOLD_": "1000000",
}
