"""Where a study's trials are kept, for all processes of all machines that reach the file or the database."""

from pathlib import Path
from typing import Any

from optuna.exceptions import StorageInternalError
from optuna.storages import BaseStorage, JournalStorage, RDBStorage
from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock
from sqlalchemy import URL, make_url
from sqlalchemy.exc import ArgumentError, IntegrityError, SQLAlchemyError

BUSY = 60.0
"""How long a SQLite file that another process writes is waited for [s]."""
_ATTEMPTS = 5


def opened(where: str) -> BaseStorage:
    """What is kept in a database, by its URL (``sqlite:///trials.db``, ``postgresql://host/name``), or in a journal, by its file.

    Raises:
        ValueError: it cannot be reached, read or written; says why.
    """
    return _database(where) if "://" in where else _journal(Path(where))


def shown(where: str) -> str:
    """As it is told to people: without a password.

    Raises:
        ValueError: it is neither a file nor a URL.
    """
    return str(_url(where)) if "://" in where else where


def _url(where: str) -> URL:
    try:
        return make_url(where)
    except (ArgumentError, ValueError) as error:
        raise ValueError("a study cannot be kept there: what is given is no database's URL") from error


def _database(where: str) -> RDBStorage:
    url = _url(where)
    # A database closes connections that are not used while an agent is trained.
    settings: dict[str, Any] = (
        {"connect_args": {"timeout": BUSY}} if url.get_backend_name() == "sqlite" else {"pool_pre_ping": True}
    )
    for attempt in range(1, _ATTEMPTS + 1):
        try:
            return RDBStorage(where, settings)
        except (SQLAlchemyError, StorageInternalError, ImportError, RuntimeError) as error:
            # Two that come to an empty database at the same time both make its tables, and one of them fails.
            made_meanwhile = isinstance(error, IntegrityError) or "already exists" in str(error)
            if not made_meanwhile or attempt == _ATTEMPTS:
                why = str(error).strip().splitlines()[0]
                raise ValueError(f"a study cannot be kept in {url}: {why}") from error  # it shows no password
    raise AssertionError


def _journal(path: Path) -> JournalStorage:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return JournalStorage(JournalFileBackend(str(path), JournalFileOpenLock(str(path))))
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:  # the latter of what is no journal
        raise ValueError(f"a study cannot be kept in {path}: {error}") from error
