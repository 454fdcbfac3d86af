"""Maps between all shapes of a collection that agree around its cycles."""
