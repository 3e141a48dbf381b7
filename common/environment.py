"""What every process of the mesh finds in its environment, whoever starts it."""

from __future__ import annotations

# One thread per library, since all processes share few cores; and freed memory goes back to the system: by default the
# C library's threshold grows with the largest block, and the number of arenas with the number of threads
PROCESS_ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MALLOC_ARENA_MAX": "2",
    "MALLOC_MMAP_THRESHOLD_": "131072",
    "MALLOC_TRIM_THRESHOLD_": "1000000",
}
