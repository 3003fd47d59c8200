"""What is done in one transaction, one module an idea: plain functions over a connection."""
