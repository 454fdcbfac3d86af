"""What the stages hand to each other and to the user: frozen data, which compute nothing but what they hold."""
