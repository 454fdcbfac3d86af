"""Surfaces of a result in dense correspondence with their mean."""
