"""Programs for controllers that run nothing else: written from a checked plan, read back and compared with it."""
