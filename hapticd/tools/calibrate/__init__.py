"""`hapticd calibrate`: steps from a plate on the bench to a configuration of the service.

One file per step, with a STEP by which the program finds it. Each has a pure part, numbers in and numbers out, and ends
in a verdict, a picture and a result file in one directory. The daemon imports none of it.
"""
