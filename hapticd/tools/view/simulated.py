"""Simulated plate of `hapticd view --sim`: a service of its own, which a page can restart with another plate."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from ...config.keys import toml
from ...config.sections import LEAST_MODES, PLATE_NAMES, SimConfig
from ...sim.plate.glasses import driven_modes, most_driven
from ...sim.rig.process import watch
from ..daemon_process import PATIENT, DaemonProcess
from .messages import PlateChoice, SwitchPlate


class SimulatedService(DaemonProcess):
    """Context manager of a service on a simulated plate.

    When the plate is switched, fingers and `seed` stay, and each mode gets an amplifier of its own. `choices` are
    the plates with a name, and the first one, which is `first` with its number of modes.
    """

    def __init__(self, sim: SimConfig) -> None:
        self._fixed = f'scenario = "{sim.scenario}"\nseed = {sim.seed}\nfingers_file = {toml(sim.fingers_file)}\n'
        super().__init__(f'{self._plate(sim.plate, sim.modes)}\nwiring = "{sim.wiring}"', PATIENT)
        self._switching = asyncio.Lock()
        self.first = sim.plate, driven_modes(sim.plate, sim.modes)
        self.choices = {name: _choice(name) for name in dict.fromkeys((*PLATE_NAMES, sim.plate))}
        self._on_end: Callable[[], None] = lambda: None

    def watch(self, on_end: Callable[[], None]) -> None:
        """Call `on_end`, on the running loop, if the service ends by itself or is killed."""
        self._on_end = on_end
        watch(self.process, on_end)

    async def switch(self, to: SwitchPlate) -> None:
        """Restart the service with another plate, number of modes, or contact radius; clients reconnect."""
        async with self._switching:
            assert self.process.stdout is not None
            asyncio.get_running_loop().remove_reader(self.process.stdout)
            radius = f"[solver]\ncontact_radius_mm = {to.contact_radius_mm!r}\n"
            await asyncio.to_thread(self.restart, self._plate(to.plate, to.modes), PATIENT + radius)
            watch(self.process, self._on_end)

    def _plate(self, plate: str, modes: int) -> str:
        return f'{self._fixed}plate = "{plate}"\nmodes = {modes}'


def _choice(plate: str) -> PlateChoice:
    return PlateChoice(tuple(range(LEAST_MODES, most_driven(plate) + 1)), driven_modes(plate))
