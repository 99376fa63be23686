"""`python -m api`: serve, and what an operator does beside it."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Annotated

import typer

from api import operations
from api.moments import to_iso
from api.principal import Role, Scope
from api.problems import ConfigurationError, ProblemError
from api.settings import load, unknown_variables

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, help=__doc__)

_SLUG = r"[a-z0-9][a-z0-9-]{0,62}"


def _say(text: str = "") -> None:
    typer.echo(text)


def _note(text: str) -> None:
    typer.echo(text, err=True)


def _slug(given: str) -> str:
    if not re.fullmatch(_SLUG, given):
        raise typer.BadParameter(f"{given!r}: lower-case letters, digits and hyphens are wanted")
    return given


Clinic = Annotated[str, typer.Option("--clinic", help="its short name, such as north", callback=_slug)]
RoleOption = Annotated[Role, typer.Option("--role")]


@app.command()
def serve(
    host: Annotated[str | None, typer.Option(help="address to listen at")] = None,
    port: Annotated[int | None, typer.Option(help="0 takes any free one")] = None,
    data_dir: Annotated[Path | None, typer.Option(help="where everything is kept")] = None,
    with_samples: Annotated[bool, typer.Option("--with-samples", help="load the sample sessions")] = False,
) -> None:
    """Start the service: makes the data folder, brings the database up to date, opens the review pages."""
    from api.serving import run  # noqa: PLC0415  # the other commands need no web server

    given = {"host": host, "port": port, "data_dir": data_dir}
    run(load(**{name: value for name, value in given.items() if value is not None}), with_samples=with_samples)


@app.command()
def migrate() -> None:
    """Bring the database to the present schema."""
    from api.store import schema  # noqa: PLC0415

    with operations.opened(load()) as service:
        _say(f"The database is at schema {schema.present(service.store)}.")


@app.command("add-clinic")
def add_clinic(slug: Annotated[str, typer.Argument(callback=_slug)]) -> None:
    """Add a clinic."""
    with operations.opened(load()) as service:
        is_new = operations.add_clinic(service, slug)
    _say(f"Clinic {slug} {'was added' if is_new else 'is there already'}.")


@app.command("add-user")
def add_user(
    name: str,
    role: RoleOption,
    clinic: Annotated[list[str], typer.Option(help="repeat it for a pharmacist with several")],
    password_stdin: Annotated[bool, typer.Option(help="read the password from standard input")] = False,
) -> None:
    """Add a person, and print a one-time password on the last line."""
    clinics = [_slug(each) for each in clinic]
    password = sys.stdin.readline().rstrip("\n") if password_stdin else None
    with operations.opened(load()) as service:
        one_time = operations.add_user(service, name, role, clinics, password)
    _note(f"{name} is {role} at {', '.join(clinics)}.")
    if one_time is not None:
        _note("One-time password, to be changed at the first login:")
        _say(one_time)


@app.command("users")
def users() -> None:
    """List everybody: name, role, clinics, whether locked out, last login."""
    with operations.existing(load()) as service:
        for user in operations.every_user(service):
            state = "active" if user.is_active else "locked out"
            last = "never" if user.last_login_us is None else to_iso(user.last_login_us)[:16]
            _say(f"{user.name}\t{user.role}\t{','.join(user.clinics)}\t{state}\tlast login {last}")


@app.command("lock-user")
def lock_user(name: str) -> None:
    """Lock somebody out of every clinic, and end their logins."""
    with operations.existing(load()) as service:
        operations.set_active(service, name, is_active=False)
    _say(f"{name} is locked out.")


@app.command("unlock-user")
def unlock_user(name: str) -> None:
    """Let somebody in again."""
    with operations.existing(load()) as service:
        operations.set_active(service, name, is_active=True)
    _say(f"{name} can log in.")


@app.command("reset-password")
def reset_password(name: str) -> None:
    """Give somebody a new one-time password, printed on the last line, and end their logins."""
    with operations.existing(load()) as service:
        one_time = operations.reset_password(service, name)
    _note("One-time password, to be changed at the first login:")
    _say(one_time)


@app.command("assign-clinic")
def assign_clinic(name: str, clinic: Annotated[str, typer.Argument(callback=_slug)]) -> None:
    """Give a pharmacist one more clinic."""
    with operations.existing(load()) as service:
        operations.assign_clinic(service, name, clinic)
    _say(f"{name} has {clinic}.")


@app.command("withdraw-clinic")
def withdraw_clinic(name: str, clinic: Annotated[str, typer.Argument(callback=_slug)]) -> None:
    """Take one of several clinics from a pharmacist."""
    with operations.existing(load()) as service:
        operations.withdraw_clinic(service, name, clinic)
    _say(f"{name} no longer has {clinic}.")


@app.command("add-key")
def add_key(
    clinic: Clinic,
    role: RoleOption,
    label: Annotated[str, typer.Option(help="what it is for")] = "",
    scope: Annotated[list[Scope] | None, typer.Option(help="fewer than the role's; repeat it")] = None,
    days: Annotated[float | None, typer.Option(help="until it runs out")] = None,
) -> None:
    """Make an API key, and print it alone on the last line. It cannot be shown again."""
    scopes = frozenset(scope) if scope else None
    with operations.opened(load()) as service:
        made = operations.add_key(service, clinic, role, scopes=scopes, label=label, days=days)
    _note(f"Key {made.prefix} of clinic {clinic}, {role}. Send it as: Authorization: Bearer KEY")
    _say(made.key)


@app.command()
def backup(target: Annotated[Path, typer.Argument(help="a new file, such as inhalemon-2026-11-20.tar")]) -> None:
    """Write database, recordings and secret to one archive; the service may go on running."""
    from api import upkeep  # noqa: PLC0415

    with operations.existing(load(), at_any_schema=True) as service:
        n_recordings = upkeep.back_up(service, target)
    _say(f"{target} holds the database and {n_recordings} recordings. It is as confidential as the service itself.")


@app.command()
def restore(source: Annotated[Path, typer.Argument(exists=True, dir_okay=False)]) -> None:
    """Bring an archive back into an empty data folder (and an empty database)."""
    from api import upkeep  # noqa: PLC0415

    settings = load()
    upkeep.restore(settings, source)
    with operations.opened(settings) as service:
        found = list(upkeep.faults(service))
    for fault in found:
        _note(fault)
    _say(f"{source} was restored to {settings.data_dir}; {len(found) or 'no'} faults found.")
    raise typer.Exit(1 if found else 0)


@app.command()
def verify() -> None:
    """Check every recording's digest and every clinic's audit chain; 1 when something is wrong."""
    from api import upkeep  # noqa: PLC0415

    with operations.existing(load()) as service:
        found = list(upkeep.faults(service))
    for fault in found:
        _say(fault)
    _say(f"{len(found) or 'No'} faults found.")
    raise typer.Exit(1 if found else 0)


@app.command()
def doctor() -> None:
    """Look whether the service has what it needs; 1 when something wants attention."""
    from api import upkeep  # noqa: PLC0415

    with operations.existing(load(), at_any_schema=True) as service:
        found = list(upkeep.advice(service))
    for is_well, told in found:
        _say(f"{'ok    ' if is_well else 'LOOK  '} {told}")
    raise typer.Exit(0 if all(is_well for is_well, _ in found) else 1)


def main() -> None:
    """Run the command line: 0 done, 1 refused, 2 usage, 4 bad settings."""
    for name in unknown_variables():
        _note(f"Nobody reads the variable {name}; is it misspelt?")
    try:
        app()
    except ConfigurationError as error:
        _note(f"Settings: {error}")
        raise SystemExit(4) from error
    except ProblemError as error:
        _note(f"{error.title}: {error.detail}")
        raise SystemExit(1) from error
    except OSError as error:  # such as a data folder on a disk that cannot be written to
        _note(f"Settings: {error.filename or 'the system'}: {error.strerror or error}")
        raise SystemExit(4) from error


if __name__ == "__main__":
    main()
