"""Poses refined and ranked on dense points."""
