"""What every process of the mesh finds in its environment, whoever starts it."""

from __future__ import annotations

# One pool of threads instead of Zenoh's five with one or two each. A link that breaks off in its handshake may hold up
# who closes it for ten seconds (`zenoh_session.let_go_at_once` reaches only those that stand), and while that thread is
# the only one of its pool nothing is received from anyone
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
