"""What commands that take long have in common: a log on stderr, and a cluster to work on."""

from __future__ import annotations

import logging
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING

from consilience.errors import InvalidInput, visible

if TYPE_CHECKING:
    from consilience.suite.cluster import Cluster


class _Visible(logging.Formatter):
    """A line for each message, whatever an engine put into it."""

    def format(self, record: logging.LogRecord) -> str:
        return visible(super().format(record)).replace("\n", "\\n")


def log_to_stderr() -> None:
    """Say what workers and the schedule do, and when."""
    handler = logging.StreamHandler()
    handler.setFormatter(_Visible("%(asctime)s.%(msecs)03d %(message)s", "%H:%M:%S"))
    log = logging.getLogger("consilience")
    log.setLevel(logging.DEBUG)
    log.handlers = [handler]


def cluster_of(address: str | None) -> AbstractContextManager[Cluster | None]:
    """Connect to a scheduler, if one is named.

    Raises
    ------
    InvalidInput
        If Dask is not installed.
    ClusterError
        If nobody answers there.
    """
    if address is None:
        return nullcontext()
    try:
        from consilience.suite.cluster import Cluster  # noqa: PLC0415 - an extra: only a cluster needs it
    except ModuleNotFoundError as error:
        if error.name != "distributed":
            raise
        raise InvalidInput("--scheduler", "Dask is not installed", "Install consilience[cluster].") from None
    return Cluster(address)
