"""What installs: versions, locked dependencies, and an install without a compiler."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

import inhalemon

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LOCKED = (ROOT / "requirements.lock").read_text(encoding="utf-8").splitlines()


def canonical(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def test_the_package_has_one_version():
    assert PROJECT["version"] == inhalemon.__version__


@pytest.mark.parametrize("line", LOCKED)
def test_the_lock_holds_names_and_versions_alone(line):
    assert re.fullmatch(r"[A-Za-z0-9._-]+==[0-9][A-Za-z0-9.!+]*", line)


def test_every_dependency_is_locked_once():
    wanted = [*PROJECT["dependencies"], *(one for extra in PROJECT["optional-dependencies"].values() for one in extra)]
    names = {canonical(re.match(r"[A-Za-z0-9._-]+", requirement)[0]) for requirement in wanted}
    locked = [canonical(line.split("==")[0]) for line in LOCKED]
    assert len(locked) == len(set(locked))
    assert names <= set(locked)
