"""From pairs that partly contradict each other to one pose per shape."""
