"""Work in processes of their own, so that the server never computes: with progress, and a way to cancel."""
