"""What the OPC UA methods do: rights, call, answer. The rules themselves live in library, jobs and sim."""
