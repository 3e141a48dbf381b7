"""The parts of the screen. Each is given a `Snapshot` and rewrites only what changed in it."""
