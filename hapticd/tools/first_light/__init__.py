"""`hapticd first-light`: guided commissioning of a rig, one page for each step."""
