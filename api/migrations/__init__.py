"""The database's history, run by Alembic in order."""
