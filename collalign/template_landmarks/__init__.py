"""Landmarks of a few specimens carried to all others: arrays in, frozen results out."""
