"""The host's side of the board protocol: session, clock synchronisation, send window, ledger, supervisor."""
