"""`hapticd demo`: the whole system on the simulated plate, in real time, judged afterwards."""
