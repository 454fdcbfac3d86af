"""What the stages hand to each other and to the user: frozen data, no logic."""
