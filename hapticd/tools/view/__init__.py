"""`hapticd view`: the plate on a page in the browser, served on this computer by a client of the daemon.

daemon --telemetry--> client (a thread) --frames--> server (asyncio) --websocket--> page
page --fingers, targets--> server --> the simulated rig's pad; the client --> daemon
"""
