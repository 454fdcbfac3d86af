"""Whole collections."""
