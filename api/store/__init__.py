"""All SQL of the service. Each module holds the statements on one kind of thing; none knows of HTTP.

Every function takes a connection from `Store.read()` or `Store.write()`, so that what belongs together (a deed and its
audit entry) is committed together.
"""

from sqlalchemy import Connection

from api.store.engine import Store

__all__ = ["Connection", "Store"]
