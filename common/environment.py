"""What every process of the mesh finds in its environment, whoever starts it."""

from __future__ import annotations

# Closing a link that is gone holds a thread of Zenoh for as long as ten seconds: TCP waits (SO_LINGER) for what nobody
# acknowledges any more. Zenoh's five pools have one or two threads each, and when those are held up nothing is received
# from anyone. Hence one pool for everything, with threads for all links that may go at once
_ZENOH_RUNTIME = "(app:(worker_threads:8),rx:(handover:app),acc:(handover:app),tx:(handover:app),net:(handover:app))"

# One thread per library, since all processes share few cores; and freed memory goes back to the system: by default the
# C library's threshold grows with the largest block, and the number of arenas with the number of threads
PROCESS_ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MALLOC_ARENA_MAX": "2",
    "MALLOC_MMAP_THRESHOLD_": "131072",
    "MALLOC_TRIM_THRESHOLD_": "1000000",
    "ZENOH_RUNTIME": _ZENOH_RUNTIME,
}
