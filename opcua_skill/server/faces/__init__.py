"""Faces: companion specifications in front of the one job engine. Each is a folder that only translates."""
