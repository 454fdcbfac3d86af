"""How work gets done: stages, jobs and the store. Knows nothing of shapes."""
