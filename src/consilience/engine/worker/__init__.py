"""Protocol between the runner and its workers, both sides of it, and the environments of workers.

`wire`, `codec`, `requests` and `server` are the worker side: they import NumPy and the standard library alone, so that
a worker can run in an environment with one engine and nothing else (docs/workers.md).
"""
