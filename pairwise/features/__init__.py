"""Local evidence: poses on which descriptors of small neighbourhoods agree, and how much two surfaces overlap."""
