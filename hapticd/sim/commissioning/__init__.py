"""A bench on which mistakes were made: its rig, and a technician who reads, pulls and mends."""
