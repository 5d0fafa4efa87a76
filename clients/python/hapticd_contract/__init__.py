"""The contract between clients and daemon: every message, content, effect, event, state and reply, written once.

Each is a `msgspec.Struct`: the value that the daemon's core takes, the decoder and encoder of its message, and the
source of JSON schemas (`clients/schema/write.py`) and of the tables in `clients/PROTOCOL.md`. Bounds are `Meta`; what a
struct cannot say, conditions between fields, is its `problem`. Units stand in the names: millimetres on the plate from
its centre, x to the right and y away from the user; micrometres peak to peak; instants in nanoseconds of the host's
monotonic clock.
"""
