"""The stage of collections that deform: maps of all vertices between all shapes, consistent around cycles."""
