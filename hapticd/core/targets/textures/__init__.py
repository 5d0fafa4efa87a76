"""Textures: what a target asks for as a function of place, one file for each class of target."""
