"""A library on a PostgreSQL server: its transactions, its two roles, and what goes wrong there in words."""
