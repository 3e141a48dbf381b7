"""What every process of the mesh finds in its environment, whoever starts it."""

from __future__ import annotations

# One pool of threads for all that Zenoh receives, instead of three with one or two each. A link that breaks off in its
# handshake may hold up who closes it for ten seconds (`zenoh_links.let_go_at_once` reaches those that stand), and
# while all threads of a pool are held up nothing is received from anyone. What is sent has threads of its own: it must
# keep the links up while a process computes and those that receive wait for the interpreter
_ZENOH_RUNTIME = (
    "(app:(worker_threads:8),rx:(handover:app),acc:(handover:app),net:(handover:app),tx:(worker_threads:2))"
)

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
