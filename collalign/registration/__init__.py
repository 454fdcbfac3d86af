"""Smooth registration of surfaces that are posed already: arrays in, frozen results out; no files, no processes."""
