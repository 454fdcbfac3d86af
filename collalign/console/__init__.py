"""What all commands share: how they speak, how they end, and the arguments that several have."""
