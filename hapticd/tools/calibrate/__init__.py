"""From a plate on the bench to a configuration: what `hapticd calibrate` and `hapticd plate` do.

One file a step; each has a pure part, numbers in and numbers out, and ends in a verdict, a picture and a result file
in one directory. The daemon needs none of it.
"""
