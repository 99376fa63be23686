"""The database: schema, append-only audit, what survives."""

from __future__ import annotations

import contextlib

import pytest
from sqlalchemy import text
from sqlalchemy.exc import DBAPIError

from api.store import schema


def test_the_migrations_make_the_tables_that_the_statements_use(server):
    assert schema.differences(server.service.store) == []
    assert schema.present(server.service.store) == schema.newest()


def test_every_deed_and_every_look_is_in_the_audit_and_the_chain_is_whole(clinic, upload):
    session = upload(clinic, seed=30, patient_ref="P-77")["id"]
    reader, boss = clinic.client("clinician"), clinic.client("administrator")
    for path in ("", "/report", "/recording", "/reviews"):
        assert reader.get(f"/v1/sessions/{session}{path}").status_code == 200
    page = boss.get("/v1/audit", params={"limit": 200})
    entries = page.json()["items"]
    told = [each["action"] for each in entries if each["subject"] == session]
    assert told[::-1] == [
        "session.uploaded",
        "session.scored",
        "session.read",
        "report.read",
        "recording.read",
        "reviews.read",
    ]
    assert all(each["actor"].startswith("key:") for each in entries if each["subject"] == session)
    assert "P-77" not in page.text
    (check,) = boss.get("/v1/audit/verify").json()
    assert check["faults"] == []
    assert check["entries"] >= len(entries)


def test_the_audit_is_paged_without_gap_or_repeat(clinic):
    boss = clinic.client("administrator")
    for _ in range(5):
        boss.get("/v1/users")
        boss.get("/v1/sessions")
    numbers, cursor = [], None
    while True:
        page = boss.get("/v1/audit", params={"limit": 3, **({"cursor": cursor} if cursor else {})}).json()
        numbers += [each["seq"] for each in page["items"]]
        cursor = page["next"]
        if cursor is None:
            break
    assert numbers == list(range(numbers[0], 0, -1))


@pytest.mark.parametrize("deed", ["UPDATE audit SET action = 'nothing'", "DELETE FROM audit"])
def test_the_database_itself_refuses_to_change_the_audit(server, clinic, deed):
    with pytest.raises(DBAPIError, match="append-only"), server.service.store.write() as connection:
        connection.execute(text(f"{deed} WHERE clinic_id = :clinic"), {"clinic": clinic.id})


@pytest.mark.parametrize(
    "deed",
    [
        "UPDATE audit SET actor = 'user:somebody-else' WHERE clinic_id = :clinic AND seq = 2",
        "DELETE FROM audit WHERE clinic_id = :clinic AND seq = 2",
        "DELETE FROM audit WHERE clinic_id = :clinic AND seq = (SELECT max(seq) FROM audit WHERE clinic_id = :clinic)",
    ],
)
def test_a_changed_audit_is_found_even_when_the_triggers_were_removed(server, clinic, deed):
    clinic.client("administrator").get("/v1/sessions")
    with contextlib.suppress(_UndoError), server.service.store.write() as connection:
        if server.service.store.is_sqlite:
            for name in ("audit_no_update", "audit_no_delete"):
                connection.execute(text(f"DROP TRIGGER {name}"))
        else:
            connection.execute(text("DROP TRIGGER audit_append_only ON audit"))
        assert server.service.audit.faults(connection, clinic.id) == []
        connection.execute(text(deed), {"clinic": clinic.id})
        assert server.service.audit.faults(connection, clinic.id) != []
        raise _UndoError  # the others' tests want their triggers


class _UndoError(Exception):
    pass


def test_an_error_takes_back_everything_of_its_transaction(server, clinic):
    def count():
        with server.service.store.read() as connection:
            return connection.scalar(text("SELECT count(*) FROM audit WHERE clinic_id = :c"), {"c": clinic.id})

    before = count()
    with contextlib.suppress(_UndoError), server.service.store.write() as connection:
        server.service.audit.record(connection, clinic.id, "test", "nothing")
        raise _UndoError
    assert count() == before
