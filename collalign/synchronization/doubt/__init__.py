"""How far synchronized poses can be trusted."""
