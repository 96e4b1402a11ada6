"""Rig files: read, checked, written; the rigs that come along."""
