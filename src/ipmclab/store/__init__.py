"""Runs on disk: the run file, importers of foreign records, and exports."""
