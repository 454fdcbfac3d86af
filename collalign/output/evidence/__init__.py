"""What the report and the exports are made of, as gathered from a run and as kept in a file."""
