"""What a fit asks: its unknowns, how each run reads them, and the least-squares problem that they make."""
