"""The plate in the browser: `hapticd view` serves one page on this computer, and is a client of the daemon's like any.

daemon --telemetry--> client (a thread) --frames--> server (asyncio) --websocket--> page
page --fingers, targets--> server --> the simulated rig's pad; the client --> daemon
"""
