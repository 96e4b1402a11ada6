"""NI-DAQmx behind the NI bench: its tasks, its errors, its connection."""
