"""Alembic's entry: run the migrations on the connection, and in the transaction, that the record opened."""

from alembic import context

from meshdeform.record.schema import metadata

context.configure(connection=context.config.attributes["connection"], target_metadata=metadata)
context.run_migrations()
