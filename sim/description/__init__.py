"""Arms as strangers bring them: read without trust, everything odd told, and a first limits file proposed."""
