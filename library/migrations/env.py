"""Alembic's entry: runs the steps on the connection, and in the transaction, that the library opened."""

from alembic import context

from library.tables import metadata

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=metadata,
    # SQLite changes a column by copying its table; triggers are lost with the old one, so such a step renews them.
    render_as_batch=True,
)
with context.begin_transaction():
    context.run_migrations()
