"""The capture of one run: zeros, requests, scaling, where its rows go."""
