"""The parts of one running service, held together: what the application gives to every endpoint."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from api import secrets
from api.cache import SeriesCache
from api.files import RawFiles
from api.hashing import Hashing
from api.jobs import Pool
from api.limits import RateLimit
from api.metrics import Metrics
from api.settings import ServiceSettings
from api.store import Store
from api.store.audit import AuditLog
from inhalemon.rules import RuleSet, load_rules

_FIVE_MINUTES_S = 300.0
_NAMES_PER_ADDRESS = 10  # a whole clinic may come from one address


@dataclass(frozen=True, slots=True)
class Limits:
    """Who may try how often."""

    logins: RateLimit  # by name and address
    addresses: RateLimit  # logins by address, whatever the name
    keys: RateLimit
    bad_keys: RateLimit


class Service:
    """Settings, database, files, workers."""

    def __init__(self, settings: ServiceSettings, *, owns_checkpoints: bool = True) -> None:
        self.settings = settings
        settings.data_dir.mkdir(mode=0o700, parents=True, exist_ok=True)
        self.secret = secrets.load(settings)
        self.store = Store(settings.database, owns_checkpoints=owns_checkpoints)
        self.files = RawFiles(settings.data_dir / "raw", min_free_bytes=settings.min_free_bytes)
        self.cache = SeriesCache(settings.data_dir / "cache", max_bytes=settings.cache_bytes)
        self.audit = AuditLog(self.secret.key("audit"))
        self.metrics = Metrics()
        self.hashing = Hashing()
        self.versions: dict[str, str] = {}  # of the pipeline, once a worker has told
        self.limits = Limits(
            logins=RateLimit(settings.login_attempts, _FIVE_MINUTES_S, "Too many failed logins; wait a little."),
            addresses=RateLimit(
                _NAMES_PER_ADDRESS * settings.login_attempts, _FIVE_MINUTES_S, "Too many failed logins; wait a little."
            ),
            keys=RateLimit(settings.key_requests_per_minute, 60.0, "This key asks too often; slow down."),
            bad_keys=RateLimit(30, 60.0, "Too many wrong keys from this address; wait a little."),
        )

    @cached_property
    def pool(self) -> Pool:
        """The workers; made within the event loop that runs them."""
        return Pool(
            self.settings.workers,
            max_waiting=self.settings.max_waiting,
            deadline_s=self.settings.score_deadline_s,
            memory_bytes=self.settings.worker_memory_bytes,
        )

    @cached_property
    def rules(self) -> RuleSet:
        """The profile that the workers score by."""
        return load_rules(self.settings.scoring_rules)

    def close(self) -> None:
        self.hashing.close()
        self.store.close()
