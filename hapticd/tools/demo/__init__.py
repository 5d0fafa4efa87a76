"""`hapticd demo`: the whole system on the simulated plate, in real time, scored at the end."""
