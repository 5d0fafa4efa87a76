"""Two intervals in PsychoPy: which one was more slippery? The experiment's own loop drives the plate.

PsychoPy shows the texts and takes the keys; the plate gives every finger what the trial says, is recorded with a marker
for each event, and a time stamp of the daemon is with each answer. Answers are PsychoPy's own data file.

    hapticd run --sim &  python two_intervals.py --participant P03
"""

from __future__ import annotations

import argparse
import random
from collections.abc import Sequence
from typing import Any

from hapticd_client import Client, HapticdError

STANDARD = 1.0  # friction of bare glass
LEVELS = (0.3, 0.5, 0.7, 0.9)
KEYS = {"1": "first", "2": "second", "escape": None}


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--participant", required=True, help="letters and digits, such as P03")
    parser.add_argument("--repeats", type=int, default=10, help="trials at each of the levels (%(default)s)")
    parser.add_argument("--touched-s", type=float, default=1.5, help="how long an interval is felt (%(default)s)")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    options = parser.parse_args(arguments)
    try:
        from psychopy import core, data, event, visual
    except ImportError:
        parser.exit(1, "This example needs PsychoPy in this Python: install it (psychopy.org).\n")

    window = visual.Window(fullscr=False, color="black")
    text = visual.TextStim(window, wrapWidth=1.6)
    trials = data.TrialHandler([{"level": level} for level in LEVELS], options.repeats, method="random")
    name = f"sub-{options.participant}_task-twointervals"
    try:
        with Client(options.endpoint) as plate, plate.record(f"{name}_physio.mcap"):
            for trial in trials:
                answered = run(plate, trial["level"], options.touched_s, core, event, window, text)
                if answered is None:
                    break
                for field, value in answered.items():
                    trials.addData(field, value)
        trials.saveAsWideText(f"{name}_beh.tsv", delim="\t")
    except HapticdError as error:
        parser.exit(1, f"{error}\n")
    finally:
        window.close()


def run(
    plate: Client, level: float, touched_s: float, core: Any, event: Any, window: Any, text: Any
) -> dict[str, Any] | None:
    """Run one trial; return its data, or None for Escape."""
    right = random.choice(("first", "second"))
    for interval in ("first", "second"):
        friction = level if interval == right else STANDARD
        plate.marker({"event": interval, "level": level})  # before the surface: the recording has what came after
        plate.surface("everywhere", friction=friction)
        show(window, text, f"{interval}: stroke the plate")
        core.wait(touched_s)
        plate.remove("everywhere")
    show(window, text, "Which one was more slippery? 1 or 2")
    clock = core.Clock()
    ((key, took_s),) = event.waitKeys(keyList=list(KEYS), timeStamped=clock)
    answer = KEYS[key]
    if answer is None:
        return None
    t_ns = plate.marker({"event": "answer", "level": level, "answer": answer, "is_right": answer == right})
    t_daemon_ns = str(t_ns)  # PsychoPy writes a number with seven digits, and text as it is
    return {"answer": answer, "is_right": answer == right, "response_s": took_s, "t_daemon_ns": t_daemon_ns}


def show(window: Any, text: Any, words: str) -> None:
    """Show a text until the next one."""
    text.text = words
    text.draw()
    window.flip()


if __name__ == "__main__":
    main()
