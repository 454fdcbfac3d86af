"""PM-SDP and its dual interior-point solver."""
