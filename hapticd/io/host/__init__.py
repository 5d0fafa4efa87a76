"""Operating-system services: real-time scheduling, CPU latency, systemd, the journal."""
