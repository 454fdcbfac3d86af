"""What all commands share: what they print, how they end, and the arguments that several have."""
