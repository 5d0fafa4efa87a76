"""Client sockets: ZeroMQ over ipc and TCP, keys, rate limits, the runtime directory, the recorder's socket."""
