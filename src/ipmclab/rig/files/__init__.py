"""Rig files: read, checked, written; the rigs that are included."""
