"""The protocol between the runner and its workers, the worker side of it, and the environments workers live in.

`frames`, `codec`, `jobs` and `serve` are the worker side: NumPy and the standard library alone, so that a worker can
live in an environment that holds one engine and nothing else (docs/workers.md).
"""
