"""Campaigns: many tasks that do not depend on each other, played by processes of this machine or by a cluster.

`runner.Campaign` plays them, `engines` has the workers and repeats what a lost one had, `results` keeps what is done.
"""
