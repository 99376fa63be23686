"""Counters and durations for Prometheus; none carries anything of a patient or a clinic."""

from __future__ import annotations

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest


class Metrics:
    """One registry a service, so that several can live in one process."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        buckets = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0)
        self.requests = Histogram(
            "inhalemon_request_seconds",
            "Duration of requests",
            ["method", "route", "status"],
            registry=self.registry,
            buckets=buckets,
        )
        self.scorings = Histogram(
            "inhalemon_scoring_seconds",
            "Duration of scoring, waiting included",
            ["outcome"],
            registry=self.registry,
            buckets=buckets,
        )
        self.uploads = Counter("inhalemon_uploads", "Recordings received", ["outcome"], registry=self.registry)
        self.upload_bytes = Counter("inhalemon_upload_bytes", "Bytes of recordings", registry=self.registry)
        self.sessions = Gauge("inhalemon_sessions", "Sessions kept, by state", ["state"], registry=self.registry)
        self.waiting = Gauge("inhalemon_jobs_waiting", "Jobs waiting for a worker", registry=self.registry)
        self.crashes = Gauge("inhalemon_worker_crashes", "Workers that died since the start", registry=self.registry)

    def text(self) -> bytes:
        """In Prometheus' text format."""
        return generate_latest(self.registry)
