"""The database of a study: workers outlast a restart of its server."""

from __future__ import annotations

import time
import warnings
from contextlib import suppress
from typing import Any

from optuna.exceptions import ExperimentalWarning, StorageInternalError
from optuna.storages import RDBStorage, RetryHeartbeatStaleTrialCallback
from sqlalchemy import event

RETRIES = 3  # how often a trial that lost its worker is queued again
RESTART = 120  # seconds that workers wait for the server


class Database(RDBStorage):
    """Keep studies in a database whose server may restart. Each trial's worker sends heartbeats.

    Args:
        url: the database's address.
        heartbeat: seconds between heartbeats. After twice as many without one, a trial is failed and queued again.
    """

    def __init__(self, url: str, heartbeat: int) -> None:
        with warnings.catch_warnings(category=ExperimentalWarning, action="ignore"):
            super().__init__(
                url,
                engine_kwargs={"pool_pre_ping": True},  # a connection that a restart broke is replaced
                heartbeat_interval=heartbeat,
                grace_period=2 * heartbeat,
                heartbeat_stale_trial_callback=RetryHeartbeatStaleTrialCallback(max_retry=RETRIES),
            )
        event.listen(
            self.engine, "do_connect", connect_patiently
        )  # from now on: an address that is wrong fails at once

    def record_heartbeat(self, trial_id: int) -> None:
        """Record a heartbeat; leave one out if the server stops meanwhile. An error would end all later ones."""
        with suppress(StorageInternalError):
            super().record_heartbeat(trial_id)


def connect_patiently(dialect: Any, _record: Any, address: tuple[Any, ...], options: dict[str, Any]) -> Any:
    """Connect for SQLAlchemy, and wait while the server restarts.

    Raises:
        Exception: the driver's own, if the server is not back after ``RESTART`` seconds.
    """
    until = time.monotonic() + RESTART
    while True:
        try:
            return dialect.connect(*address, **options)
        except dialect.loaded_dbapi.OperationalError:
            if time.monotonic() > until:
                raise
            time.sleep(1)
