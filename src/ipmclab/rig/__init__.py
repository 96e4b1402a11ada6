"""The rig: what applies a signal to a strip and reads the response, real or virtual."""
