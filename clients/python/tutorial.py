"""A tutorial: read it from top to bottom, and run it as it is.

    hapticd run --sim --scenario hands &
    python clients/python/tutorial.py

It brings a finger of its own, so it needs neither a plate nor hands. `hapticd view` shows what it does.
"""

from __future__ import annotations

from hapticd_client import Client, FingerState, OnEntering, PlateState, Pulse, Rectangle
from hapticd_client.sim import Finger

# 1. A client finds the service that runs on this computer. Everything that it sets ends with it.
plate = Client(name="tutorial", timeout_s=30.0)  # it may just be starting
body = plate.plate()
width_mm, height_mm = body["size_mm"]
print(f"1. A plate of {width_mm:g} x {height_mm:g} mm with {body['modes']} modes.")

# 2. On the simulated plate a program can bring fingers. On a real one they are yours: leave these two lines out.
hand = Finger(plate)
hand.land(-30.0, 10.0)


def touched() -> tuple[PlateState, FingerState]:
    """Wait for a state with one finger: a scenario's have lifted. States come some ninety times a second."""
    for state in plate.states(timeout_s=30.0):
        if len(state.fingers) == 1:
            return state, state.fingers[0]
    raise SystemExit("the service has ended")


_, finger = touched()
print(f"2. Finger {finger.id} landed at ({finger.x_mm:.0f}, {finger.y_mm:.0f}) mm.")

# 3. A finger feels what it is asked to: 1 is bare glass, 0 the most slippery. Vibration makes it slippery.
plate.set(finger, friction=0.2)
for state in plate.states(timeout_s=30.0):
    mine = [one for one in state.fingers if one.id == finger.id]
    if mine and mine[0].achieved_um is not None and mine[0].achieved_um > 0.5:
        print(f"3. Friction 0.2 takes {mine[0].target_um:.1f} um of vibration; it gets {mine[0].achieved_um:.1f} um.")
        break

# 4. What lies on the plate is felt by whoever touches it, without a target of its own: a slippery track with a ridge.
plate.release(finger)
plate.surface("track", Rectangle(100.0, 30.0), friction=0.2)
plate.surface("ridge", Rectangle(6.0, 30.0), friction=1.0, z=1)
asked = []
for x_mm in (-20.0, 0.0, 20.0):
    hand.move((x_mm, 10.0))
    for state in plate.states(timeout_s=30.0):
        if state.fingers and abs(state.fingers[0].x_mm - x_mm) < 0.5 and state.fingers[0].target_um is not None:
            asked.append(f"{state.fingers[0].target_um:.1f}")
            break
print(f"4. Left of the ridge, on it and right of it the finger is asked {', '.join(asked)} um.")

# 5. An effect plays when something happens: a click whenever a finger enters the ridge. States are the newest only; no
# event is left out, so listen before what brings it.
plate.effect("click", Pulse(1.0, 0.02, 0.002), on="ridge", start=OnEntering("ridge"))
events = plate.events(timeout_s=30.0)
hand.move((0.0, 10.0))
begun = next(event for event in events if event.kind == "begun" and event.effect == "click")
print(f"5. The click began when finger {begun.finger} entered.")

# 6. A marker is an instant of your experiment, on the daemon's clock: in every state, and in recordings.
t_ns = plate.marker("tutorial ends")
hand.lift()
hand.close()
plate.close()
print(f"6. Marked at {t_ns * 1e-9:.3f} s. Go on with clients/examples.")
