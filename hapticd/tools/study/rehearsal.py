"""`--sim`: the service on the simulated plate, as a process, for a rehearsal without hardware."""

from __future__ import annotations

from ..daemon_process import DaemonProcess

SCENARIO = "virtual-finger"  # its one finger on the plate explores in strokes; the virtual one is the client's own
PATIENT = "[trackpad]\nsilence_ms = 1000\n"  # a computer that stalls must not lift the simulated finger


def rehearsal(scenario: str = SCENARIO) -> DaemonProcess:
    """A service with a simulated rig of its own, which says nothing into the study's terminal but errors."""
    return DaemonProcess(f'scenario = "{scenario}"', PATIENT, log_level="error")
