"""What aligned shapes say: Procrustes statistics, ordination, classification."""
