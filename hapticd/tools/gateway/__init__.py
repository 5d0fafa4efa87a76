"""`hapticd gateway`: the client protocol as JSON, for whatever has a WebSocket.

page, program --targets, requests--> peer (one per WebSocket) --its own ZeroMQ sockets--> daemon
daemon --replies--> peer; --telemetry--> shared_daemon --states--> the peers that follow
"""
