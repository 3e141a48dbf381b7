"""The command line, and what it starts: the local mesh, the boards, measurements."""

INTERRUPTED = 130  # exit code of a program that a person has ended by hand
